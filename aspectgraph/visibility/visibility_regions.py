"""Regions of many entities: exact visibility queries without a joint graph."""

from __future__ import annotations

import hashlib
import json
import math
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, TimeoutError, as_completed
from contextlib import contextmanager, suppress
from copy import copy
from functools import partial
from pathlib import Path
from typing import IO, Any, ClassVar, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from aspectgraph.cells.arrays import CellSet, Complex, Tree, cut_further, holds
from aspectgraph.cells.split import crop, leaves
from aspectgraph.entities.entity import Entity, Stretch, resolve_entities
from aspectgraph.exact.grid import Grid, as_points
from aspectgraph.exceptions import EntityError, WorkspaceError
from aspectgraph.files import code_digest
from aspectgraph.solid.solid import Solid, check_solid, kind_text
from aspectgraph.visibility.blocked_sets import blockers
from aspectgraph.visibility.entity_region import (
    Region,
    find_pieces,
    intersection,
    observable_region,
    overlay,
    share_planes,
)
from aspectgraph.visibility.scene import (
    Blockers,
    DeadlineError,
    Scene,
    cut_displacement_mm,
    make_scene,
    own_order,
)
from ground.shared import Shared
from ground.short_repr import count

# Visible regions kept in files as they are computed, so that an interrupted computation goes on
# where it was.
#
# One file per region, written whole or not at all. Its name is a digest of all that the region
# depends on, of the request and of the entity, so a file is never taken for another request's. In
# it is a digest of these and of the region. What is damaged, or no tree that compiled loops can
# walk, is computed again. A file beside them says which request they are of.


OWNER_FILE = "request.json"
_DIGEST = "digest"
_FIELDS = {
    "planes": (np.int64, 2),
    "plane": (np.int32, 1),
    "child": (np.int32, 2),
    "origin": (np.int32, 2),
    "observable": (np.bool_, 1),
}


class RegionStore(Protocol):
    """What is told of regions as they are computed, and may know some of them; an error it raises ends the work."""

    def begin(self, solid: Solid, box_mm: np.ndarray, entities: Mapping[str, Entity]) -> None:
        """Say what the regions depend on: part, workspace, and all entities."""

    def get(self, name: str) -> Region | None:
        """Return the region of an entity, if it is known."""

    def put(self, name: str, region: Region) -> None:
        """Take the region of an entity."""


