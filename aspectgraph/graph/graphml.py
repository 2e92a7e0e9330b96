"""Graph files: GraphML that loses nothing and that networkx, igraph, Gephi, yEd and Cytoscape all read.

GraphML knows booleans, integers, floats and text only, and readers differ in what they make of a missing value. Hence:

* every node has the same attributes, and every edge; a number is finite; a text holds no control characters;
* a vector ``viewpoint`` is three floats ``viewpoint_x``, ``viewpoint_y``, ``viewpoint_z``;
* lists of names, end points, circles and partition surfaces are JSON texts;
* a node also gets ``label`` (its list, or ``None``) and an edge ``label`` (the types of its surfaces) for the programs
  that draw graphs. Both are dropped when the file is read back.

Reference: U. Brandes et al., GraphML progress report, Graph Drawing 2001.
"""

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
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from xml.etree.ElementTree import ParseError

import networkx as nx
import numpy as np

from aspectgraph.exceptions import GraphMLError
from aspectgraph.files import replacing, up_to_limit
from aspectgraph.graph.aspect_graph import PartitionSurface

if TYPE_CHECKING:
    from aspectgraph.graph.aspect_graph import EntityAspectGraph


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
    path = Path(path)
    graph = graph if isinstance(graph, nx.Graph) else graph.graph
    try:
        flat = _flat_graph(graph)
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
    FileNotFoundError
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
    path = Path(path)
    try:
        # what networkx warns of and guesses, a missing type for one, is never in a file of ours
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            flat = nx.read_graphml(io.BytesIO(_content(path)), node_type=int)
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
