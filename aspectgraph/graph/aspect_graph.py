"""The entity-based aspect graph (paper section 3): what it answers, and its files."""

from __future__ import annotations

import bz2
import errno
import gzip
import io
import json
import math
import os
import re
import warnings
import zlib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree.ElementTree import ParseError

import networkx as nx
import numpy as np
from numpy.typing import ArrayLike

from aspectgraph.cells.arrays import CellSet, Complex, locate, tree_of
from aspectgraph.domains.find_domains import (
    Domains,
)
from aspectgraph.entities.entity import Entity
from aspectgraph.exact.grid import as_points
from aspectgraph.exceptions import EntityError, GraphFileNotFoundError, GraphMLError
from aspectgraph.files import replacing, up_to_limit
from aspectgraph.solid.solid import Solid, kind_text
from aspectgraph.visibility.visibility_regions import VisibilityRegions
from ground.notebook import NotebookTable, NotebookView, ShownInNotebook
from ground.short_repr import count, short_repr

# The entity-based aspect graph: viewing domains as nodes, common boundaries as edges (paper
# section 3).


def curve_attributes(entities: Collection[Entity]) -> dict[str, tuple[object, ...]]:
    """Return the attributes of a graph that say which of its entities are rims, arcs or parts; none if all are edges.

    Parameters
    ----------
    entities : collection of Entity
        Those of the graph.

    Returns
    -------
    dict
        ``"kinds"`` of the entities, and ``"circles"``: centre, axis and radius of each, in mm; of an edge nothing.
        If there are parts, ``"parts"``: the text of each, such as ``17[0:1/4]``; of a whole entity nothing.
    """
    attributes: dict[str, tuple[object, ...]] = {}
    if any(entity.part is not None for entity in entities):
        attributes["parts"] = tuple("" if e.part is None else str(e.part) for e in entities)
    if all(entity.kind == "edge" for entity in entities):
        return attributes
    circles = [entity.circle for entity in entities]
    rows = [
        () if c is None else (*map(float, (*c.centre, *c.axis)), float(c.radius_mm))
        for c in circles
    ]
    kinds = tuple(entity.kind for entity in entities)
    return {"kinds": kinds, "circles": tuple(rows), **attributes}


# what a notebook shows of a graph: domains, and characters of a list of names
_SHOWN_DOMAINS = 12
_SHOWN_CHARACTERS = 60


def _some(names: Sequence[str]) -> str:
    """Return as many names as a cell of a table has room for, at least one, and how many more there are."""
    shown = list(names[:1])
    for name in names[1:]:
        if len(", ".join([*shown, name])) > _SHOWN_CHARACTERS:
            return f"{', '.join(shown)} and {len(names) - len(shown)} more"
        shown.append(name)
    return ", ".join(shown) or "none"


@dataclass(frozen=True)
class PartitionSurface:
    """A plane across which one entity appears or disappears.

    Attributes
    ----------
    type : str
        ``"A"``: the plane of a face next to the entity. ``"B"``: a plane through the entity and a
        vertex, or through an end of the entity and another edge. ``"L"``, for lamps: a plane
        through the entity on which its contrast is the required one.
    entity : str
        Name of the entity.
    vertices, edges, faces : tuple of int
        Elements of the solid that span the plane, by number. For type A, this is a face. For type
        B, it is an edge and an end of the entity, or a vertex and the entity's edges, or a face in
        the same plane. For type L, it is the entity's edges and the brighter face. For a rim or
        arc, the face is next to one of its chords, and end and edge are those of a chord. An end of
        a stretch inside its edge is no vertex, so the edge of such a plane stands alone.
    plane : tuple of float
        (a, b, c, d) with unit normal, a·x + b·y + c·z = d in mm; `Cell.half_spaces` have the opposite d.
    """

    type: str
    entity: str
    vertices: tuple[int, ...]
    edges: tuple[int, ...]
    faces: tuple[int, ...]
    plane: tuple[float, float, float, float]

    __repr__ = short_repr


