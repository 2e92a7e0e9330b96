"""Lights of a cell: a backlight that stands under the part, and a light that the camera carries, as solid bodies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ground.short_repr import short_repr
from planner.argument_kinds import POSITIVE, check_number, shown
from planner.exceptions import RequestError, RobotError
from planner.light_catalogue import light_facts, light_names, light_parts
from planner.robotcell.bodies import Body, Box, hull_of
from planner.robotcell.urdf import carry, invert

# The housing around what shines has no size in the catalogue: it is as thick as the cell states. A body with a hole
# is made of sectors, each a convex solid. They reach outwards beyond the circle, and inwards up to their chords: no
# sector is smaller than what it stands for.

BACKLIGHT = "backlight"
THICKNESS_MM = 20.0
"""How thick the housing of a light is around what shines, mm, where the cell does not state it."""
_SECTORS = 8
# a segment that is beyond the plane by less than this share of its distance from the camera lies in it
_IN_PLANE = 1e-6
# rings of sectors from the rim of a dome to its hole
_BANDS = 2


@dataclass(frozen=True, eq=False)
class LightBox(Box):
    """A backlight as an obstacle: a box whose upper side (+z of its own frame) shines.

    `of` makes one from the catalogue. Give it to a `Fixturing` among its obstacles, or among what turns with the part.

    Parameters
    ----------
    low, high : sequence of float
        Opposite corners (3,), mm.
    pose : array (4, 4), optional
        The box's frame in the base, mm. Default: the base.
    name : str
        ``backlight:NAME`` of the catalogue.

    Raises
    ------
    RobotError
        If `low` is not below `high` in every coordinate, or `pose` is no rigid motion.

    Examples
    --------
    >>> import numpy as np
    >>> from planner import LightBox
    >>> LightBox.of("backlight:basler-back-100x100", np.eye(4)).low
    (-50.0, -50.0, -20.0)
    """

    name: str = ""

    __repr__ = short_repr

    @property
    def rectangle(self) -> np.ndarray:
        """Corners (4, 3) of the bright rectangle, counter-clockwise as the camera sees it, mm."""
        x, y = self.low[:2]
        u, v, top = self.high
        return carry(self.pose, np.array([[x, y, top], [u, y, top], [u, v, top], [x, v, top]]))

    def behind(self, eyes: np.ndarray, segments: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return where the lines of sight past segments meet the plane that shines.

        Parameters
        ----------
        eyes : array (n, 3)
            Positions of cameras, mm, in the frame of `pose`'s result.
        segments : array (s, 2, 3)
            Segments in the same frame, mm.

        Returns
        -------
        ends : array (n, s, 2, 3)
            The points of the plane; nan where a line of sight does not meet it from the bright side.
        met : array of bool (n, s)
            Whether both ends are within the bright rectangle.
        """
        inverse = invert(self.pose)
        starts = carry(inverse, eyes)[:, None, None]
        points = carry(inverse, segments.reshape(-1, 3)).reshape(1, -1, 2, 3)
        top = self.high[2]
        heights = starts[..., 2] - top
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = heights / (starts[..., 2] - points[..., 2])
        # the plane is beyond the segment, which may lie in it
        shares = np.where((heights > 0) & (shares >= 1 - _IN_PLANE), shares, np.nan)
        ends = starts + shares[..., None] * (points - starts)
        low = np.array(self.low[:2])
        high = np.array(self.high[:2])
        with np.errstate(invalid="ignore"):
            within = ((ends[..., :2] >= low) & (ends[..., :2] <= high)).all(axis=(-2, -1))
        return carry(self.pose, ends.reshape(-1, 3)).reshape(ends.shape), within

    @classmethod
    def of(cls, name: str, pose: Any, thickness_mm: float = THICKNESS_MM) -> LightBox:
        """Return a backlight of the catalogue.

        Parameters
        ----------
        name : str
            Such as "backlight:basler-back-200x200".
        pose : array_like, shape (4, 4)
            The frame of the bright rectangle in the base, mm: its origin is the middle, x and y are along width and
            height, and it shines to z.
        thickness_mm : float
            How far the housing reaches below the bright rectangle.

        Raises
        ------
        RobotError
            If the catalogue has no such backlight, or a value breaks its rule.

        Examples
        --------
        >>> from planner import LightBox
        >>> pose = [[1, 0, 0, 600], [0, 1, 0, 0], [0, 0, 1, 20], [0, 0, 0, 1]]
        >>> LightBox.of("backlight:basler-back-200x300", pose).high
        (100.0, 150.0, 0.0)
        """
        word, facts = _facts(name, (BACKLIGHT,))
        thickness = check_number("thickness_mm", thickness_mm, POSITIVE)
        x = facts["width_mm"] / 2
        y = facts["height_mm"] / 2
        return cls((-x, -y, -thickness), (x, y, 0.0), pose, word)


