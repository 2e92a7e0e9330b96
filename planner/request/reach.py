"""Signed distance to solids, and the regions a robot can reach.

A region is anything with ``margin(positions) -> (n,)``: the distance in mm to its boundary, positive inside. A plain
``callable(positions) -> (n,) bool`` is accepted wherever a region is, which is where inverse kinematics goes. A plan
that is to be resumed tells regions apart by `reach_identity`; a region or callable of your own may have an attribute
``state_name`` that says what it permits.
"""

from __future__ import annotations

import hashlib
import math
import pickle
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import CodeType, FunctionType, MethodType
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from aspectgraph.solid.solid import RayScene
from ground.convert import Plain
from planner.argument_kinds import POSITIVE, check_number
from planner.exceptions import RequestError

if TYPE_CHECKING:
    from aspectgraph import CellSet, Solid
    from planner.request.targets import Target


# Where entities are observable from, as far as a request asks for it.


class Space(Protocol):
    """Where entities are observable from: `VisibilityRegions` or `EntityAspectGraph` of the package `aspectgraph`.

    Attributes
    ----------
    solid : Solid
        The part.
    workspace : array (2, 3)
        Lowest and highest corner of where the camera may be, mm.
    entities : mapping of str to Entity
        The entities by name, in order; ``entity_names`` are their names.
    """

    @property
    def solid(self) -> Solid:
        """The part."""

    @property
    def workspace(self) -> np.ndarray:
        """Corners of the box the camera may be in, (2, 3), mm."""

    @property
    def entities(self) -> Mapping[str, Any]:
        """The entities by name."""

    @property
    def entity_names(self) -> tuple[str, ...]:
        """Names of the entities, in order."""

    def observable(self, points: np.ndarray, names: Sequence[str] | None = None) -> np.ndarray:
        """Return which entities are observable from which viewpoints (n, 3); (n, k) bool."""

    def covering_cells(self, names: Sequence[str]) -> CellSet:
        """Return from where all named entities are observable, as convex cells."""


def observable_where(
    space: Space, points: np.ndarray, names: Sequence[str], wanted: np.ndarray
) -> np.ndarray:
    """Return which of the wanted pairs of viewpoints (n, 3) and entities hold; (n, k), False where it is not asked."""
    if hasattr(space, "observable_where"):
        return np.asarray(space.observable_where(points, names, wanted))
    result = np.zeros(wanted.shape, dtype=bool)
    for column in np.flatnonzero(wanted.any(axis=0)).tolist():
        rows = np.flatnonzero(wanted[:, column])
        result[rows, column] = space.observable(points[rows], [names[column]])[:, 0]
    return result


def cells_of(space: Space, names: Sequence[str]) -> CellSet:
    """Return the covering cells of entities (`CellSet`) without leaving them in the space's memory.

    A space remembers cells it was asked for. For a hundred entities those would be gigabytes, and no request here comes
    twice.
    """
    return (space.subset(names) if hasattr(space, "subset") else space).covering_cells(names)


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
        distance = _distances.get(solid)
    except TypeError:
        # a part of somebody's own, that cannot be a key
        return SignedDistance(solid.vertices, solid.triangles)
    if distance is None:
        distance = SignedDistance(solid.vertices, solid.triangles)
        _distances[solid] = distance
    return distance


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


@dataclass(frozen=True)
class StatedRegion:
    """A region that a file can only name: its name or digest tells it from others, and no pose can be checked by it.

    Attributes
    ----------
    values : mapping of str to value
        As `reach_identity` returns them.
    """

    values: Mapping[str, Any]

    @property
    def state_name(self) -> str:
        """What it permits, where that is known."""
        return str(self.values.get("state_name", ""))

    def margin(self, positions: np.ndarray) -> np.ndarray:
        """Refuse to say whether positions are in it.

        Raises
        ------
        RequestError
            Always.
        """
        raise RequestError(f"{self.rule}.")

    @property
    def rule(self) -> str:
        """What is wrong with it."""
        got = self.values.get("kind") or next(iter(self.values.values()), "nothing")
        return f"reach must be a box or a ball to be in a file. Got {got}"


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
    if isinstance(reach, StatedRegion):
        return dict(reach.values)
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


