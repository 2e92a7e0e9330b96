"""Signed distance to solids, and the regions a robot can reach.

A region is anything with ``margin(positions) -> (n,)``: the distance in mm to its boundary, positive inside. A plain
``callable(positions) -> (n,) bool`` is accepted wherever a region is, which is where inverse kinematics goes. A plan
that is to be resumed tells regions apart by `reach_identity`; a region or callable of your own may have an attribute
``state_name`` that says what it permits.
"""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from types import CodeType, FunctionType, MethodType
from typing import TYPE_CHECKING, Any, Protocol
from weakref import WeakKeyDictionary

import numpy as np

from aspectgraph.solid import RayScene
from planner.argument_kinds import POSITIVE, check_number
from planner.exceptions import RequestError

if TYPE_CHECKING:
    from aspectgraph import Solid


class ReachRegion(Protocol):
    """A reachable region of space."""

    def margin(self, positions: np.ndarray) -> np.ndarray:
        """Return the signed distance (n,) in mm of positions (n, 3) to the boundary, positive inside."""


class PoseRegion(Protocol):
    """Poses that a robot reaches, and what it sees from them past obstacles; `planner.Cell.region` makes one.

    It only forbids poses, so a bound without it holds.
    """

    @property
    def state_name(self) -> str:
        """What it permits, as a text that lasts."""

    def pose_margin(self, cam2world: np.ndarray) -> np.ndarray:
        """Return 1 for poses (n, 4, 4) that are reached, otherwise -1; (n,)."""

    def inspectable(
        self, cam2world: np.ndarray, segments: np.ndarray, owner: np.ndarray, wanted: np.ndarray
    ) -> np.ndarray:
        """Return which of the wanted targets (n, k) poses (n, 4, 4) can look at.

        Segments (s, 2, 3) must be seen of the targets (s,) that own them, all from one way the part lies.
        """

    def explain(self, cam2world: np.ndarray, segments: np.ndarray) -> str:
        """Return in words why poses (n, 4, 4) are not reached with segments (s, 2, 3) in sight."""

    def placed(self, cam2world: np.ndarray, segments: np.ndarray) -> dict[str, Any]:
        """Return how the arm stands at a pose (4, 4), by the ways the part lies in which it is reached."""

    def travel_seconds(self, joints: np.ndarray, fixturing: str) -> np.ndarray:
        """Return the time (n, n) between joints (n, 6), or (n, 7) on a turntable, s."""

    def to_dict(self) -> dict[str, Any]:
        """Return what a plan file says of it."""


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


_distances: WeakKeyDictionary[Solid, SignedDistance] = WeakKeyDictionary()