@dataclass(frozen=True)
class CarriedLight:
    """A light that moves with the camera: a diffuse dome, coaxial light or a ring of the catalogue.

    Parameters
    ----------
    name : str
        Such as "ring-light:typical-90".
    distance_mm : float
        From the camera's front nodal point to the side of the light that is towards the part, along the axis.
    thickness_mm : float
        How thick its housing is: behind a ring, outside of a dome, and around the window of coaxial light.

    Raises
    ------
    RobotError
        If the catalogue has no such light, or a value breaks its rule.

    Examples
    --------
    >>> from planner import CarriedLight
    >>> len(CarriedLight("ring-light:typical-90", 150).bodies())
    8
    """

    name: str
    distance_mm: float
    thickness_mm: float = THICKNESS_MM

    def __post_init__(self) -> None:
        word, facts = _facts(self.name, [kind for kind in light_parts() if kind != BACKLIGHT])
        object.__setattr__(self, "name", word)
        for name in ("distance_mm", "thickness_mm"):
            object.__setattr__(self, name, check_number(name, getattr(self, name), POSITIVE))
        radius = facts.get("diameter_mm", 0.0) / 2
        if not radius < self.distance_mm:
            rule = f"must be above the radius of the dome, {radius:g}"
            raise RobotError.of_rule("distance_mm", rule, f"{self.distance_mm:g}")

    def bodies(self) -> tuple[Body, ...]:
        """Return the solids that it consists of.

        Returns
        -------
        tuple of Box or (corners, triangles)
            Convex each, in the camera's frame, mm.
        """
        facts = light_facts(*self.name.split(":"))
        lower = self.distance_mm
        if "side_mm" in facts:
            side = facts["side_mm"]
            reach = side / 2 + self.thickness_mm
            return (Box((-reach, -reach, lower - side), (reach, reach, lower)),)
        if "diameter_mm" in facts:
            return self._dome(facts["diameter_mm"] / 2, facts["hole_mm"] / 2)
        radii = np.array([facts["inner_mm"], facts["outer_mm"]]) / 2
        radii[1] /= np.cos(np.pi / _SECTORS)
        section = [(r, z) for r in radii for z in (lower - self.thickness_mm, lower)]
        return _turned(section)

    def _dome(self, radius: float, hole: float) -> tuple[Body, ...]:
        """Return the shell of half a sphere around the axis, with a hole at its top."""
        angles = np.linspace(np.arcsin(hole / radius), np.pi / 2, _BANDS + 1)
        # corners beyond the sphere, so that the sides do not cut into it
        beyond = np.cos(np.pi / _SECTORS) * np.cos((angles[1] - angles[0]) / 2)
        outer = (radius + self.thickness_mm) / beyond
        bodies: tuple[Body, ...] = ()
        for pair in pairwise(angles.tolist()):
            section = [
                (r * np.sin(angle), self.distance_mm - r * np.cos(angle))
                for r in (radius, outer)
                for angle in pair
            ]
            bodies += _turned(section)
        return bodies


def _turned(section: list[tuple[float, float]]) -> tuple[Body, ...]:
    """Return sectors around the z axis of a section of radii and heights, mm."""
    radii, heights = np.array(section).T
    bodies: list[Body] = []
    for sector in range(_SECTORS):
        sides = 2 * np.pi * np.array([sector, sector + 1]) / _SECTORS
        points = [
            np.stack([radii * np.cos(side), radii * np.sin(side), heights], axis=1)
            for side in sides
        ]
        hull = hull_of(np.concatenate(points), "light")
        bodies.append((hull.corners, hull.triangles))
    return tuple(bodies)


def _facts(name: Any, kinds: Any) -> tuple[str, Mapping[str, Any]]:
    """Return the word for a light of one of some kinds as the catalogue writes it, and its sizes."""
    kind, _, of_kind = name.partition(":") if isinstance(name, str) else ("", "", "")
    if kind not in kinds or not of_kind:
        first = next(word for word in light_names() if word.partition(":")[0] in kinds)
        rule = f"must be {' or '.join(kinds)}, with :NAME of the catalogue, such as {first}"
        raise RobotError.of_rule("name", rule, shown(name))
    try:
        return f"{kind}:{of_kind.lower()}", light_facts(kind, of_kind)
    except RequestError as error:
        raise RobotError.of_rule("name", error.rule, error.got, hint=error.hint) from None