def reach_from(values: Mapping[str, Any] | None) -> Reach | None:
    """Return the region that `reach_identity` states: a box, a ball, or one that is only known by its name."""
    kinds: dict[str, Any] = {"BoxRegion": BoxRegion, "SphereRegion": SphereRegion}
    if values is None:
        return None
    if values.get("kind") not in kinds:
        return StatedRegion(values)
    return kinds[values["kind"]](**{key: item for key, item in values.items() if key != "kind"})


PlainReach = Plain(reach_identity, reach_from)
"""How requests state regions."""


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


# Where targets are observable from: where all entities of any of their witnesses are.


class Seen(NamedTuple):
    """What must be seen of a target.

    Attributes
    ----------
    witnesses : sequence of sequence of str
        Names of entities; those of any witness suffice, together.
    endpoints : array (2, 3)
        Two points that are seen wherever the first witness is inspected, as an edge's ends are; mm.
    """

    witnesses: Sequence[Sequence[str]]
    endpoints: NDArray[np.float64]

    def is_entity(self, name: str) -> bool:
        """Return whether this is one entity, of this name."""
        return len(self.witnesses) == 1 and tuple(self.witnesses[0]) == (name,)


class TargetSpace:
    """The regions of targets, made of the regions of their entities.

    Parameters
    ----------
    space : VisibilityRegions or EntityAspectGraph
        Where the entities are observable from.
    entities : mapping of str to Seen
        What must be seen of each target, by its name.
    """

    def __init__(self, space: Space, entities: Mapping[str, Seen]):
        self.space = space
        self.entities = dict(entities)

    @classmethod
    def of(cls, space: Space, targets: Iterable[Target]) -> TargetSpace:
        """Return where targets are observable from that were resolved on the part."""
        return cls(
            space,
            {
                target.name: Seen(
                    [witness.entities for witness in target.witnesses],
                    target.witnesses[0].ends,
                )
                for target in targets
            },
        )

    @classmethod
    def of_plan(cls, space: Space, plan: Any) -> TargetSpace:
        """Return where a plan's targets are observable from, without those whose regions the space does not hold."""
        if isinstance(space, TargetSpace):
            return space
        names = set(space.entity_names)
        return cls(
            space,
            {
                name: Seen(target.ways, plan.entities[name])
                for name, target in plan.targets.items()
                if all(names.issuperset(way) for way in target.ways)
            },
        )

    @property
    def nearby(self) -> TargetSpace:
        """The space that is asked of the points around a viewpoint, see `nearby_space`."""
        near = nearby_space(self.space)
        return self if near is self.space else TargetSpace(near, self.entities)

    @property
    def solid(self) -> Solid:
        """The part."""
        return self.space.solid

    @property
    def workspace(self) -> NDArray[np.float64]:
        """Lowest and highest corner of where the camera may be, mm; (2, 3)."""
        return self.space.workspace

    @property
    def entity_names(self) -> tuple[str, ...]:
        """Names of the targets, in order."""
        return tuple(self.entities)

    def observable(
        self, points: NDArray[np.float64], names: Sequence[str] | None = None
    ) -> NDArray[np.bool_]:
        """Return which targets are observable from which viewpoints (n, 3); (n, k) bool."""
        names = self.entity_names if names is None else names
        entities = self.entities_of(names)
        column = {name: i for i, name in enumerate(entities)}
        seen = self.space.observable(points, entities)
        if all(self.entities[name].is_entity(name) for name in names):
            return seen
        result = np.zeros((len(seen), len(names)), dtype=bool)
        for k, name in enumerate(names):
            for witness in self.entities[name].witnesses:
                result[:, k] |= seen[:, [column[entity] for entity in witness]].all(axis=1)
        return result

    def observable_where(
        self, points: NDArray[np.float64], names: Sequence[str], wanted: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        """Return which wanted pairs of viewpoints (n, 3) and targets hold; (n, k), False where it is not asked."""
        entities = self.entities_of(names)
        if all(self.entities[name].is_entity(name) for name in names):
            return observable_where(self.space, points, entities, wanted)
        column = {name: i for i, name in enumerate(entities)}
        pairs = np.zeros((len(wanted), len(entities)), dtype=bool)
        for k, name in enumerate(names):
            for entity in self.entities_of([name]):
                pairs[:, column[entity]] |= wanted[:, k]
        seen = observable_where(self.space, points, entities, pairs)
        result = np.zeros_like(wanted)
        for k, name in enumerate(names):
            for witness in self.entities[name].witnesses:
                result[:, k] |= seen[:, [column[entity] for entity in witness]].all(axis=1)
        return result & wanted

    def covering_cells(self, names: Sequence[str]) -> CellSet:
        """Return from where all named targets are observable, as convex cells; each has one witness."""
        for name in names:
            (_,) = self.entities[name].witnesses
        return self.space.covering_cells(self.entities_of(names))

    def entities_of(self, names: Sequence[str]) -> list[str]:
        """Return the entities of targets, each once, in order."""
        return list(
            dict.fromkeys(
                entity
                for name in names
                for witness in self.entities[name].witnesses
                for entity in witness
            )
        )

    def choosing(self, chosen: Mapping[str, int]) -> TargetSpace:
        """Return the space in which some targets are observable by one of their witnesses only, given by number."""
        return TargetSpace(
            self.space,
            {
                name: seen._replace(witnesses=[seen.witnesses[chosen[name]]])
                if name in chosen
                else seen
                for name, seen in self.entities.items()
            },
        )

    def subset(self, names: Sequence[str]) -> TargetSpace:
        """Return the space of some targets only; it remembers no cells of the whole."""
        entities = self.entities_of(names)
        space = self.space.subset(entities) if hasattr(self.space, "subset") else self.space
        return TargetSpace(space, {name: self.entities[name] for name in names})


def nearby_space(space: Space) -> Space:
    """Return the space that is asked of the points around a viewpoint of a space.

    What faces hide changes at once, and is asked of all of them. The light that a camera carries moves with it by a
    fraction of a millimetre: the viewpoint alone is asked, and the pose that is chosen is checked by more rays.
    """
    near: Space = getattr(space, "nearby", space)
    return near


def entity_space(space: Space) -> Space:
    """Return the space of entities below a space of targets; a space of entities is itself."""
    return space.space if isinstance(space, TargetSpace) else space


# Where the front nodal point may be: which entities are visible from there, and how far part and
# walls are.
#
# Positions (n, 3) are in the part's frame, mm; what is returned are slacks as
# `planner.request.constraints` describes them.


# the axes, and the diagonals of a cube: around a position, an entity must be visible in these directions
_DIAGONALS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / math.sqrt(3)
AROUND = np.vstack([np.eye(3), -np.eye(3), _DIAGONALS])
_AND_HERE = np.vstack([np.zeros(3), AROUND])
# up to so many poses, one question for them and the points around them is cheaper than two
FEW = 40
# pairs of viewpoint and entity that are asked for at a time
_PAIRS = 10_000_000


def visibility_slacks(
    space: Space, positions: np.ndarray, names: Sequence[str], radius_mm: float = 0.0
) -> np.ndarray:
    """+1 where an entity is observable from a position and all around it, else -1; (n, k, 1).

    All around it are 14 points at `radius_mm`: along the axes and the diagonals of the part's frame. Outside the
    workspace nothing is observable.
    """
    near = nearby_space(space)
    if radius_mm > 0 and len(positions) <= FEW and near is space:
        return np.where(
            _observable_around(space, positions, names, radius_mm, _AND_HERE), 1.0, -1.0
        )[..., None]
    visible = _observable(space, positions, names)
    rows = np.flatnonzero(visible.any(axis=1))
    if radius_mm > 0 and rows.size:
        visible[rows] &= _observable_around(near, positions[rows], names, radius_mm, AROUND)
    return np.where(visible, 1.0, -1.0)[..., None]


def _observable_around(
    space: Space, positions: np.ndarray, names: Sequence[str], radius_mm: float, around: np.ndarray
) -> np.ndarray:
    """Return which entities are observable from all points around positions; (n, k)."""
    # all points in one call: asking costs more than answering
    eyes = positions[:, None] + radius_mm * around
    visible = _observable(space, eyes.reshape(-1, 3), names).reshape(
        len(positions), len(around), -1
    )
    return np.asarray(visible.all(axis=1))


def _observable(space: Space, positions: np.ndarray, names: Sequence[str]) -> np.ndarray:
    low, high = (np.asarray(corner, dtype=float) for corner in space.workspace)
    inside = ((positions >= low) & (positions <= high)).all(axis=-1)
    visible = np.zeros((len(positions), len(names)), bool)
    visible[inside] = space.observable(positions[inside], names)
    return visible


def visible_where(
    space: Space,
    positions: np.ndarray,
    names: Sequence[str],
    wanted: np.ndarray,
    radius_mm: float = 0.0,
) -> np.ndarray:
    """Return which of the wanted pairs (n, k) are observable, also from all around, as `visibility_slacks` finds it."""
    visible = _observable_where(space, positions, names, wanted)
    rows = np.flatnonzero(visible.any(axis=1)) if radius_mm > 0 else np.zeros(0, np.intp)
    near = nearby_space(space)
    # so many rows at a time, for the memory
    size = max(1, _PAIRS // (len(AROUND) * max(1, len(names))))
    for first in range(0, len(rows), size):
        chunk = rows[first : first + size]
        eyes = (positions[chunk, None] + radius_mm * AROUND).reshape(-1, 3)
        pairs = np.repeat(visible[chunk], len(AROUND), axis=0)
        around = _observable_where(near, eyes, names, pairs)
        visible[chunk] = around.reshape(len(chunk), len(AROUND), -1).all(axis=1)
    return visible


def _observable_where(
    space: Space, positions: np.ndarray, names: Sequence[str], wanted: np.ndarray
) -> np.ndarray:
    low, high = (np.asarray(corner, dtype=float) for corner in space.workspace)
    inside = ((positions >= low) & (positions <= high)).all(axis=-1)
    rows = np.flatnonzero(inside & wanted.any(axis=1))
    visible = np.zeros(wanted.shape, bool)
    visible[rows] = observable_where(space, positions[rows], names, wanted[rows])
    return visible


def clearance_slacks(
    distance: Callable[[np.ndarray], np.ndarray], positions: np.ndarray, stand_off_mm: float
) -> np.ndarray:
    """Signed distance from the part less the stand-off, mm; (n, 1, 1). `distance` maps (n, 3) to (n,)."""
    return (distance(positions) - stand_off_mm)[:, None, None]


def workspace_slacks(workspace: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Distance from the six walls of the workspace box, mm, positive inside; (n, 1, 6)."""
    low, high = (np.asarray(corner, dtype=float) for corner in workspace)
    return np.concatenate([positions - low, high - positions], axis=-1)[:, None, :]


def enclosing_sphere(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Return centre (3,) and radius of a sphere around points (m, 3), close to the smallest one.

    The centre walks towards the farthest point by ever smaller steps (Bădoiu & Clarkson 2003); the best one is kept.
    The radius is exact for that centre, so no point is ever outside.
    """
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    best = centre
    radius = np.inf
    for step in range(2, 300):
        distances = np.linalg.norm(points - centre, axis=-1)
        if distances.max() < radius:
            best = centre
            radius = float(distances.max())
        centre = centre + (points[np.argmax(distances)] - centre) / step
    return best, radius