class KeptRegions:
    """A folder of regions.

    Parameters
    ----------
    folder : path
        It is made with the first region. What cannot be written is not kept, and computed again another time; nor is
        anything read or written through a link in its place.
    request : mapping, optional
        What the regions are computed for, as plain values. Those of another request are not taken.
    """

    def __init__(
        self, folder: str | os.PathLike[str], request: Mapping[str, Any] | None = None
    ) -> None:
        self.folder = Path(folder)
        self._owner = "" if request is None else json.dumps(request, sort_keys=True)
        self._request = b""

    def __bool__(self) -> bool:
        """Whether there are any files, of whatever request."""
        return self.is_own_folder and any(self.folder.iterdir())

    @property
    def is_own_folder(self) -> bool:
        """Whether the folder is there, and no link to another one."""
        return self.folder.is_dir() and not self.folder.is_symlink()

    def owner(self) -> dict[str, Any] | None:
        """Return the request that the folder's regions are of, or None if nothing says so."""
        try:
            owner = json.loads((self.folder / OWNER_FILE).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        return owner if isinstance(owner, dict) else None

    def begin(self, solid: Solid, box_mm: np.ndarray, entities: Mapping[str, Entity]) -> None:
        """Say what the regions depend on: part, workspace, all entities, as they share a grid, and the program."""
        digest = hashlib.sha256(code_digest(("aspectgraph",)).encode())
        digest.update(self._owner.encode("utf-8", "surrogatepass"))
        for array in (solid.vertices, solid.triangles, box_mm):
            digest.update(np.ascontiguousarray(array).tobytes())
        for name, entity in entities.items():
            digest.update(
                repr((name, entity.kind, tuple(entity.edge_ids))).encode("utf-8", "surrogatepass")
            )
            digest.update(np.ascontiguousarray(entity.points, dtype=np.float64).tobytes())
        self._request = digest.digest()

    def get(self, name: str) -> Region | None:
        """Return the region of an entity, or None if there is none, or none that can be read."""
        if not self.is_own_folder:
            return None
        try:
            with self._path(name).open("rb") as file, np.load(file, allow_pickle=False) as data:
                digest = str(data[_DIGEST])
                arrays = {field: data[field] for field in _FIELDS}
        except Exception:
            # NumPy raises whatever its parsers do where bytes are damaged: the region is computed
            return None
        if not _has_form(arrays) or digest != self._digest(name, arrays):
            return None
        if not _is_tree(arrays):
            return None
        tree = Tree(arrays["planes"], arrays["plane"], arrays["child"])
        return Region(tree, arrays["origin"], arrays["observable"])

    def put(self, name: str, region: Region) -> None:
        """Keep the region of an entity, if that is possible."""
        with suppress(OSError):
            self._make_folder()
            arrays: dict[str, Any] = {
                **region.tree._asdict(),
                "origin": region.origin,
                "observable": region.observable,
            }
            arrays[_DIGEST] = np.array(self._digest(name, arrays))
            with _written_whole(self._path(name)) as file:
                np.savez(file, **arrays)

    def _make_folder(self) -> None:
        """Make the folder, if need be, and say whose it is before there is a region."""
        if self.folder.is_symlink():
            raise NotADirectoryError
        self.folder.mkdir(parents=True, exist_ok=True)
        owner = self.folder / OWNER_FILE
        if self._owner and not owner.exists():
            with _written_whole(owner) as file:
                file.write(self._owner.encode("utf-8", "surrogatepass"))

    def remove(self) -> None:
        """Delete the folder; of a link in its place nothing but the link."""
        if self.folder.is_symlink():
            with suppress(OSError):
                self.folder.unlink()
        shutil.rmtree(self.folder, ignore_errors=True)

    def _digest(self, name: str, arrays: Mapping[str, np.ndarray]) -> str:
        """Return the digest of a region, of what it depends on, and of its name."""
        digest = hashlib.sha256(self._request + name.encode("utf-8", "surrogatepass"))
        for field in _FIELDS:
            array = np.ascontiguousarray(arrays[field])
            digest.update(f"{field} {array.dtype.str} {array.shape}".encode())
            digest.update(array.tobytes())
        return digest.hexdigest()

    def _path(self, name: str) -> Path:
        text = name.encode("utf-8", "surrogatepass")
        return self.folder / f"{hashlib.sha256(self._request + text).hexdigest()[:40]}.npz"


def _has_form(arrays: Mapping[str, np.ndarray]) -> bool:
    """Return whether arrays have the types and axes of a region."""
    return all(
        arrays[field].dtype == kind and arrays[field].ndim == axes
        for field, (kind, axes) in _FIELDS.items()
    )


def _is_tree(arrays: Mapping[str, np.ndarray]) -> bool:
    """Return whether arrays are a binary tree with planes, so that compiled loops stay within them, and end.

    Each node has two children or none. A child comes after its parent, and has one parent.
    """
    planes = arrays["planes"]
    plane = arrays["plane"]
    child = arrays["child"]
    n = len(plane)
    shapes = {
        "planes": (len(planes), 4),
        "plane": (n,),
        "child": (n, 2),
        "origin": (len(planes), 4),
        "observable": (n,),
    }
    if n == 0 or any(arrays[field].shape != shape for field, shape in shapes.items()):
        return False
    inner = np.flatnonzero(plane >= 0)
    children = child[inner]
    in_range = bool((plane >= -1).all() and (plane < len(planes)).all())
    later = bool((children > inner[:, None]).all() and (children < n).all())
    return in_range and later and len(np.unique(children)) == children.size


@contextmanager
def _written_whole(path: Path) -> Iterator[IO[bytes]]:
    """Open a file that appears under its name when the block ends, or not at all."""
    handle, temporary = tempfile.mkstemp(dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            yield file
        os.replace(temporary, path)
    finally:
        Path(temporary).unlink(missing_ok=True)


Progress = Callable[[int, int, str], None]
_Regions = TypeVar("_Regions", bound="VisibilityRegions")
_Task = TypeVar("_Task")

_WORKSPACE_DIAGONALS = 10.0
# coverings kept for another call; one takes megabytes, and a plan asks for thousands
_COVERINGS_KEPT = 16


class VisibilityRegions:
    """The exact regions of viewpoints from which each entity is observable as a whole.

    `compute_regions` makes it.

    Parameters
    ----------
    scene : Scene
        The solid on its grid.
    regions : mapping of str to Region
        The region of each entity, on the same grid.

    Attributes
    ----------
    solid : Solid
        The part.
    workspace : ndarray, shape (2, 3)
        Lowest and highest corner of the viewpoint space in mm.
    entities : dict of str to Entity
        By name, in the order given.
    grid : Grid
        Integer grid of all geometry; ``grid.snapping_mm`` is the largest displacement of a vertex.
    listed_as : str
        Name of a graph's attribute for the list of a domain.
    """

    listed_as: ClassVar[str] = "observable"

    def __init__(
        self,
        solid: Solid,
        workspace: np.ndarray,
        entities: dict[str, Entity],
        grid: Grid,
        scene: Scene,
        regions: Mapping[str, Region],
    ) -> None:
        self.solid = solid
        self.workspace = workspace
        self.entities = entities
        self.grid = grid
        self._scene = scene
        self._regions: dict[str, Region] = dict(regions)
        self._covering: dict[tuple[str, ...], CellSet] = {}

    def __repr__(self) -> str:
        """Return a one-line summary."""
        n_entities = count(len(self.entities), "entity", "entities")
        snapped = f"vertices snapped by at most {self.grid.snapping_mm:.3g} mm"
        return f"<VisibilityRegions of {self.solid.name!r}: {n_entities}, {snapped}>"

    @property
    def entity_names(self) -> tuple[str, ...]:
        """Names of the entities, in order."""
        return tuple(self.entities)

    def observable(self, points: ArrayLike, names: Sequence[str] | None = None) -> np.ndarray:
        """Whether entities are observable from viewpoints.

        Parameters
        ----------
        points : array_like, shape (n, 3)
            Viewpoints in mm. They are rounded to 2**-20 of a grid step, and the answer for the
            rounded point is exact. On a partition surface, an entity is observable if it is so from
            either side.
        names : sequence of str, optional
            The entities. Default: all.

        Returns
        -------
        ndarray of bool, shape (n, k)
            One column per name; False inside the solid.

        Raises
        ------
        WorkspaceError
            If a point lies outside the workspace.
        EntityError
            If a name is unknown.
        """
        names = self.check_names(self.entity_names if names is None else names)
        queries = self._queries(points)
        result = np.empty((len(queries), len(names)), bool)
        for column, name in enumerate(names):
            region = self._regions[name]
            result[:, column] = holds(region.tree, region.observable, queries)
        return result

    def observable_where(
        self, points: ArrayLike, names: Sequence[str], wanted: np.ndarray
    ) -> np.ndarray:
        """Whether entities are observable from viewpoints, for chosen pairs only.

        For many entities, of which each viewpoint needs few, this is much faster than `observable`.

        Parameters
        ----------
        points : array_like, shape (n, 3)
            Viewpoints in mm.
        names : sequence of str
            The entities.
        wanted : ndarray of bool, shape (n, k)
            Pairs of viewpoint and entity to answer.

        Returns
        -------
        ndarray of bool, shape (n, k)
            As of `observable`. False for all other pairs.

        Raises
        ------
        WorkspaceError
            If a point lies outside the workspace.
        EntityError
            If a name is unknown.
        """
        names = self.check_names(names)
        queries = self._queries(points)
        result = np.zeros(wanted.shape, bool)
        for column in np.flatnonzero(wanted.any(axis=0)).tolist():
            region = self._regions[names[column]]
            rows = np.flatnonzero(wanted[:, column])
            result[rows, column] = holds(region.tree, region.observable, queries[rows])
        return result

    def covering_cells(self, names: Sequence[str]) -> CellSet:
        """Viewpoints from which all named entities are observable, as convex cells.

        Parameters
        ----------
        names : sequence of str
            Names of entities, at least one.

        Returns
        -------
        CellSet
            Empty if no viewpoint observes them all.

        Raises
        ------
        EntityError
            If a name is unknown, or none is given.
        """
        names = self.check_names(names)
        if not names:
            raise EntityError.of_rule("names", "must hold at least one entity", "none")
        key = tuple(sorted(set(names)))
        covering = self._covering.pop(key, None)
        if covering is None:
            order = own_order(self._scene, self.solid, [self.entities[name] for name in key])
            regions = [self._regions[key[k]] for k in order]
            shared = share_planes(regions, self._scene, self.grid.cube_planes(self.workspace))
            limits = self.grid.box_planes(self.workspace)
            cube_cells = overlay(regions, shared.extended(limits), covering_only=True)
            first = len(shared.planes)

            def cut(cells: Complex) -> None:
                crop(cells, first)
                # what follows asks for the leaves again, and must not need more room
                leaves(cells)

            cx = cut_further(cube_cells, cut)
            present = leaves(cx)
            bits = np.unpackbits(cx.label[present].view(np.uint8), axis=1, bitorder="little")[
                :, : len(key)
            ]
            covering = CellSet(cx, present[bits.all(axis=1)], self.grid)
        # the last one asked for comes last, the first one goes
        self._covering[key] = covering
        while len(self._covering) > _COVERINGS_KEPT:
            del self._covering[next(iter(self._covering))]
        return covering

    def subset(self: _Regions, names: Sequence[str]) -> _Regions:
        """The same regions for some of the entities.

        Parameters
        ----------
        names : sequence of str
            Names of the entities to keep, in the order wanted.

        Returns
        -------
        VisibilityRegions
            On the same grid and in the same workspace.

        Raises
        ------
        EntityError
            If a name is unknown.
        """
        names = self.check_names(names)
        part = copy(self)
        part.entities = {name: self.entities[name] for name in names}
        part._regions = {name: self._regions[name] for name in names}
        part._covering = {}
        return part

    @property
    def cutting_mm(self) -> float:
        """Largest distance of a stretch's end on the grid from its share of the edge there, in mm; 0 without any."""
        stretches = [e.part for e in self.entities.values() if isinstance(e.part, Stretch)]
        return max(
            (
                cut_displacement_mm(self.solid, self._scene.points, part, self.grid.steps_mm)
                for part in stretches
            ),
            default=0.0,
        )

    def _sets(self, entity: Entity) -> Blockers:
        """Return the blocked sets whose complement an entity's region is."""
        return blockers(self._scene, self.solid, entity)

    def _holds_besides(self, points: np.ndarray) -> np.ndarray:
        """Return, in doubles, which points (n, 3) are in each region (n, k) if rays to the entity arrive: here all."""
        return np.ones((len(points), len(self.entities)), bool)

    def check_names(self, names: Sequence[str]) -> tuple[str, ...]:
        """Check that all names are known.

        Parameters
        ----------
        names : sequence of str
            Names of entities.

        Returns
        -------
        tuple of str
            The same names in the same order.

        Raises
        ------
        EntityError
            If a name is unknown.
        """
        for name in names:
            if name not in self.entities:
                raise EntityError.of_rule(
                    "names", f"must be names of entities, {', '.join(self.entities)}", repr(name)
                )
        return tuple(names)

    def _queries(self, points: ArrayLike) -> np.ndarray:
        viewpoints = as_points(points)
        outside = ~((viewpoints >= self.workspace[0]) & (viewpoints <= self.workspace[1])).all(
            axis=1
        )
        if outside.any():
            raise WorkspaceError.of_rule(
                "points",
                f"must lie in the workspace {self.workspace[0].tolist()} to "
                f"{self.workspace[1].tolist()} mm",
                f"{viewpoints[outside][0].tolist()} ({int(outside.sum())} outside)",
            )
        return self.grid.to_points(viewpoints)


def check_regions(regions: object) -> None:
    """Refuse what is no `VisibilityRegions`.

    Parameters
    ----------
    regions : object
        What was given.

    Raises
    ------
    EntityError
        If they are none.
    """
    if not isinstance(regions, VisibilityRegions):
        rule = "must be VisibilityRegions"
        hint = "compute_regions makes them"
        raise EntityError.of_rule("regions", rule, kind_text(regions), hint=hint)


def check_workspace(workspace: ArrayLike | None, solid: Solid) -> np.ndarray:
    """Return a workspace as a (2, 3) array in mm; None gives the part's box with ten diagonals of room around it.

    Raises
    ------
    WorkspaceError
        If it is not a finite box.
    """
    if workspace is None:
        low, high = solid.bounds
        room = _WORKSPACE_DIAGONALS * np.linalg.norm(high - low)
        return np.array([low - room, high + room])
    box = np.asarray(workspace, float)
    if box.shape != (2, 3):
        raise WorkspaceError.of_rule(
            "workspace", "must have shape (2, 3), its two corners", f"shape {box.shape}"
        )
    if not (np.isfinite(box).all() and (box[0] < box[1]).all()):
        raise WorkspaceError.of_rule(
            "workspace", "must be finite, lower corner first", str(box.tolist())
        )
    return box


def compute_regions(
    solid: Solid,
    entities: Mapping[str, Any] | Sequence[Any],
    workspace: ArrayLike | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    kept: RegionStore | None = None,
    deadline: float = math.inf,
) -> VisibilityRegions:
    """Compute the viewpoints from which each entity is observable.

    Parameters
    ----------
    solid : Solid
        The part.
    entities : mapping of str to edge id, id of a rim or arc, or pair of points, or sequence of ids
        See `resolve_entities`. Resolved entities are used without change.
    workspace : array_like, shape (2, 3), optional
        Corners of the viewpoint space in mm. Default: the part's box,
        extended by ten diagonals in all directions.
    executor : concurrent.futures.Executor, optional
        Computes entities in parallel. The result does not depend on it.
    progress : callable, optional
        ``progress(done, total, label)`` after each of the entities; the label is the name of the entity.
    kept : RegionStore, optional
        A store such as `KeptRegions`. It returns regions of an earlier call with the same
        arguments, and stores the new ones.
    deadline : float
        Time, as `time.time` gives it, at which the computation ends. Default: never.

    Returns
    -------
    VisibilityRegions
        In the order of the entities. Entities whose region is not complete by the deadline are
        missing. The same arguments give the same regions, with or without an executor.

    Raises
    ------
    EntityError
        If an entity is not a sharp straight edge, rim or arc.
    WorkspaceError
        If the workspace is not a box around the part.

    Examples
    --------
    >>> from aspectgraph import compute_regions, read_solid
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> rim = {"e1": [[60, 20, 10], [60, 40, 10]], "e4": [[20, 60, 10], [40, 60, 10]]}
    >>> regions = compute_regions(block, rim)
    >>> regions.observable([[200, 30, 20], [200, 200, 20], [30, 30, -50]]).tolist()
    [[True, False], [True, True], [False, False]]
    """
    layout = laid_out(solid, entities, workspace)
    solid, box_mm, resolved, grid, scene = layout
    make = partial(observable_region, scene, solid, box=grid.cube_planes(box_mm), deadline=deadline)
    if kept is not None:
        kept.begin(solid, box_mm, resolved)
    shared = partial(intersection, scene, grid.cube_planes(box_mm), deadline=deadline)
    means = _Means(executor, progress, kept, deadline)
    regions = _with_pieces(solid, resolved, (make, shared), means)
    complete = {name: entity for name, entity in resolved.items() if name in regions}
    return VisibilityRegions(solid, box_mm, complete, grid, scene, regions)


class _Means(NamedTuple):
    """What regions are made by, reported to and stored in, and until when."""

    executor: Executor | None
    progress: Progress | None
    store: RegionStore | None
    deadline: float


def _with_pieces(
    solid: Solid,
    entities: Mapping[str, Entity],
    makers: tuple[Callable[[Entity], Region], Callable[[Sequence[Region]], Region]],
    means: _Means,
) -> dict[str, Region]:
    """Make the regions of entities: of what consists of pieces by the second maker, from theirs."""
    make, join = makers
    executor, progress, store, deadline = means
    composed, hidden = find_pieces(solid, entities)
    if store is not None:
        composed = {name: parts for name, parts in composed.items() if store.get(name) is None}
    piece_names = {piece for parts in composed.values() for piece in parts}
    hidden = {name: piece for name, piece in hidden.items() if name in piece_names}
    direct = {name: entity for name, entity in entities.items() if name not in composed}
    total = len(entities) + len(hidden)

    def report_after(n: int) -> Progress | None:
        return progress and (lambda done, _, label: progress(n + done, total, label))

    regions = regions_of(direct, make, executor, report_after(0), store, deadline)
    pieces = regions_of(hidden, make, executor, report_after(len(regions)), deadline=deadline)
    by_name = {**regions, **pieces}
    todo = {
        name: [by_name[piece] for piece in parts]
        for name, parts in composed.items()
        if all(piece in by_name for piece in parts)
    }
    regions |= regions_of(todo, join, executor, report_after(len(by_name)), store, deadline)
    return {name: regions[name] for name in entities if name in regions}


def laid_out(
    solid: Solid, entities: Mapping[str, Any] | Sequence[Any], workspace: ArrayLike | None
) -> tuple[Solid, np.ndarray, dict[str, Entity], Grid, Scene]:
    """Return what regions are computed from: solid, workspace, resolved entities, grid and scene, all checked."""
    check_solid(solid)
    if isinstance(entities, Mapping) and all(
        isinstance(value, Entity) for value in entities.values()
    ):
        resolved = dict(entities)
    else:
        resolved = resolve_entities(solid, entities)
    box_mm = check_workspace(workspace, solid)
    grid, scene = make_scene(solid, resolved)
    grid.box_planes(box_mm)
    return solid, box_mm, resolved, grid, scene


def regions_of(
    entities: Mapping[str, _Task],
    make: Callable[[_Task], Region],
    executor: Executor | None = None,
    progress: Progress | None = None,
    kept: RegionStore | None = None,
    deadline: float = math.inf,
) -> dict[str, Region]:
    """Make the region of each entity, or of what names one, in parallel if there is an executor.

    Returns
    -------
    dict of str to Region
        In the order of the entities; without those that are not made by the deadline, which `make` knows, too.
    """
    report = progress or (lambda done, total, label: None)
    earlier = {} if kept is None else {name: kept.get(name) for name in entities}
    regions: dict[str, Region] = {
        name: region for name, region in earlier.items() if region is not None
    }
    todo = {name: entity for name, entity in entities.items() if name not in regions}

    def take(name: str, get: Callable[[], Region]) -> None:
        try:
            region = get()
        except DeadlineError:
            return
        regions[name] = region
        if kept is not None:
            kept.put(name, region)
        report(len(regions), len(entities), name)

    if executor is None:
        for name, entity in todo.items():
            take(name, partial(make, entity))
        return {name: regions[name] for name in entities if name in regions}
    shared = Shared(make)
    futures = {executor.submit(_made, shared, entity): name for name, entity in todo.items()}
    remaining_s = None if deadline == math.inf else max(deadline - time.time(), 0.0)
    try:
        for future in as_completed(futures, remaining_s):
            take(futures[future], future.result)
    except TimeoutError:
        # what a worker still makes ends by itself, and is not waited for
        pass
    finally:
        for future in futures:
            future.cancel()
    return {name: regions[name] for name in entities if name in regions}


def _made(shared: Shared, task: Any) -> Region:
    region: Region = shared.value(task)
    return region