class EntityAspectGraph(ShownInNotebook):
    """The entity-based aspect graph EAG(E, V, O, A) of a solid.

    E are the entities, V viewing domains, O observable lists, and A adjacencies.

    `build_aspect_graph` makes it.

    Parameters
    ----------
    cx : Complex
        The convex cells that the workspace is cut into.
    domains : Domains
        Which of these cells form which node.

    Attributes
    ----------
    graph : networkx.Graph
        Nodes 0, 1, … are viewing domains, those with the longest lists first. ``observable`` is a
        tuple of names. ``volume`` is that inside the workspace, in mm³. ``unbounded`` is true if
        the domain reaches the workspace's boundary. ``viewpoint`` and ``clearance`` are centre and
        radius, in mm, of the largest ball in one of its cells. Cells at least as wide as the least
        width are preferred. Further attributes are ``bbox_min``, ``bbox_max``, ``n_cells``,
        ``confirmed``, ``n_rays`` and ``n_arbitrated``. Edges have ``area`` (mm²) and ``surfaces``
        (tuple of `PartitionSurface`).
    regions : VisibilityRegions
        The regions of the entities, which answer `observable` and `covering_cells`.
    """

    _title = "Aspect graph"

    def __init__(
        self, regions: VisibilityRegions, graph: nx.Graph, cx: Complex, domains: Domains
    ) -> None:
        self.regions = regions
        self.graph = graph
        self._cx = cx
        self._domains = domains
        self._tree = tree_of(cx)

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return f"<EntityAspectGraph of {self.solid.name!r}: {self._size}>"

    @property
    def _size(self) -> str:
        """Numbers of entities, domains and adjacencies."""
        n_adjacencies = self.graph.number_of_edges()
        return (
            f"{count(len(self.entities), 'entity', 'entities')}, "
            f"{count(len(self.graph), 'domain')}, {count(n_adjacencies, 'adjacency', 'adjacencies')}"
        )

    def _notebook_view(self) -> NotebookView:
        listed_as = self.regions.listed_as
        nodes = self.graph.nodes
        total = math.fsum(volume for _, volume in nodes(data="volume"))
        rows = []
        for node in sorted(nodes)[:_SHOWN_DOMAINS]:
            names = nodes[node][listed_as]
            place = ", ".join(f"{c:.1f}" for c in nodes[node]["viewpoint"])
            percent = 100 * nodes[node]["volume"] / total
            share = f"{percent:.2g} %" if percent >= 0.01 else "< 0.01 %"
            clearance = f"{nodes[node]['clearance']:.3g}"
            listed = f"{count(len(names), 'entity', 'entities')}: {_some(names)}"
            rows.append((node, listed if names else "none", share, place, clearance))
        headings = (
            "domain",
            listed_as,
            "share of space",
            "viewpoint (mm)",
            "clearance (mm)",
        )
        lines = [f"{self._size}."]
        if len(nodes) > len(rows):
            lines.append(f"The {len(rows)} domains with the longest lists:")
        return NotebookView(
            f"{self._title} of {self.solid.name or 'a part'}",
            lines,
            NotebookTable(headings, rows, right=(0, 2, 4)),
        )

    @property
    def solid(self) -> Solid:
        """The solid."""
        return self.regions.solid

    @property
    def workspace(self) -> np.ndarray:
        """Lowest and highest corner of the viewpoint space in mm, shape (2, 3)."""
        return self.regions.workspace

    @property
    def entities(self) -> dict[str, Entity]:
        """The entities by name, in order."""
        return self.regions.entities

    @property
    def entity_names(self) -> tuple[str, ...]:
        """Names of the entities, in order."""
        return self.regions.entity_names

    def observable(self, points: ArrayLike, names: Sequence[str] | None = None) -> np.ndarray:
        """Whether entities are observable from viewpoints; see `VisibilityRegions.observable`.

        Parameters
        ----------
        points : array_like, shape (n, 3)
            Viewpoints in mm, inside the workspace.
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
        return self.regions.observable(points, names)

    def covering_cells(self, names: Sequence[str]) -> CellSet:
        """Viewpoints from which all named entities are observable; see `VisibilityRegions.covering_cells`.

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
        return self.regions.covering_cells(names)

    def domain_of(self, points: ArrayLike) -> np.ndarray:
        """Return the node of each viewpoint.

        Parameters
        ----------
        points : array_like, shape (n, 3)
            Viewpoints in mm. One alone, (3,), counts as one row.

        Returns
        -------
        ndarray of int64, shape (n,)
            Node numbers; -1 inside the solid and outside the workspace.

        Raises
        ------
        WorkspaceError
            If the points have another shape.
        """
        viewpoints = as_points(points)
        result = np.full(len(viewpoints), -1, np.int64)
        inside = ((viewpoints >= self.workspace[0]) & (viewpoints <= self.workspace[1])).all(axis=1)
        cells = locate(self._tree, self.regions.grid.to_points(viewpoints[inside]))
        result[inside] = self._domains.of_cell[cells]
        return result

    def covering(self, names: Sequence[str]) -> list[int]:
        """Return the nodes whose list contains all names.

        Parameters
        ----------
        names : sequence of str
            Names of entities. Without names, the result is all nodes.

        Returns
        -------
        list of int
            Node numbers, ascending.

        Raises
        ------
        EntityError
            If a name is unknown.
        """
        name_set = set(self.regions.check_names(names))
        return [
            node
            for node, listed in self.graph.nodes(data=self.regions.listed_as)
            if name_set <= set(listed)
        ]

    def cells(self, node: int) -> CellSet:
        """Return the convex cells of one viewing domain.

        Parameters
        ----------
        node : int
            Number of the node.

        Returns
        -------
        CellSet
            The cells that the domain consists of.

        Raises
        ------
        EntityError
            If there is no such node.
        """
        if (
            isinstance(node, bool)
            or not isinstance(node, int | np.integer)
            or node not in self.graph
        ):
            rule = f"must be a domain of the graph, 0 to {len(self.graph) - 1}"
            raise EntityError.of_rule("node", rule, repr(node))
        return CellSet(self._cx, self._domains.domains[node].cells, self.regions.grid)

    def sample(
        self, names: Sequence[str], n: int, rng: int | np.random.Generator = 0
    ) -> np.ndarray:
        """Draw viewpoints uniformly from all domains whose list contains the names.

        Parameters
        ----------
        names : sequence of str
            Names of entities.
        n : int
            How many viewpoints.
        rng : int or numpy.random.Generator
            Seed or source of chance.

        Returns
        -------
        ndarray of float64, shape (n, 3)
            Viewpoints in mm.

        Raises
        ------
        EntityError
            If a name is unknown, or no domain covers them.
        WorkspaceError
            If `n` is no integer from 0.
        """
        nodes = self.covering(names)
        if not nodes:
            raise EntityError.of_rule(
                "names", "must be observable together from somewhere", ", ".join(names)
            )
        cells = np.concatenate([self._domains.domains[node].cells for node in nodes])
        return CellSet(self._cx, cells, self.regions.grid).sample(n, rng)

    def write(self, path: str | PathLike[str]) -> None:
        """Write the graph as GraphML; another name of `write_graphml`. `read_graphml` reads it.

        Parameters
        ----------
        path : str or os.PathLike
            The file; an existing one is replaced.
        """
        write_graphml(self, path)


