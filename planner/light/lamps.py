"""Where lamps are, or may be: places of a cell, a ring on the camera, a box or a dome to choose from."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linprog
from scipy.stats import qmc

from aspectgraph.cells.arrays import Cell
from planner.argument_kinds import NOT_NEGATIVE, POSITIVE, check_number
from planner.exceptions import RequestError
from planner.request.reach import Reach, check_reach, reach_margin

Array = NDArray[np.float64]

RING = "ring"
"""A ring light on the camera: a lamp at its front nodal point."""

# distance, as a share of the space's size, that says apart from touching
_APART = 1e-9
_DOME_POINTS = 20_000
# places drawn in a cell
_DRAWN = 15


class LampSpace(Protocol):
    """Where lamps may be placed."""

    @property
    def clearance_mm(self) -> float:
        """Distance that lamps keep from the part."""

    @property
    def bounds(self) -> Array:
        """Lowest and highest corner of a box around it, (2, 3) mm."""

    def places(self, n: int) -> Array:
        """Return n places (n, 3) that are spread evenly, the same in every call."""

    def misses(self, cell: Cell) -> bool:
        """Tell whether a convex cell has no place; False where that is not sure."""

    def places_in(self, cell: Cell) -> Array:
        """Return some places (m, 3) in a convex cell; there may be none, and places though none is returned."""

    def __str__(self) -> str:
        """Return what a sentence calls it."""


@dataclass(frozen=True)
class LampBox:
    """A box in which lamps may be.

    Parameters
    ----------
    low : tuple of float
        Lowest corner (3,), mm.
    high : tuple of float
        Highest corner (3,), mm.
    clearance_mm : float
        Distance that lamps keep from the part.
    reach : ReachRegion or callable, optional
        Part of the box that a robot with the lamp reaches, as in `plan_setting`. The proof of the
        bound uses the whole box.

    Raises
    ------
    RequestError
        If a number is not finite, the clearance is negative, or `low` is not below `high` in every coordinate.

    Examples
    --------
    >>> from planner import LampBox
    >>> LampBox((-500, -500, 250), (500, 500, 900)).clearance_mm
    10.0
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    clearance_mm: float = 10.0
    reach: Reach | None = None

    def __post_init__(self) -> None:
        box = _numbers("the corners of a box of lamps", (self.low, self.high), (2, 3))
        if not (box[0] < box[1]).all():
            raise RequestError.of_rule(
                "low", "must be below high in every coordinate", f"{self.low!r} and {self.high!r}"
            )
        check_number("clearance_mm", self.clearance_mm, NOT_NEGATIVE)
        check_reach(self.reach)

    def __str__(self) -> str:
        """Return what a sentence calls it."""
        return "the box of lamps"

    @property
    def bounds(self) -> Array:
        """Its corners (2, 3), mm."""
        return np.array([self.low, self.high], dtype=np.float64)

    def places(self, n: int) -> Array:
        """Return the reachable ones of n points of a Halton sequence.

        Parameters
        ----------
        n : int
            How many.

        Returns
        -------
        array, shape (n, 3)
            Positions in mm, the same in every call.
        """
        low, high = self.bounds
        drawn = qmc.Halton(3, scramble=True, rng=np.random.default_rng(0)).random(n)
        return self._reached(np.asarray(low + drawn * (high - low)))

    def misses(self, cell: Cell) -> bool:
        """Return whether a convex cell lies outside the box.

        Parameters
        ----------
        cell : Cell
            In mm.

        Returns
        -------
        bool
            False if this is not certain.
        """
        low, high = self.bounds
        apart = _APART * float(np.linalg.norm(high - low))
        if (cell.vertices < low - apart).all(axis=0).any() or (cell.vertices > high + apart).all(
            axis=0
        ).any():
            return True
        planes = cell.half_spaces
        nearest = np.where(planes[:, :3] > 0, low, high)
        if (np.einsum("ki,ki->k", planes[:, :3], nearest) + planes[:, 3] > apart).any():
            return True
        return bool(self._deepest(cell)[1] < -apart)

    def places_in(self, cell: Cell) -> Array:
        """Return points in the box and the cell: the centre of the largest ball, and random ones.

        Parameters
        ----------
        cell : Cell
            In mm.

        Returns
        -------
        array, shape (m, 3)
            In mm. It may be empty although the cell contains lamp positions.
        """
        place, depth = self._deepest(cell)
        if depth <= 0:
            return np.empty((0, 3))
        (normals, offsets) = self._planes(cell)
        rng = np.random.default_rng(0)
        low = self.bounds[0]
        points = [place - low]
        for way in rng.normal(size=(_DRAWN, 3)):
            speed = normals @ way
            room = offsets - normals @ points[-1]
            last = (room[speed > 0] / speed[speed > 0]).min()
            first = (room[speed < 0] / speed[speed < 0]).max()
            points.append(points[-1] + way * rng.uniform(first, last))
        return self._reached(low + np.array(points))

    def _reached(self, places: Array) -> Array:
        return places if self.reach is None else places[reach_margin(self.reach, places) > 0]

    def _planes(self, cell: Cell) -> tuple[Array, Array]:
        """Return normals (k, 3) and offsets (k,) of box and cell about the box's lowest corner: n·x <= o inside."""
        low, high = self.bounds
        normals = np.concatenate([cell.half_spaces[:, :3], np.eye(3), -np.eye(3)])
        inside_cell = -cell.half_spaces[:, 3] - cell.half_spaces[:, :3] @ low
        return normals, np.concatenate([inside_cell, high - low, np.zeros(3)])

    def _deepest(self, cell: Cell) -> tuple[Array, float]:
        """Return the point farthest from all planes of box and cell, and how far it is inside; a linear programme."""
        (normals, offsets) = self._planes(cell)
        low = self.bounds[0]
        ball = linprog(
            [0, 0, 0, -1],
            np.column_stack([normals, np.ones(len(normals))]),
            offsets,
            bounds=(None, None),
            method="highs",
        )
        return low + ball.x[:3], float(ball.x[3])


