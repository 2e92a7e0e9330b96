"""How many joints of arms are found again from the poses they lead to, and how long it takes.

    python benchmarks/running/arm_joints.py [URDF ...] [--tip tool0] [--poses 300]

Prints for each file, without its meshes:

* the share of drawn joints that is among the branches of their poses, and the mean number of branches;
* the share of poses with branches where the axes of the wrist are in line, and where all joints are zero;
* microseconds for a pose, and the ratio to the first file; milliseconds to make the arm, with its self-test.
"""

from __future__ import annotations

import argparse
import re
import tempfile
import time
from pathlib import Path

import numpy as np

from planner import Robot, RobotError

EXAMPLES = Path(__file__).parents[2] / "examples" / "robots"
FOUND_RAD = 1e-5
GEOMETRY = re.compile(r"<(collision|visual)\b.*?</\1>", re.DOTALL)


def read_bare(path, tip):
    """Return the robot of a file without its meshes."""
    text = GEOMETRY.sub("", Path(path).read_text("utf-8"))
    with tempfile.TemporaryDirectory() as folder:
        bare = Path(folder) / Path(path).name
        bare.write_text(text, encoding="utf-8")
        return Robot.from_urdf(bare, tip=tip)


def are_found(branches, q):
    """Return which joints (n, 6) are among the branches of their poses, whole turns aside."""
    turned = [one - joints for one, joints in zip(branches, q, strict=True)]
    turned = [one - 2 * np.pi * np.round(one / (2 * np.pi)) for one in turned]
    return [np.abs(one).max(axis=1).min(initial=np.inf) < FOUND_RAD for one in turned]


def best_time(function, repeat=3):
    """Return the least processor time, s, of several calls."""
    times = []
    for _ in range(repeat):
        start = time.process_time()
        function()
        times.append(time.process_time() - start)
    return min(times)


def measured(robot, count):
    """Return shares, means and times of one arm."""
    start = time.process_time()
    robot.check_solvable()
    made = time.process_time() - start
    q = np.random.default_rng(1).uniform(robot.lower, robot.upper, (count, 6))
    flanges = robot.forward(q)
    branches = robot.branches_of(flanges)
    q_line = q.copy()
    q_line[:, 4] = np.clip(0.0, robot.lower[4], robot.upper[4])
    in_line = [len(one) > 0 for one in robot.branches_of(robot.forward(q_line))]
    at_zero = len(robot.branches(robot.forward(np.clip(np.zeros(6), robot.lower, robot.upper))))
    seconds = best_time(lambda: robot.branches_of(flanges)) / count
    mean = np.mean([len(one) for one in branches])
    return np.mean(are_found(branches, q)), mean, np.mean(in_line), at_zero, seconds, made


def main() -> None:
    """Print a line for each file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("files", nargs="*", default=sorted(EXAMPLES.glob("*.urdf")))
    parser.add_argument("--tip", default="tool0")
    parser.add_argument("--poses", type=int, default=300)
    options = parser.parse_args()
    first = None
    for path in options.files:
        try:
            robot = read_bare(path, options.tip)
            share, mean, in_line, at_zero, seconds, made = measured(robot, options.poses)
        except RobotError as error:
            print(f"{Path(path).name:28} {error}")
            continue
        first = first or seconds
        print(
            f"{Path(path).name:28} found {share:7.2%}  branches {mean:.2f}  in line {in_line:7.2%}  "
            f"zero {at_zero}  {1e6 * seconds:4.0f} us  x {seconds / first:.1f}  made {1e3 * made:.0f} ms"
        )


if __name__ == "__main__":
    main()