# Graph files: GraphML that loses nothing and that networkx, igraph, Gephi, yEd and Cytoscape all
# read.
#
# GraphML knows booleans, integers, floats and text only, and readers differ in what they make of
# a missing value. Hence:
#
# * every node has the same attributes, and every edge; a number is finite; a text holds no control characters;
# * a vector ``viewpoint`` is three floats ``viewpoint_x``, ``viewpoint_y``, ``viewpoint_z``;
# * lists of names, end points, circles and partition surfaces are JSON texts;
# * a node also gets ``label`` (its list, or ``None``) and an edge ``label`` (the types of its surfaces) for the
#   programs that draw graphs. Both are dropped when the file is read back.
#
# Reference: U. Brandes et al., GraphML progress report, Graph Drawing 2001.


LABEL = "label"
"""Attribute written for the eyes only."""

ADDED_BY_FILES = (LABEL, "id", "node_default", "edge_default")
"""Attributes that are no part of the graph: ours for the eyes, and what networkx adds on reading."""

AXES = ("x", "y", "z")

NOT_XML = re.compile("[\x00-\x08\x0b-\x1f\x7f\ud800-\udfff\ufffe\uffff]")
"""What XML cannot carry or, as carriage return, changes on the way."""


_WRONG_VALUES = (
    ArithmeticError,
    AttributeError,
    LookupError,
    RecursionError,
    TypeError,
    ValueError,
)
"""What comes of a file with a value of another type than it should have, or in an encoding that does not exist."""


