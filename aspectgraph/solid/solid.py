"""A solid with planar faces, and rays cast at it."""

from __future__ import annotations

import json
import math
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from importlib.util import find_spec
from itertools import starmap
from numbers import Real
from operator import attrgetter
from os import PathLike
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from aspectgraph.exceptions import EntityError, SolidError
from aspectgraph.files import SolidEntry
from aspectgraph.phases import phase
from aspectgraph.solid.checks import (
    check_areas,
    check_contacts,
    check_indices,
    check_planarity,
    check_shells,
    check_vertices,
    default_planarity_mm,
    face_area_vectors,
)
from aspectgraph.solid.rims import (
    SHARP_DEG,
    Arc,
    CircularEdge,
    EdgeEnd,
    Rim,
    edges_at_vertices,
    find_arcs,
    find_edge_ends,
)
from aspectgraph.solid.topology import (
    Edge,
    Face,
    FaceLoops,
    as_face,
    check_fans,
    is_index,
    label_shells,
    pair_edges,
    signed_dihedrals_deg,
    signed_volume,
    triangulate_faces,
)
from ground.notebook import NotebookTable, NotebookView, ShownInNotebook

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

PLOTLY = "application/vnd.plotly.v1+json"
"""MIME type of a figure that notebooks draw in 3-D without loading anything."""

_FIGURE_PX = 420

# Rays against triangles, with Open3D: the one place that builds its scene.
#
# Rays are float32: about 10⁻⁷ of the part's size. That is for confirming, looking and keeping
# clear of things; what is observable is decided exactly, by the regions.


class RayScene:
    """Triangles that rays are cast at.

    Parameters
    ----------
    vertices : array_like, shape (v, 3)
        Corners, mm.
    triangles : array_like of int, shape (t, 3)
        Vertex numbers, outward counter-clockwise.
    n_threads : int
        Threads for each call; 0: one for each processor.

    Attributes
    ----------
    centre : array (3,)
        Where the triangles' own frame has its origin, mm.
    """

    def __init__(self, vertices: ArrayLike, triangles: ArrayLike, n_threads: int = 0) -> None:
        with _existing_folder(), _dash_later(), _without_web_visualizer():
            import open3d as o3d

        corners = np.asarray(vertices, dtype=np.float64)
        # float32 loses digits far from the origin, so everything is computed around the triangles' own centre
        self.centre = (corners.min(axis=0) + corners.max(axis=0)) / 2
        self._n_threads = n_threads
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=n_threads)
        self._scene.add_triangles(_packed(corners - self.centre), _packed(triangles, np.uint32))

    def cast(self, origins: ArrayLike, directions: np.ndarray) -> dict[str, np.ndarray]:
        """Return what each ray hits first.

        Parameters
        ----------
        origins : array_like
            Where rays start, mm; broadcasts against `directions`.
        directions : ndarray, shape (..., 3)
            Where they go; the length is the unit of ``t_hit``.

        Returns
        -------
        dict of str to ndarray
            ``t_hit``: lengths to the hit, inf without one; ``primitive_ids``: the triangle, the largest uint32 without
            one; ``primitive_normals``: its unit normal. Shapes (...) and (..., 3).
        """
        hits = self._scene.cast_rays(self._rays(origins, directions), nthreads=self._n_threads)
        return {key: hits[key].numpy() for key in ("t_hit", "primitive_ids", "primitive_normals")}

    def blocked(self, origins: ArrayLike, directions: np.ndarray, up_to: float = 1.0) -> np.ndarray:
        """Return which rays hit anything on their way; in half the time of `cast`, as the first hit need not be found.

        Parameters
        ----------
        origins, directions : array_like
            See `cast`.
        up_to : float
            How far they go, in lengths of the directions.

        Returns
        -------
        ndarray of bool, shape (...)
        """
        return self.are_blocked(self._rays(origins, directions), up_to)

    def are_blocked(self, rays: np.ndarray, up_to: float = 1.0) -> np.ndarray:
        """Return what `blocked` does for rays that are ready.

        Parameters
        ----------
        rays : ndarray of float32, shape (..., 6)
            Where they start, from `centre`, and where they go.
        up_to : float
            How far they go, in lengths of the directions.
        """
        packed: Any = rays
        hits = self._scene.test_occlusions(packed, 0.0, up_to, nthreads=self._n_threads)
        return np.asarray(hits.numpy())

    def _rays(self, origins: ArrayLike, directions: np.ndarray) -> Any:
        rays = np.empty((*directions.shape[:-1], 6), dtype=np.float32)
        rays[..., :3] = np.asarray(origins, dtype=np.float64) - self.centre
        rays[..., 3:] = directions
        return rays

    def signed_distance(self, points: ArrayLike) -> np.ndarray:
        """Return the distance (n,) in mm of points (n, 3) to a closed surface, negative inside."""
        local = _packed(np.asarray(points, dtype=np.float64) - self.centre)
        if not len(local):
            return np.empty(0)
        distance = self._scene.compute_signed_distance(local, nsamples=3, nthreads=self._n_threads)
        return np.asarray(distance.numpy(), dtype=np.float64)


