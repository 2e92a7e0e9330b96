"""Signed distance to solids, and the regions a robot can reach.

A region is anything with ``margin(positions) -> (n,)``: the distance in mm to its boundary, positive inside. A plain
``callable(positions) -> (n,) bool`` is accepted wherever a region is, which is where inverse kinematics goes. A plan
that is to be resumed tells regions apart by `reach_name`; a region or callable of your own may have an attribute
``state_name`` that says what it permits.
"""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable
from dataclasses import dataclass
from types import BuiltinFunctionType, FunctionType
from typing import Any, Protocol

import numpy as np

from aspectgraph.solid import RayScene
from planner.exceptions import RequestError


class Region(Protocol):
    """A reachable region of space."""

    def margin(self, positions: np.ndarray) -> np.ndarray:
        """Return the signed distance (n,) in mm of positions (n, 3) to the boundary, positive inside."""


class SignedDistance:
    """Distance to a closed triangle mesh, by Open3D's ray casting scene (float32: about 1e-7 of the mesh's size).

    Parameters
    ----------
    vertices : array (v, 3)
        Corners, mm.
    triangles : array (t, 3)
        Vertex indices, outward counter-clockwise.
    """

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray) -> None:
        self._scene = RayScene(vertices, triangles, n_threads=1)

    def __call__(self, positions: np.ndarray) -> np.ndarray:
        """Return the distance (n,) in mm of positions (n, 3), negative inside the mesh."""
        return self._scene.signed_distance(positions)


@dataclass(frozen=True)
class BoxRegion:
    """An axis-parallel box.

    Parameters
    ----------
    low : tuple of float
        Lowest corner (3,), mm.
    high : tuple of float
        Highest corner (3,), mm.

    Raises
    ------
    RequestError
        If `low` is not below `high` in every coordinate.

    Examples
    --------
    >>> import numpy as np
    >>> from planner import BoxRegion
    >>> box = BoxRegion((0.0, 0.0, 0.0), (100.0, 100.0, 50.0))
    >>> box.margin(np.array([[50.0, 50.0, 20.0], [50.0, 50.0, 75.0]])).tolist()
    [20.0, -25.0]
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]

    def __post_init__(self) -> None:
        if not np.all(np.asarray(self.low, dtype=float) < np.asarray(self.high, dtype=float)):
            raise RequestError(
                f"low must be below high in every coordinate. Got {self.low!r} and {self.high!r}."
            )

    def margin(self, positions: np.ndarray) -> np.ndarray:
        """Return the distance to the nearest face, positive inside.

        Parameters
        ----------
        positions : array, shape (n, 3)
            Positions, mm.

        Returns
        -------
        array, shape (n,)
            Distances, mm; outside, minus the largest overshoot along an axis.
        """
        return np.minimum(positions - np.asarray(self.low), np.asarray(self.high) - positions).min(
            axis=-1
        )


@dataclass(frozen=True)
class SphereRegion:
    """A ball, such as the dexterous reach about a robot's shoulder.

    Parameters
    ----------
    centre : tuple of float
        Its centre (3,), mm.
    radius_mm : float
        Its radius, mm.

    Raises
    ------
    RequestError
        If the radius is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from planner import SphereRegion
    >>> sphere = SphereRegion((0.0, 0.0, 0.0), radius_mm=100.0)
    >>> sphere.margin(np.array([[60.0, 0.0, 0.0], [0.0, 130.0, 0.0]])).tolist()
    [40.0, -30.0]
    """

    centre: tuple[float, float, float]
    radius_mm: float

    def __post_init__(self) -> None:
        if not self.radius_mm > 0:
            raise RequestError(f"radius_mm must be positive. Got {self.radius_mm!r}.")

    def margin(self, positions: np.ndarray) -> np.ndarray:
        """Return the distance to the sphere, positive inside.

        Parameters
        ----------
        positions : array, shape (n, 3)
            Positions, mm.

        Returns
        -------
        array, shape (n,)
            Distances, mm; negative outside.
        """
        return self.radius_mm - np.linalg.norm(positions - np.asarray(self.centre), axis=-1)


class MeshRegion:
    """The inside of a closed triangle mesh.

    Parameters
    ----------
    vertices : array_like, shape (v, 3)
        Corners, mm.
    triangles : array_like of int, shape (t, 3)
        Vertex indices, counter-clockwise seen from outside.
    """

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray) -> None:
        self.vertices = np.asarray(vertices, dtype=np.float64)
        self.triangles = np.asarray(triangles)
        self._distance: SignedDistance | None = None

    def margin(self, positions: np.ndarray) -> np.ndarray:
        """Return the distance to the surface, positive inside.

        Parameters
        ----------
        positions : array, shape (n, 3)
            Positions, mm.

        Returns
        -------
        array, shape (n,)
            Distances, mm; negative outside.
        """
        if self._distance is None:
            self._distance = SignedDistance(self.vertices, self.triangles)
        return -self._distance(positions)

    @property
    def state_name(self) -> str:
        """A digest of the mesh, whatever the memory layout and integer type of its arrays."""
        content = self.vertices.tobytes() + self.triangles.astype("<i8").tobytes()
        return f"mesh {self.vertices.shape} {hashlib.sha256(content).hexdigest()}"

    def __getstate__(self) -> dict[str, Any]:
        """Leave the scene behind: it cannot cross a process boundary and is rebuilt on demand."""
        return {**self.__dict__, "_distance": None}


Reach = Region | Callable[[np.ndarray], np.ndarray]


def check_reach(reach: Reach | None) -> Reach | None:
    """Return the region, or raise `RequestError` if it is neither a region nor a callable."""
    if reach is None or hasattr(reach, "margin") or callable(reach):
        return reach
    raise RequestError(f"reach must have a margin method or be callable. Got {reach!r}.")


def reach_name(reach: Reach | None) -> str:
    """Return what tells a region from others, the same in every process: a planning state belongs to one region.

    An attribute ``state_name`` (str), if there is one, is the name. Else a function is known by its module and name,
    whatever it refers to, and any other region by its content.
    """
    if reach is None:
        return "none"
    if hasattr(reach, "state_name"):
        return str(reach.state_name)
    if isinstance(reach, FunctionType | BuiltinFunctionType):
        return f"{reach.__module__}.{reach.__qualname__}"
    try:
        content = hashlib.sha256(pickle.dumps(reach, protocol=4)).hexdigest()
    except (pickle.PicklingError, TypeError, AttributeError):
        # what cannot be packed, such as a connection to a robot
        content = "unnamed"
    return f"{type(reach).__module__}.{type(reach).__qualname__} {content}"


def reach_margin(reach: Reach, positions: np.ndarray) -> np.ndarray:
    """Return the margin (n,) of positions (n, 3): mm for a region, +1 or -1 for a callable."""
    if hasattr(reach, "margin"):
        margin = np.asarray(reach.margin(positions), dtype=np.float64)
    else:
        margin = np.where(np.asarray(reach(positions), dtype=bool), 1.0, -1.0)
    if margin.shape != (len(positions),):
        raise RequestError(
            f"reach must return one value per position, shape ({len(positions)},). Got {margin.shape}."
        )
    return margin