class Codec(NamedTuple):
    """How a value becomes a scalar of GraphML, and back."""

    encode: Callable[[Any], bool | int | float | str]
    decode: Callable[[Any], Any]


def write_graphml(graph: EntityAspectGraph | nx.Graph, path: str | os.PathLike[str]) -> None:
    """Write an aspect graph as GraphML.

    The file appears whole or not at all.

    Parameters
    ----------
    graph : EntityAspectGraph or networkx.Graph
        An object with a `networkx.Graph` as its ``graph`` attribute, or that graph. It is not
        changed.
    path : str or os.PathLike
        An existing file is replaced.

    Raises
    ------
    GraphMLError
        An attribute cannot be written without loss; nothing is written then.
    OutputError
        The file cannot be written.

    Examples
    --------
    Any graph with integer nodes and attributes of the kinds that aspect graphs have:

    >>> import tempfile
    >>> import networkx as nx
    >>> from aspectgraph import read_graphml, write_graphml
    >>> graph = nx.Graph(part="box", entities=("top", "side"))
    >>> graph.add_node(0, observable=("top", "side"), volume=8.5)
    >>> graph.add_node(1, observable=(), volume=20.0)
    >>> graph.add_edge(0, 1, area=3.25)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_graphml(graph, f"{folder}/box.graphml")
    ...     again = read_graphml(f"{folder}/box.graphml")
    >>> again.nodes[0]
    {'observable': ('top', 'side'), 'volume': 8.5}
    """
    plain = graph if isinstance(graph, nx.Graph) else getattr(graph, "graph", None)
    if not isinstance(plain, nx.Graph) or not isinstance(path, str | os.PathLike):
        raise GraphMLError.of_rule(
            "graph and path",
            "must be an EntityAspectGraph or a networkx.Graph, and a path",
            f"objects of the types {type(graph).__name__} and {type(path).__name__}",
        )
    path = Path(path)
    try:
        flat = _flat_graph(plain)
    except ValueError as error:
        raise GraphMLError(f"{path}: {error}") from error
    with replacing(path) as beside, open(beside, "wb") as file:
        nx.write_graphml_xml(flat, file)


def _content(path: Path) -> bytes:
    """Return the bytes of a file, unpacked as its ending tells, up to a limit."""
    packed: dict[str, Callable[..., Any]] = {".gz": gzip.open, ".bz2": bz2.open}
    with packed.get(path.suffix, open)(path, "rb") as file:
        try:
            return up_to_limit(file, large=True)
        except OSError as error:
            if error.errno != errno.EFBIG:
                raise
            raise GraphMLError(
                f"{path}: must be a graph file of a sensible size. Got: {error.strerror}."
            ) from error


def read_graphml(path: str | os.PathLike[str]) -> nx.Graph:
    """Read an aspect graph written by :func:`write_graphml`.

    Parameters
    ----------
    path : str or os.PathLike
        The GraphML file.

    Returns
    -------
    networkx.Graph
        Equal to the graph written: the same node ids, edges, attributes, values and types.

    Raises
    ------
    GraphMLError
        The file is not GraphML, or is not the GraphML of an aspect graph.
    GraphFileNotFoundError
        There is no such file.

    Examples
    --------
    >>> import tempfile
    >>> import networkx as nx
    >>> from aspectgraph import read_graphml, write_graphml
    >>> graph = nx.path_graph(3)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_graphml(graph, f"{folder}/path.graphml")
    ...     again = read_graphml(f"{folder}/path.graphml")
    >>> nx.utils.graphs_equal(again, graph)
    True
    """
    if not isinstance(path, str | os.PathLike):
        raise GraphMLError.of_rule("path", "must be a path", kind_text(path))
    path = Path(path)
    try:
        # what networkx warns of and guesses, a missing type for one, is never in a file of ours
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            flat = nx.read_graphml(io.BytesIO(_content(path)), node_type=int)
    except FileNotFoundError:
        rule = "must name an existing GraphML file"
        raise GraphFileNotFoundError.of_rule("path", rule, repr(str(path))) from None
    except IsADirectoryError:
        rule = "must name a GraphML file"
        raise GraphMLError.of_rule("path", rule, f"the folder {str(path)!r}") from None
    except (
        ParseError,
        nx.NetworkXError,
        EOFError,
        gzip.BadGzipFile,
        zlib.error,
        Warning,
        *_WRONG_VALUES,
    ) as error:
        text = " ".join(str(error).split())[:200]
        raise GraphMLError(f"{path}: must be GraphML with integer node ids. Got {text}.") from error
    if flat.is_directed() or flat.is_multigraph():
        raise GraphMLError(
            f"{path}: must hold one undirected edge at most between two nodes. Got a {type(flat).__name__}."
        )
    try:
        return _rebuilt_graph(flat)
    except _WRONG_VALUES as error:
        raise GraphMLError(f"{path}: {' '.join(str(error).split())[:400]}") from error