def distance_to(solid: Solid) -> SignedDistance:
    """Return the distance to a part; its rays' scene is built once."""
    try:
        found = _distances.get(solid)
    except TypeError:
        # a part of somebody's own, that cannot be a key
        return SignedDistance(solid.vertices, solid.triangles)
    if found is None:
        found = SignedDistance(solid.vertices, solid.triangles)
        _distances[solid] = found
    return found


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
            raise RequestError.of_rule(
                "low", "must be below high in every coordinate", f"{self.low!r} and {self.high!r}"
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
        check_number("radius_mm", self.radius_mm, POSITIVE)

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

    Examples
    --------
    >>> import numpy as np
    >>> from planner import MeshRegion
    >>> corners = [[0, 0, 0], [300, 0, 0], [0, 300, 0], [0, 0, 300]]
    >>> tetrahedron = MeshRegion(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    >>> [round(float(mm), 3) for mm in tetrahedron.margin(np.array([[50.0, 50, 50], [-10, 50, 50]]))]
    [50.0, -10.0]
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
        """A digest of the mesh, independent of memory layout and integer type of its arrays."""
        content = self.vertices.tobytes() + self.triangles.astype("<i8").tobytes()
        return f"mesh {self.vertices.shape} {hashlib.sha256(content).hexdigest()}"

    def __getstate__(self) -> dict[str, Any]:
        """Leave the scene behind: it cannot cross a process boundary and is rebuilt on demand."""
        return {**self.__dict__, "_distance": None}


Reach = ReachRegion | Callable[[np.ndarray], np.ndarray]


def check_reach(reach: Reach | None) -> Reach | None:
    """Return the region, or raise `RequestError` if it is neither a region nor a callable."""
    if reach is None or hasattr(reach, "margin") or callable(reach):
        return reach
    raise RequestError.of_rule("reach", "must have a margin method or be callable", repr(reach))


def reach_identity(reach: Reach | None) -> dict[str, Any] | None:
    """Return what tells a region from others as plain values, the same in every process.

    Parameters
    ----------
    reach : ReachRegion or callable or None
        An attribute ``state_name`` (str), if there is one, says what it permits. Otherwise a box and a ball are known
        by their numbers, another region by its content and its code, and a function by its name and its code.

    Returns
    -------
    dict of str to value, or None
        With the key ``unnamed`` where nothing lasts: of a lambda, of a function inside another one or with variables
        of one, and of what cannot be pickled.
    """
    if reach is None:
        return None
    if hasattr(reach, "state_name"):
        return {"state_name": str(reach.state_name)}
    if type(reach) is BoxRegion:
        return {"kind": "BoxRegion", "low": list(reach.low), "high": list(reach.high)}
    if type(reach) is SphereRegion:
        return {"kind": "SphereRegion", "centre": list(reach.centre), "radius_mm": reach.radius_mm}
    name = _name_of(reach)
    try:
        return {"kind": name, "content": _content_of(reach)}
    # whatever code of the caller raises, such as that of a connection to a robot
    except Exception:
        return {"unnamed": name}


def _name_of(reach: Any) -> str:
    named = reach if hasattr(reach, "__qualname__") else type(reach)
    return f"{named.__module__}.{named.__qualname__}"


def _content_of(reach: Any) -> str:
    """Return a digest of a callable or region; raise if something of it does not last."""
    digest = hashlib.sha256()
    for part in _parts_of(reach):
        digest.update(hashlib.sha256(part).digest())
    return digest.hexdigest()


def _parts_of(reach: Any) -> Iterator[bytes]:
    """Yield what a callable or region consists of."""
    reach = getattr(reach, "py_func", reach)
    if isinstance(reach, partial):
        yield from _parts_of(reach.func)
        yield pickle.dumps((reach.args, sorted(reach.keywords.items())), protocol=4)
    elif isinstance(reach, MethodType):
        yield from _parts_of(reach.__func__)
        yield pickle.dumps(reach.__self__, protocol=4)
    elif isinstance(reach, FunctionType):
        if "<" in reach.__qualname__ or reach.__closure__ is not None:
            raise TypeError(f"{reach.__qualname__} does not last.")
        yield from _code_of(reach.__code__)
        yield pickle.dumps((reach.__defaults__, reach.__kwdefaults__), protocol=4)
    else:
        yield pickle.dumps(reach, protocol=4)
        for name in ("margin", "__call__"):
            function = getattr(type(reach), name, None)
            if isinstance(function, FunctionType):
                yield from _code_of(function.__code__)


def _code_of(code: CodeType) -> Iterator[bytes]:
    """Yield instructions, names and constants of compiled Python."""
    yield code.co_code
    yield repr(code.co_names).encode()
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _code_of(constant)
        elif isinstance(constant, frozenset):
            # the order of a set is another one in every process
            yield repr(sorted(map(repr, constant))).encode()
        else:
            yield repr(constant).encode()


def reach_margin(reach: Reach, positions: np.ndarray) -> np.ndarray:
    """Return the margin (n,) of positions (n, 3): mm for a region, +1 or -1 for a callable."""
    if hasattr(reach, "margin"):
        margin = np.asarray(reach.margin(positions), dtype=np.float64)
    else:
        margin = np.where(np.asarray(reach(positions), dtype=bool), 1.0, -1.0)
    if margin.shape != (len(positions),):
        raise RequestError.of_rule(
            "reach",
            f"must return one value per position, shape ({len(positions)},)",
            str(margin.shape),
        )
    return margin
