"""The two made robots, and cells about them."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from planner import Box, Cell, Fixturing, Robot

ROBOTS = Path(__file__).parents[3] / "examples" / "robots"
PACKAGES = {"made_robots": ROBOTS}
NAMES = ("made_parallel", "made_wrist")


@cache
def made_robot(name):
    """Return one of the made robots."""
    return Robot.from_urdf(ROBOTS / f"{name}.urdf", packages=PACKAGES)


def urdf_text(name="made_parallel"):
    """Return the text of its file."""
    return (ROBOTS / f"{name}.urdf").read_text("utf-8")


def from_text(folder, text, **options):
    """Return a robot of a text."""
    path = folder / "robot.urdf"
    path.write_text(text, encoding="utf-8")
    return Robot.from_urdf(path, packages=PACKAGES, **options)


def pose(xyz=(0.0, 0.0, 0.0), rotation=None):
    """Return a pose (4, 4)."""
    result = np.eye(4)
    result[:3, 3] = xyz
    if rotation is not None:
        result[:3, :3] = rotation
    return result


def random_pose(rng, spread=100.0):
    """Return a drawn pose (4, 4)."""
    return pose(rng.uniform(-spread, spread, 3), Rotation.random(random_state=rng).as_matrix())


def random_joints(robot, rng, count):
    """Return drawn joints (n, 6)."""
    return rng.uniform(robot.lower, robot.upper, (count, 6))


CAM2FLANGE = pose((0.0, 0.0, 90.0))
CAMERA_BODY = (Box((-30.0, -30.0, -90.0), (30.0, 30.0, 0.0)),)
TABLE = Box((300.0, -500.0, -100.0), (1300.0, 500.0, 0.0))


def made_cell(name="made_parallel", **changes):
    """Return a cell with a table, in which the part lies before the robot; options change it."""
    options = {
        "camera_body": CAMERA_BODY,
        "fixturings": {"up": Fixturing(pose((700.0, 0.0, 0.0)), {"table": TABLE})},
    }
    return Cell(made_robot(name), CAM2FLANGE, **(options | changes))


def views(rng, count, size, distance=(150.0, 500.0)):
    """Return poses (n, 4, 4) that look at points of a box from above or the side."""
    from planner import look_at

    outwards = rng.normal(size=(count, 3))
    outwards /= np.linalg.norm(outwards, axis=1)[:, None]
    outwards[:, 2] = np.abs(outwards[:, 2])
    targets = rng.uniform(0.0, size, (count, 3))
    positions = targets + outwards * rng.uniform(*distance, (count, 1))
    return look_at(positions, targets, roll=rng.uniform(-3.0, 3.0, count))