# ------------------------------------------------------------------------------------------------ whole graphs


def _flat_graph(graph: nx.Graph) -> nx.Graph:
    if graph.is_directed() or graph.is_multigraph():
        raise ValueError(
            f"the graph must be a plain undirected networkx.Graph. Got a {type(graph).__name__}."
        )
    flat = nx.Graph()
    flat.graph.update(_flattened(graph.graph, "the graph"))
    for node, attributes in graph.nodes(data=True):
        if type(node) is not int:
            raise ValueError(f"node ids must be integers. Got {node!r}.")
        flat.add_node(node)
        flat.nodes[node].update(_flattened(attributes, f"node {node}") | _node_label(attributes))
    for u, v, attributes in graph.edges(data=True):
        flat.add_edge(u, v)
        flat.edges[u, v].update(_flattened(attributes, f"edge {u}-{v}") | _edge_label(attributes))
    _check_alike(flat)
    return flat


def _rebuilt_graph(flat: nx.Graph) -> nx.Graph:
    _check_alike(flat)
    graph = nx.Graph()
    graph.graph.update(_rebuilt(flat.graph, "the graph"))
    for node, attributes in flat.nodes(data=True):
        graph.add_node(node)
        graph.nodes[node].update(_rebuilt(attributes, f"node {node}"))
    for u, v, attributes in flat.edges(data=True):
        graph.add_edge(u, v)
        graph.edges[u, v].update(_rebuilt(attributes, f"edge {u}-{v}"))
    return graph


def _check_alike(flat: nx.Graph) -> None:
    """Check that all nodes have the same attributes with the same types, and all edges."""
    for kind, rows in (
        ("node", dict(flat.nodes(data=True))),
        ("edge", {(u, v): d for u, v, d in flat.edges(data=True)}),
    ):
        signatures = {
            name: {k: type(x) for k, x in attributes.items()} for name, attributes in rows.items()
        }
        first = next(iter(signatures.values()), None)
        for name, signature in signatures.items():
            if first is not None and signature != first:
                keys = sorted(k for k in {*signature, *first} if signature.get(k) != first.get(k))
                raise ValueError(
                    f"every {kind} must have the same attributes. Got a difference in {keys} at {kind} {name}."
                )


def _node_label(attributes: Mapping[str, Any]) -> dict[str, str]:
    names = attributes.get("observable", attributes.get("showing"))
    return {} if names is None else {LABEL: NOT_XML.sub(" ", ", ".join(names)) or "None"}


def _edge_label(attributes: Mapping[str, Any]) -> dict[str, str]:
    surfaces = attributes.get("surfaces")
    return (
        {} if surfaces is None else {LABEL: "+".join(sorted({s.type for s in surfaces})) or "None"}
    )


# --------------------------------------------------------------------------------------------- one set of attributes