def _packed(array: ArrayLike, dtype: type[np.generic] = np.float32) -> Any:
    """Return an array as Open3D takes it; its stubs know tensors only."""
    return np.ascontiguousarray(array, dtype=dtype)


@contextmanager
def _existing_folder() -> Iterator[None]:
    """Leave the current folder for the block if it is deleted; Open3D ends the process there as it loads."""
    try:
        os.getcwd()
    except OSError:
        pass
    else:
        yield
        return
    # a deleted folder has no name to return to, but a handle
    deleted = os.open(".", os.O_RDONLY)
    os.chdir(os.sep)
    try:
        yield
    finally:
        os.fchdir(deleted)
        os.close(deleted)


class _Dash(ModuleType):
    """The module dash, or a name in it: loaded when it is called, until then names are names only."""

    def __getattr__(self, name: str) -> _Dash:
        if name.startswith("__"):
            raise AttributeError(name)
        return _Dash(f"{self.__name__}.{name}")

    def __call__(self, *arguments: Any, **keywords: Any) -> Any:
        import dash

        return attrgetter(self.__name__.partition(".")[2])(dash)(*arguments, **keywords)


@contextmanager
def _dash_later() -> Iterator[None]:
    """Put dash off, a web server that Open3D imports in the block; loading it takes longer than all else of Open3D.

    The one function that needs it, which shows a figure in a browser, still works.
    """
    if "dash" in sys.modules or find_spec("dash") is None:
        yield
        return
    sys.modules["dash"] = _Dash("dash")
    try:
        yield
    finally:
        # whoever imports it from here on gets it
        del sys.modules["dash"]


@contextmanager
def _without_web_visualizer() -> Iterator[None]:
    """Keep Open3D from enabling its web viewer, and from saying so, where it is imported in a notebook."""
    name = "OPEN3D_DISABLE_WEB_VISUALIZER"
    before = os.environ.get(name)
    os.environ.setdefault(name, "true")
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]


# The solid: a closed, oriented surface of planar faces.
#
# Rules
# -----
# * Coordinates are finite; loops have at least three distinct vertices; every edge is traversed exactly once in each
#   direction; around every vertex the faces form one fan.
# * Faces are planar to within ``planarity_mm`` and have an area. Loops may hold collinear vertices.
# * Faces run counter-clockwise seen from outside. Several disjoint solids and closed voids are
#   legal; solids that overlap
#   or touch, and surfaces that cross themselves, are not.


# Which solids of a file a `Solid` was read from.


class FileSolids(NamedTuple):
    """Solids of a STEP file, by their numbers.

    Attributes
    ----------
    measured : tuple of int
        Solids whose edges can be entities, counted from 0 in the order of the file.
    occluders : tuple of int
        Solids that only stand in the way.
    entries : tuple of SolidEntry
        All solids of the file. Empty if it holds one solid, which nobody named.
    n_faces : int
        Faces of the CAD model, of all solids that were read. Without those of which the file states facets only.
    """

    measured: tuple[int, ...]
    occluders: tuple[int, ...]
    entries: tuple[SolidEntry, ...] = ()
    n_faces: int = 0

    @property
    def is_choice(self) -> bool:
        """Whether some solids of the file are left out, or only stand in the way: others give the edges other ids."""
        return bool(self.occluders) or len(self.measured) < len(self.entries)


# characters of a wrong argument that an error repeats
_LONGEST = 40
_EDGE_TEXT = re.compile(r"e\d{1,300}", re.ASCII)


