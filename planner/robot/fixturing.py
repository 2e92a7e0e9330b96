"""One way the part lies in the cell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from planner.robot.bodies import Body, Box, mesh_of
from planner.robot.transforms import carry, check_pose, compose


@dataclass(frozen=True, eq=False)
class Fixturing:
    """One way the part lies in the cell.

    Parameters
    ----------
    part2base : array_like, shape (4, 4)
        The part's frame in the robot's base, mm.
    obstacles : mapping of str to Box, path or (corners, triangles)
        What comes with it, such as a table or a clamp, in the base frame, mm.

    Raises
    ------
    RobotError
        If `part2base` is no rigid motion.
    """

    part2base: np.ndarray
    obstacles: Mapping[str, Body] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "part2base", check_pose("part2base", self.part2base))
        object.__setattr__(self, "obstacles", dict(self.obstacles))

    def moved(self, motion: np.ndarray) -> Fixturing:
        """Return the same moved by a pose (4, 4) of the base, mm."""
        obstacles = {name: _moved(name, body, motion) for name, body in self.obstacles.items()}
        return Fixturing(compose(motion, self.part2base), obstacles)


def _moved(name: str, body: Body, motion: np.ndarray) -> Body:
    if isinstance(body, Box):
        return Box(body.low, body.high, compose(motion, body.pose))
    corners, triangles = mesh_of(body, name)
    return carry(motion, corners), triangles