def _flattened(attributes: Mapping[str, Any], owner: str) -> dict[str, bool | int | float | str]:
    flat: dict[str, bool | int | float | str] = {}
    for key, value in attributes.items():
        if type(key) is not str or key == LABEL:
            raise ValueError(
                f"attribute names must be text other than {LABEL!r}. Got {key!r} of {owner}."
            )
        try:
            flat.update(
                _as_components(key, value)
                if key in VECTORS
                else {key: CODECS.get(key, SCALAR).encode(value)}
            )
        except (TypeError, ValueError, AttributeError) as error:
            raise ValueError(f"{key} of {owner} {error}") from error
    return flat


def _as_components(key: str, vector: Any) -> dict[str, float]:
    if len(vector) != len(AXES):
        raise ValueError(f"must be three numbers. Got {vector!r}.")
    return {f"{key}_{axis}": _as_float(x) for axis, x in zip(AXES, vector, strict=True)}


def _rebuilt(flat: Mapping[str, Any], owner: str) -> dict[str, Any]:
    flat = {key: value for key, value in flat.items() if key not in ADDED_BY_FILES}
    for key in VECTORS:
        names = [f"{key}_{axis}" for axis in AXES]
        if any(name in flat for name in names):
            # The vector takes the place of its first component, so the order of attributes survives too.
            items = [(key if k == names[0] else k, x) for k, x in flat.items()]
            vector = tuple(flat.get(name) for name in names)
            flat = {k: vector if k == key else x for k, x in items if k not in names}
    attributes = {}
    for key, value in flat.items():
        try:
            decode = CODECS.get(key, SCALAR).decode
            attributes[key] = tuple(map(decode, value)) if key in VECTORS else decode(value)
        except _WRONG_VALUES as error:
            raise ValueError(f"{key} of {owner} {error}") from error
    return attributes


# -------------------------------------------------------------------------------------------------- single values


def _plain(value: Any) -> Any:
    """Return a numpy scalar as the Python number it holds."""
    return value.item() if isinstance(value, np.generic) else value


def _as_scalar(value: Any) -> bool | int | float | str:
    value = _plain(value)
    if type(value) is str:
        if not value or NOT_XML.search(value):
            raise ValueError(
                f"must be text, not empty and without control characters. Got {value!r}."
            )
    elif type(value) not in (bool, int, float):
        raise ValueError(f"must be a bool, int, float or str. Got {value!r}.")
    elif not math.isfinite(value):
        raise ValueError(f"must be finite. Got {value}.")
    return value


def _as_float(value: Any) -> float:
    value = _plain(value)
    if type(value) not in (int, float) or not math.isfinite(value):
        raise ValueError(f"must be a finite number. Got {value!r}.")
    return float(value)


def _as_int(value: Any) -> int:
    value = _plain(value)
    if type(value) is not int:
        raise ValueError(f"must be an integer. Got {value!r}.")
    return value


def _as_bool(value: Any) -> bool:
    value = _plain(value)
    if type(value) is not bool:
        raise ValueError(f"must be a bool. Got {value!r}.")
    return value


def _to_json(value: Any) -> str:
    return json.dumps(value, allow_nan=False, default=_plain)


def _names_to_json(names: Any) -> str:
    if isinstance(names, str) or not all(isinstance(name, str) for name in names):
        raise ValueError(f"must be a tuple of names. Got {names!r}.")
    return _to_json(list(names))


def _text_to_json(text: Any) -> str:
    # JSON because networkx loses an empty text on reading.
    if not isinstance(text, str):
        raise ValueError(f"must be text. Got {text!r}.")
    return _to_json(text)


def _text_from_json(text: str) -> str:
    value = json.loads(text)
    if not isinstance(value, str):
        raise ValueError(f"must be a JSON text. Got {text!r}.")
    return value


def _surfaces_to_json(surfaces: Any) -> str:
    return _to_json([asdict(surface) for surface in surfaces])


def _surfaces_from_json(text: str) -> tuple[PartitionSurface, ...]:
    return tuple(
        PartitionSurface(**{k: _tuples(v) for k, v in row.items()}) for row in json.loads(text)
    )


def _tuples(value: Any) -> Any:
    """Return a JSON value with lists turned into tuples."""
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


def _tuples_from_json(text: str) -> tuple[Any, ...]:
    value = _tuples(json.loads(text))
    if not isinstance(value, tuple):
        raise ValueError(f"must be a JSON list. Got {text!r}.")
    return value