class Solid(ShownInNotebook):
    """A polyhedral solid: the part to inspect.

    Parameters
    ----------
    vertices : array_like, shape (n, 3)
        Coordinates in mm.
    faces : iterable
        Each is a loop of vertex indices, ``(outer loop, [hole, ...])`` or a `Face`,
        counter-clockwise seen from outside.
    curved_edges : iterable of (int, int)
        Vertex pairs of edges that approximate a curved or smooth edge of the part. They are never
        entities.
    name : str
        Name of the part.
    planarity_mm : float, optional
        Largest distance of a face's vertex from its plane. Default: 10⁻⁶ of the bounding box diagonal.
    notes : iterable of str
        Notes on repairs and choices of the reader.
    circular_edges : iterable of CircularEdge, optional
        The circular edges of the CAD model; see `rims`. Default: unknown.
    surface_turns : mapping of (int, int) to float, optional
        Vertex pairs of straight edges of curved faces, with the ``Edge.surface_turn_deg`` of each,
        in degrees.

    Attributes
    ----------
    vertices : ndarray of float64, shape (n, 3), read-only
        Coordinates in mm.
    faces : tuple of Face
        In the order given.
    edges : tuple of Edge
        ``edges[i].id == i``, in order of first appearance in the loops, so ids are stable for the same input.
    normals : ndarray, shape (f, 3), read-only
        Outward unit normals of the faces.
    face_triangles : tuple of ndarray of int32, shape (m, 3)
        Triangles of each face, counter-clockwise seen from outside, using its own vertices only.
    face_shell : ndarray of int, shape (f,)
        The shell (connected piece of surface) of each face.
    volume : float
        In mm³.
    name : str
        Name of the part.
    notes : tuple of str
        Repairs and choices of the reader.
    circular_edges : tuple of CircularEdge or None
        The circular edges of the CAD model. None if they are unknown, as in a mesh.
    file_solids : FileSolids or None
        The solids of its STEP file. None if it comes from another source.

    Raises
    ------
    SolidError
        If a rule in the module's description is broken. Subclasses name the rule.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> corners = list(product((0, 40), (0, 30), (0, 20)))
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(corners, faces, name="box")

    >>> box
    <Solid 'box': 8 vertices, 12 edges, 6 faces>
    >>> print(box)
    box: 40 x 30 x 20 mm, 12 straight edges
    >>> round(box.volume)
    24000
    >>> box.edges[1].vertices, box.edge_length_mm(1)
    ((1, 3), 30.0)
    """

    def __init__(
        self,
        vertices: ArrayLike,
        faces: Iterable[Face | Sequence[Any]],
        *,
        curved_edges: Iterable[tuple[int, int]] = (),
        name: str = "",
        planarity_mm: float | None = None,
        notes: Iterable[str] = (),
        circular_edges: Iterable[CircularEdge] | None = None,
        surface_turns: Mapping[tuple[int, int], float] | None = None,
    ) -> None:
        self.name = name
        self.notes = tuple(notes)
        # the reader of STEP files sets it
        self.file_solids: FileSolids | None = None
        self.circular_edges = None if circular_edges is None else tuple(circular_edges)
        self.vertices = check_vertices(vertices)
        self.faces = tuple(as_face(face) for face in faces)
        with phase("check the surface"):
            loops = FaceLoops.of(self.faces)
            check_indices(self.vertices, loops)
            edge_vertices, edge_faces = pair_edges(self.vertices, loops)
            check_fans(self.vertices, loops)
        self.planarity_mm = (
            default_planarity_mm(self.vertices) if planarity_mm is None else float(planarity_mm)
        )
        self.normals = self._checked_normals(loops)
        with phase("cut the faces into triangles"):
            self.face_triangles = triangulate_faces(self.vertices, loops, self.normals)
        self.face_shell = label_shells(len(self.faces), edge_faces)
        with phase("list the edges"):
            self.edges = self._build_edges(
                edge_vertices, edge_faces, curved_edges, surface_turns or {}
            )
        self.volume = signed_volume(self.vertices, self.triangles)
        check_contacts(self)
        check_shells(self.vertices, self.triangles, self.face_shell[self.triangle_face])

    def _checked_normals(self, loops: FaceLoops) -> np.ndarray:
        area_vectors = face_area_vectors(self.vertices, loops)
        check_areas(self.vertices, loops, area_vectors)
        normals = area_vectors / np.linalg.norm(area_vectors, axis=1, keepdims=True)
        check_planarity(self.vertices, loops, normals, self.planarity_mm)
        normals.flags.writeable = False
        return normals

    def _build_edges(
        self,
        edge_vertices: np.ndarray,
        edge_faces: np.ndarray,
        curved_edges: Iterable[tuple[int, int]],
        surface_turns: Mapping[tuple[int, int], float],
    ) -> tuple[Edge, ...]:
        n = len(self.vertices)
        key = edge_vertices.min(axis=1) * n + edge_vertices.max(axis=1)
        edge_keys = np.sort(key)
        curved = np.isin(key, _known_keys("curved_edges", curved_edges, edge_keys, n))
        behind = dict(
            zip(
                _known_keys("surface_turns", surface_turns, edge_keys, n).tolist(),
                map(float, surface_turns.values()),
                strict=True,
            )
        )
        if not all(0.0 <= turn <= 180.0 for turn in behind.values()):
            raise SolidError(
                f"surface_turns must be in 0..180 degrees. Got {sorted(behind.values())[-1]}."
            )
        turns = signed_dihedrals_deg(self.vertices, self.normals, edge_vertices, edge_faces)
        rows = zip(
            range(len(key)),
            map(tuple, edge_vertices.tolist()),
            map(tuple, edge_faces.tolist()),
            turns.tolist(),
            curved.tolist(),
            map(behind.get, key.tolist()),
            strict=True,
        )
        return tuple(starmap(Edge, rows))

    @cached_property
    def triangles(self) -> np.ndarray:
        """All triangles, ndarray of int32, shape (t, 3), face by face."""
        return np.concatenate(self.face_triangles)

    @cached_property
    def triangle_face(self) -> np.ndarray:
        """The face of each triangle, ndarray of int, shape (t,)."""
        return np.repeat(np.arange(len(self.faces)), [len(t) for t in self.face_triangles])

    @property
    def bounds(self) -> np.ndarray:
        """Lowest and highest corner of the bounding box in mm, shape (2, 3)."""
        return self._bounds.copy()

    @cached_property
    def _bounds(self) -> np.ndarray:
        """`bounds`, which every name of an entity asks for."""
        return np.array([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    @property
    def n_shells(self) -> int:
        """Number of connected pieces of surface."""
        return int(self.face_shell.max()) + 1

    def edge_points(self, edge_id: int | str) -> np.ndarray:
        """Return the two end points of an edge.

        Parameters
        ----------
        edge_id : int or str
            Its id, which is its index in `edges`, also as ``"e5"``.

        Returns
        -------
        ndarray of float64, shape (2, 3)
            In mm, in the order of ``Edge.vertices``.

        Raises
        ------
        SolidError
            If there is no such edge.
        """
        return self.vertices[list(self._edge(edge_id).vertices)]

    def edge_length_mm(self, edge_id: int | str) -> float:
        """Return the length of an edge.

        Parameters
        ----------
        edge_id : int or str
            Its id, which is its index in `edges`, also as ``"e5"``.

        Returns
        -------
        float
            In mm.

        Raises
        ------
        SolidError
            If there is no such edge.
        """
        start, end = self.edge_points(edge_id)
        return float(np.linalg.norm(end - start))

    def straight_edges(
        self, min_dihedral_deg: float = 5.0, min_length_mm: float = 0.0
    ) -> tuple[Edge, ...]:
        """Return the edges that can be entities: straight, sharp and long enough.

        Parameters
        ----------
        min_dihedral_deg : float
            Smallest turn of the normal across the edge, in either direction, in degrees. It is that
            of the CAD surfaces if known, see ``Edge.turn_deg``.
        min_length_mm : float
            Smallest length in mm.

        Returns
        -------
        tuple of Edge
            In the order of their ids.

        Raises
        ------
        EntityError
            If a limit is not a finite number from 0.
        """
        _check_least("min_dihedral_deg", min_dihedral_deg)
        _check_least("min_length_mm", min_length_mm)
        return tuple(
            edge
            for edge in self.edges
            if not edge.curved
            and abs(edge.turn_deg) >= min_dihedral_deg
            and (min_length_mm <= 0.0 or self.edge_length_mm(edge.id) >= min_length_mm)
        )

    def rims(self, min_dihedral_deg: float = SHARP_DEG) -> tuple[Rim, ...]:
        """Return the closed circular edges that can be entities.

        Their circles are those of the CAD model. Without a CAD model, circles are fitted to chains
        of eight or more chords that turn evenly (see `circle_fit`).

        Parameters
        ----------
        min_dihedral_deg : float
            Smallest turn of the normal across each chord, in either direction, in degrees.

        Returns
        -------
        tuple of Rim
            In the order of their ids, which do not depend on `min_dihedral_deg`.

        Raises
        ------
        EntityError
            If the limit is not a finite number from 0.
        """
        _check_least("min_dihedral_deg", min_dihedral_deg)
        return tuple(
            a for a in self._arcs if isinstance(a, Rim) and a.dihedral_deg >= min_dihedral_deg
        )

    def arcs(self, min_dihedral_deg: float = SHARP_DEG) -> tuple[Arc, ...]:
        """Return the open circular edges that can be entities; see `rims`.

        Parameters
        ----------
        min_dihedral_deg : float
            Smallest turn of the normal across each chord, in either direction, in degrees.

        Returns
        -------
        tuple of Arc
            In the order of their ids, which do not depend on `min_dihedral_deg`.

        Raises
        ------
        EntityError
            If the limit is not a finite number from 0.
        """
        _check_least("min_dihedral_deg", min_dihedral_deg)
        return tuple(
            a for a in self._arcs if not isinstance(a, Rim) and a.dihedral_deg >= min_dihedral_deg
        )

    def edge_ends(self, edge: Edge | int | str) -> tuple[EdgeEnd, ...]:
        """Return how a straight edge ends: at a corner, or smoothly in an arc.

        The length of an edge is measured to its corners. Where an edge ends in a tangent arc, its
        length is undefined.

        Parameters
        ----------
        edge : Edge, int or str
            One of the solid's edges, or its id.

        Returns
        -------
        tuple of EdgeEnd
            Two, in the order of ``Edge.vertices``.

        Raises
        ------
        SolidError
            If there is no such edge.
        """
        chosen = self._edge(edge.id if isinstance(edge, Edge) else edge)
        return find_edge_ends(self, chosen, *self._ends)

    def _edge(self, edge_id: int | str) -> Edge:
        """Return the edge of an id. A negative one is none: as an index it would be another edge's."""
        number: Any = edge_id
        if isinstance(edge_id, str) and _EDGE_TEXT.fullmatch(edge_id):
            number = int(edge_id.removeprefix("e"))
        if (
            isinstance(number, bool)
            or not isinstance(number, int | np.integer)
            or not 0 <= number < len(self.edges)
        ):
            raise SolidError(
                f"an edge must be one of the solid's, 0..{len(self.edges) - 1}. Got {edge_id!r}."
            )
        return self.edges[number]

    @classmethod
    def read(cls, path: str | PathLike[str], **reading: Any) -> Solid:
        """Read a part from a file; another name of `read_solid`.

        Parameters
        ----------
        path : str or os.PathLike
            The file: .step, .stp, .stl, .obj, .ply, .off or .glb.
        **reading
            Keywords of `read_solid`, such as ``units``.

        Returns
        -------
        Solid
            The part.
        """
        # the readers make solids, so they are imported here
        from aspectgraph import read_solid

        return read_solid(path, **reading)

    def plot(self, entities: Mapping[str, Any] | None = None) -> Figure:
        """Draw the part in 3-D with some of its entities, like `plot_solid`.

        Parameters
        ----------
        entities : mapping of str to entity, optional
            Name to an id, two end points or an `Entity`, as `resolve_entities` takes them.

        Returns
        -------
        plotly.graph_objects.Figure
            A notebook shows it; ``write_html`` saves it.

        Examples
        --------
        >>> from aspectgraph import Solid
        >>> block = Solid.read("examples/two_pocket_block.off")
        >>> type(block.plot({"rim": [[60, 20, 10], [60, 40, 10]]})).__name__
        'Figure'
        """
        from aspectgraph import plot_solid, resolve_entities

        return plot_solid(self, None if entities is None else resolve_entities(self, entities))

    @cached_property
    def _ends(self) -> tuple[dict[int, list[Edge]], dict[int, str]]:
        """What `find_edge_ends` needs to know."""
        return edges_at_vertices(self), {
            edge_id: arc.id for arc in self._arcs for edge_id in arc.edge_ids
        }

    @cached_property
    def _arcs(self) -> tuple[Arc, ...]:
        with phase("find rims and arcs"):
            return find_arcs(self, self.circular_edges)

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return f"<Solid {self.name!r}: {len(self.vertices)} vertices, {len(self.edges)} edges, {len(self.faces)} faces>"

    def __str__(self) -> str:
        """Return its size and what can be measured of it, as `info` lists it."""
        size = " x ".join(f"{length:.5g}" for length in np.ptp(self.bounds, axis=0))
        kinds = {
            "straight edge": len(self.straight_edges()),
            "rim": len(self.rims()),
            "arc": len(self.arcs()),
        }
        counts = ", ".join(f"{n} {kind}{'s' * (n != 1)}" for kind, n in kinds.items() if n)
        return f"{self.name or 'solid'}: {size} mm, {counts or 'no sharp edges'}"

    def _views(self) -> dict[str, Callable[[], Any]]:
        return {PLOTLY: self._notebook_figure, **super()._views()}

    def _notebook_figure(self) -> dict[str, Any]:
        """Return the part in 3-D, as notebooks that know plotly draw it."""
        return json.loads(self.plot().update_layout(height=_FIGURE_PX).to_json())

    def _notebook_view(self) -> NotebookView:
        size = " × ".join(f"{length:.5g}" for length in np.ptp(self.bounds, axis=0))
        rows = [
            ("size", f"{size} mm"),
            ("volume", f"{self.volume / 1000:.5g} cm³"),
            (
                "vertices, edges, faces",
                f"{len(self.vertices)}, {len(self.edges)}, {len(self.faces)}",
            ),
            ("straight edges to measure", f"{len(self.straight_edges())}"),
            ("rims, arcs", f"{len(self.rims())}, {len(self.arcs())}"),
        ]
        notes = {f"note {n}": note for n, note in enumerate(self.notes, start=1)}
        return NotebookView(
            f"Solid {self.name}".strip(), table=NotebookTable(("", ""), rows), items=notes
        )


def _known_keys(
    label: str, pairs: Iterable[tuple[int, int]], edge_keys: np.ndarray, n: int
) -> np.ndarray:
    """Return the keys, lower vertex times n and higher one, of vertex pairs that must be among the known ones."""
    ends = np.sort(_vertex_pairs(label, pairs, n), axis=1)
    keys = ends[:, 0] * n + ends[:, 1]
    strangers = ends[~np.isin(keys, edge_keys) | (ends < 0).any(axis=1) | (ends >= n).any(axis=1)]
    if len(strangers):
        raise SolidError(
            f"{label} must name edges. Got vertices {min(map(tuple, strangers.tolist()))}."
        )
    return keys


def _vertex_pairs(label: str, pairs: Iterable[tuple[int, int]], n: int) -> np.ndarray:
    """Return pairs of vertex indices as an array, shape (m, 2)."""
    if isinstance(pairs, np.ndarray) and pairs.dtype.kind == "i" and pairs.shape[1:] == (2,):
        return pairs
    listed = [tuple(pair) for pair in pairs]
    for pair in listed:
        if len(pair) != 2 or not all(map(is_index, pair)):
            raise SolidError(f"{label} must be pairs of integer vertex indices. Got {pair}.")
        # also of more digits than an array takes
        if not all(0 <= vertex < n for vertex in pair):
            raise SolidError(f"{label} must name edges. Got vertices {tuple(sorted(pair))}.")
    return np.array(listed, dtype=np.int64).reshape(-1, 2)


def kind_text(value: object) -> str:
    """Return a short value itself, of others the type: "'block.stp'", "3", "a Solid"."""
    name = type(value).__name__
    if value is not None and not isinstance(value, str | int | float):
        return f"{'an' if name[0] in 'AEIOUaeiou' else 'a'} {name}"
    text = repr(value)
    if len(text) <= _LONGEST:
        return text
    quote = text[0] if isinstance(value, str) else ""
    return f"{text[: _LONGEST - 3 - len(quote)]}...{quote}"


def check_solid(solid: object, exchanged: object = None, order: str = "") -> None:
    """Refuse what is no solid.

    Parameters
    ----------
    solid : object
        What was given.
    exchanged : object
        The argument that may have been exchanged with it.
    order : str
        The right order of the two.

    Raises
    ------
    SolidError
        If it is none.
    """
    if isinstance(solid, Solid):
        return
    hint = "read_solid reads one from a file"
    if isinstance(exchanged, Solid):
        hint = f"the order of the arguments is {order}"
    raise SolidError.of_rule("solid", "must be a Solid", kind_text(solid), hint=hint)


def _check_least(name: str, value: Any) -> None:
    """Refuse a limit that is not a finite number from 0."""
    is_number = isinstance(value, Real) and not isinstance(value, bool)
    if not (is_number and math.isfinite(value) and value >= 0):
        got = repr(value)[:_LONGEST]
        raise EntityError.of_rule(name, "must be a finite number from 0", got)
