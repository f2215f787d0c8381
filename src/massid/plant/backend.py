"""The one import of dm_control: without its noise on machines that have no display.

Importing dm_control looks for an OpenGL backend, which warns where there is no display, and sets a global warning
filter that would unmute every DeprecationWarning of the program. Both stay inside this module. The search itself is
left alone: `MUJOCO_GL=egl` renders as ever.
"""

from __future__ import annotations

import warnings

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    from dm_control import composer, mjcf
    from dm_control.composer.observation import observable
    from dm_control.rl.control import PhysicsError

__all__ = ["PhysicsError", "composer", "mjcf", "observable"]