SCALAR = Codec(_as_scalar, _as_scalar)
FLOAT = Codec(_as_float, _as_float)
INT = Codec(_as_int, _as_int)
BOOL = Codec(_as_bool, _as_bool)
NAMES = Codec(_names_to_json, _tuples_from_json)
TEXT = Codec(_text_to_json, _text_from_json)
POINTS = Codec(
    lambda points: _to_json([[_as_float(x) for x in point] for point in points]), _tuples_from_json
)
SURFACES = Codec(_surfaces_to_json, _surfaces_from_json)

VECTORS = ("viewpoint", "bbox_min", "bbox_max", "workspace_min", "workspace_max")
"""Attributes that are written as three floats."""

CODECS = {
    **dict.fromkeys(VECTORS, FLOAT),
    **dict.fromkeys(
        ("volume", "clearance", "area", "grid_mm", "snapping_mm", "min_width_mm", "contrast"), FLOAT
    ),
    **dict.fromkeys(("n_cells", "n_rays", "n_arbitrated", "n_slivers"), INT),
    **dict.fromkeys(("unbounded", "confirmed"), BOOL),
    **dict.fromkeys(("observable", "showing", "entities", "kinds", "parts"), NAMES),
    "part": TEXT,
    "endpoints": POINTS,
    "circles": POINTS,
    "surfaces": SURFACES,
}
"""The attributes of an aspect graph; any other must be a bool, int, float or text already."""


# What an aspect graph says of its part: the domains that see most, how stable lists are, ways
# between domains.


@dataclass(frozen=True)
class ListOfEntities:
    """All domains with the same list of observable entities.

    Attributes
    ----------
    observable : tuple of str
        The list.
    volume : float
        Total volume of these domains inside the workspace, mm³.
    share : float
        Share of the volume of all domains. It is the probability that a random viewpoint has this
        list.
    domains : tuple of int
        Their numbers, largest first.
    clearance : float
        Radius of the largest ball found in one of their cells, mm. A camera at its centre may move
        by this distance.
    """

    observable: tuple[str, ...]
    volume: float
    share: float
    domains: tuple[int, ...]
    clearance: float

    __repr__ = short_repr


@dataclass(frozen=True)
class Crossing:
    """A step from one viewing domain to the next.

    Attributes
    ----------
    domain : int
        The domain that the step enters.
    appear, vanish : tuple of str
        Entities that become observable, and those that cease to be.
    """

    domain: int
    appear: tuple[str, ...]
    vanish: tuple[str, ...]

    __repr__ = short_repr


def stability(eag: EntityAspectGraph | nx.Graph) -> list[ListOfEntities]:
    """Group the domains of an aspect graph by their lists, the list of the largest volume first.

    Parameters
    ----------
    eag : EntityAspectGraph or networkx.Graph
        From `build_aspect_graph` or `read_graphml`.

    Returns
    -------
    list of ListOfEntities
        The volumes depend on the workspace where domains reach its boundary.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import build_aspect_graph, stability
    >>> eag = build_aspect_graph(box, {"top": 1, "side": 2})
    >>> sorted(group.observable for group in stability(eag))
    [(), ('side',), ('top',), ('top', 'side')]
    """
    nodes = plain_graph(eag).nodes
    total = sum(volume for _, volume in nodes(data="volume"))
    groups: dict[tuple[str, ...], list[int]] = {}
    for node, names in nodes(data="observable"):
        groups.setdefault(tuple(names), []).append(node)
    lists = []
    for names, members in groups.items():
        volume = sum(nodes[node]["volume"] for node in members)
        ordered = tuple(sorted(members, key=lambda node: (-nodes[node]["volume"], node)))
        clearance = max(nodes[node]["clearance"] for node in members)
        lists.append(ListOfEntities(names, volume, volume / total, ordered, clearance))
    return sorted(lists, key=lambda group: (-group.volume, group.domains))


