"""A log at half the rate with averaged torques and late inputs: the lag found, and the error with and without it.

    python scripts/bench_lag.py

The robot walks at 1 kHz. The log, written by rosbags, has every second state; torques and wrenches are means over 2 ms,
on the same stamps or on topics stamped later. Seven links are off by a quarter of the norm of their masses.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from lab.motions import Short, walk
from lab.plant import write_ros2
from massid.assets import resolve_model
from massid.audit import audit_walk, prepare_walk
from massid.identify import IdentifyOptions, identify_offline
from massid.identify.prepare import prepare_logs
from massid.log import TopicMap, read_walk
from massid.model.robot import Robot
from massid.model.unknowns.spaces import mass_space
from massid.typing import FloatArray
from massid.walk import Walk

FOLDER = Path("bench_lag")
CASES = ((1, 0.0), (1, 0.001), (2, 0.0), (2, 0.001), (2, 0.0033), (2, -0.0007))


CLEAN = IdentifyOptions(noise="clean", passes=5)


def error(log: Walk, robot: Robot, links: tuple[str, ...], truth: FloatArray) -> float:
    """L2 mass error after an offline identification [kg]."""
    (prepared,) = prepare_logs([log], robot, mass_space(robot, links), CLEAN)
    result = identify_offline([prepared], robot, CLEAN)
    return float(np.linalg.norm(result.estimate[: len(truth)] - truth))


def main() -> None:
    """Record once, log in several ways, print one line each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=6.0, help="of walking")
    seconds = parser.parse_args().seconds
    robot = Robot.load(resolve_model("atlas"))
    recorded, motion, space, truth = walk(robot, Short(seconds))
    links = tuple(parameter.target for parameter in space.parameters)
    before = float(np.linalg.norm(space.nominal - truth))
    sys.stdout.write(f"{motion}, L2 mass error {before:.2f} kg before\n")
    for stride, lag_s in CASES:
        path = write_ros2(recorded, FOLDER / f"{stride}_{lag_s}", stride, lag_s, split_effort=True)
        topics = TopicMap()
        if topics.joints is None:
            raise RuntimeError("the default map has joints")
        effort = replace(topics.joints.effort, topic="/joint_efforts")
        topics = replace(topics, joints=replace(topics.joints, effort=effort))
        plain = audit_walk(robot, read_walk(path, topics)).walk
        prepared = prepare_walk(path, robot, topics)
        lag = prepared.audit.lag
        found = f"{lag.effort_s * 1e3:+.3f} / {lag.wrench_s * 1e3:+.3f} ms" if lag else "none"
        sys.stdout.write(
            f"{1000 // stride} Hz, inputs {lag_s * 1e3:+.1f} ms late: found {found} (torques / wrenches), error "
            f"{error(plain, robot, links, truth):.3g} kg as stamped, "
            f"{error(prepared.walk, prepared.robot, links, truth):.3g} kg compensated\n"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main()
