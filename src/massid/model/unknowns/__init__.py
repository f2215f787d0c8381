"""What can be unknown of a robot and of its sensors, and the spaces that such unknowns span.

Every module of this folder is loaded with it, so that the kinds of unknowns in it can be asked for by name; nothing
else has to know of a new one.
"""

from importlib import import_module
from pkgutil import iter_modules

for _found in iter_modules(__path__):
    import_module(f"{__name__}.{_found.name}")