def richest_domains(eag: EntityAspectGraph | nx.Graph, n: int | None = None) -> list[int]:
    """Return the domains from which most entities are observable, in this order.

    Parameters
    ----------
    eag : EntityAspectGraph or networkx.Graph
        From `build_aspect_graph` or `read_graphml`.
    n : int, optional
        Largest number of domains. Default: all.

    Returns
    -------
    list of int
        Numbers of nodes. Among equals, those with larger ``clearance``, then ``volume``, come
        first.

    Raises
    ------
    EntityError
        If `n` is not a positive whole number.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import build_aspect_graph, richest_domains
    >>> eag = build_aspect_graph(box, {"top": 1, "side": 2})
    >>> eag.graph.nodes[richest_domains(eag, 1)[0]]["observable"]
    ('top', 'side')
    """
    if n is not None and (isinstance(n, bool) or not isinstance(n, (int, np.integer)) or n < 1):
        raise EntityError.of_rule("n", "must be a positive whole number", repr(n))
    nodes = plain_graph(eag).nodes

    def key(node: int) -> tuple[Any, ...]:
        record = nodes[node]
        return -len(record["observable"]), -record["clearance"], -record["volume"], node

    return sorted(nodes, key=key)[:n]


def domain_path(eag: EntityAspectGraph | nx.Graph, start: int, goal: int) -> list[Crossing]:
    """Return a path between two domains that crosses the fewest partition surfaces.

    Of several such paths, it is one with the smallest total distance between viewpoints.

    Parameters
    ----------
    eag : EntityAspectGraph or networkx.Graph
        From `build_aspect_graph` or `read_graphml`.
    start, goal : int
        Numbers of nodes.

    Returns
    -------
    list of Crossing
        One for each domain after `start`; the last is `goal`. Domains are connected, but a straight line between their
        viewpoints may leave them, or pass through the part.

    Raises
    ------
    EntityError
        If there is no such domain, or no path between the two.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import build_aspect_graph, domain_path, richest_domains
    >>> eag = build_aspect_graph(box, {"top": 1, "side": 2})
    >>> best, *_, worst = richest_domains(eag)
    >>> way = domain_path(eag, best, worst)
    >>> sorted(name for crossing in way for name in crossing.vanish)
    ['side', 'top']
    """
    graph = plain_graph(eag)
    for name, node in (("start", start), ("goal", goal)):
        if node not in graph:
            raise EntityError.of_rule(
                name, f"must be a domain of the graph, 0 to {len(graph) - 1}", repr(node)
            )
    place = {node: np.array(point) for node, point in graph.nodes(data="viewpoint")}
    # a crossing weighs more than every way together is long, so that crossings decide first
    crossing = 1.0 + len(place) * float(np.linalg.norm(np.ptp(list(place.values()), axis=0)))

    def weight(i: int, j: int, _: Any) -> float:
        return crossing + float(np.linalg.norm(place[i] - place[j]))

    try:
        way: Sequence[int] = nx.dijkstra_path(graph, start, goal, weight)
    except nx.NetworkXNoPath:
        raise EntityError(
            f"start and goal must be connected by domains. Got {start} and {goal}."
        ) from None
    lists = [graph.nodes[node]["observable"] for node in way]
    return [
        Crossing(node, tuple(n for n in new if n not in old), tuple(n for n in old if n not in new))
        for node, old, new in zip(way[1:], lists, lists[1:], strict=False)
    ]


def check_eag(eag: object) -> None:
    """Refuse what is no `EntityAspectGraph`, where one of networkx does not hold enough.

    Parameters
    ----------
    eag : object
        What was given.

    Raises
    ------
    EntityError
        If it is none.
    """
    if not isinstance(eag, EntityAspectGraph):
        rule = "must be an EntityAspectGraph"
        hint = "build_aspect_graph makes one"
        raise EntityError.of_rule("eag", rule, kind_text(eag), hint=hint)


def plain_graph(eag: EntityAspectGraph | nx.Graph) -> nx.Graph:
    """Return the graph of networkx.

    Parameters
    ----------
    eag : EntityAspectGraph or networkx.Graph
        What was given.

    Raises
    ------
    EntityError
        If it is neither.
    """
    if isinstance(eag, EntityAspectGraph):
        return eag.graph
    if not isinstance(eag, nx.Graph):
        rule = "must be an EntityAspectGraph or a networkx.Graph"
        hint = "build_aspect_graph and read_graphml make one"
        raise EntityError.of_rule("eag", rule, kind_text(eag), hint=hint)
    return eag