@dataclass(frozen=True)
class LampDome:
    """A sphere around the part, above a height, on which lamps may be.

    Parameters
    ----------
    centre : tuple of float
        Its centre (3,), mm.
    radius_mm : float
        Its radius.
    lowest_mm : float
        Least height (z) of a lamp above the centre.
    clearance_mm : float
        Distance that lamps keep from the part.

    Raises
    ------
    RequestError
        If a number is not finite, the radius is not positive, or the clearance is negative. If the
        sphere has no point at the least height.

    Examples
    --------
    >>> from planner import LampDome
    >>> LampDome((0, 0, 0), radius_mm=400.0, lowest_mm=50.0).radius_mm
    400.0
    """

    centre: tuple[float, float, float]
    radius_mm: float
    lowest_mm: float = 0.0
    clearance_mm: float = 10.0

    def __post_init__(self) -> None:
        _numbers("the centre of a dome of lamps", self.centre, (3,))
        _numbers("radius_mm and lowest_mm", (self.radius_mm, self.lowest_mm), (2,))
        check_number("radius_mm", self.radius_mm, POSITIVE)
        if not self.lowest_mm < self.radius_mm:
            raise RequestError.of_rule(
                "lowest_mm", f"must be below radius_mm, {self.radius_mm:g}", repr(self.lowest_mm)
            )
        check_number("clearance_mm", self.clearance_mm, NOT_NEGATIVE)

    def __str__(self) -> str:
        """Return what a sentence calls it."""
        return "the dome of lamps"

    @property
    def bounds(self) -> Array:
        """Corners of the box around it (2, 3), mm."""
        low = np.full(3, -self.radius_mm)
        low[2] = max(low[2], self.lowest_mm)
        return np.array(self.centre, dtype=np.float64) + np.array([low, np.full(3, self.radius_mm)])

    def places(self, n: int) -> Array:
        """Return n points of a spiral, spread evenly over the area.

        Parameters
        ----------
        n : int
            How many.

        Returns
        -------
        array, shape (n, 3)
            Positions in mm, the same in every call.
        """
        lowest = max(self.lowest_mm / self.radius_mm, -1.0)
        height = lowest + (1.0 - lowest) * (np.arange(n) + 0.5) / n
        turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(n)
        flat = np.sqrt(1.0 - height**2)
        return np.array(self.centre) + self.radius_mm * np.column_stack(
            [flat * np.cos(turn), flat * np.sin(turn), height]
        )

    def misses(self, cell: Cell) -> bool:
        """Return whether a convex cell misses the dome.

        Parameters
        ----------
        cell : Cell
            In mm.

        Returns
        -------
        bool
            False if this is not certain.
        """
        local = cell.vertices - np.array(self.centre)
        apart = _APART * self.radius_mm
        beyond = cell.half_spaces[:, :3] @ np.array(self.centre) + cell.half_spaces[:, 3]
        inside = np.linalg.norm(local, axis=1).max() < self.radius_mm - apart
        return bool(
            inside
            or beyond.max() > self.radius_mm + apart
            or local[:, 2].max() < self.lowest_mm - apart
        )

    def places_in(self, cell: Cell) -> Array:
        """Return points of a dense spiral that are in the cell.

        Parameters
        ----------
        cell : Cell
            In mm.

        Returns
        -------
        array, shape (m, 3)
            In mm. It may be empty although the cell contains lamp positions.
        """
        places = self.places(_DOME_POINTS)
        inside = (places @ cell.half_spaces[:, :3].T + cell.half_spaces[:, 3] < 0).all(axis=1)
        return places[inside][:: max(1, int(inside.sum()) // 64)]


@dataclass(frozen=True, eq=False)
class LampsTogether:
    """Lamps that are all on in every image. Deprecated: use ``Lighting(lamps, together=True)``.

    Parameters
    ----------
    lamps : array_like, shape (n, 3), or LampBox or LampDome
        As `Lighting` takes them.
    """

    lamps: Any

    def __post_init__(self) -> None:
        warnings.warn(
            "LampsTogether(lamps) is deprecated: use Lighting(lamps, together=True).",
            DeprecationWarning,
            stacklevel=3,
        )


def check_lamps_given(lamps: Any) -> LampSpace | Array | str:
    """Return a space of lamps, the places (n, 3) of fixed ones, or "ring" for the lamp on the camera.

    Raises
    ------
    RequestError
        If it is none of these.
    """
    if isinstance(lamps, LampBox | LampDome):
        return lamps
    if isinstance(lamps, str):
        if lamps == RING:
            return lamps
        raise RequestError.of_rule(
            "lamps", f"must be positions, a LampBox, a LampDome or {RING!r}", repr(lamps)
        )
    return _numbers("lamps", lamps, (-1, 3))


def _numbers(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return finite numbers as an array of a shape; -1 stands for any number but 0."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.empty(0)
    fits = array.ndim == len(shape) and all(
        n == m or (m == -1 and n > 0) for n, m in zip(array.shape, shape, strict=True)
    )
    if not fits or not np.isfinite(array).all():
        expected = str(shape).replace("-1", "n")
        raise RequestError.of_rule(
            name, f"must be finite numbers in mm, shape {expected}", repr(values)
        )
    return array
