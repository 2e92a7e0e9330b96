"""Parts moved, turned, scaled and listed in another order, and whether their graphs are the same."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import networkx as nx
import numpy as np
from scipy.spatial.transform import Rotation

from aspectgraph.entities.entity import resolve_entities
from aspectgraph.graph.build_graph import build_aspect_graph
from aspectgraph.read.part_file import read_solid
from aspectgraph.solid.solid import Solid


class Listed(NamedTuple):
    """A solid as vertices, faces as (outer loop, (hole, ...)), and entities as vertex pairs by name."""

    vertices: np.ndarray
    faces: list
    entities: dict[str, tuple[int, int]]


def listed(vertices, faces, pairs) -> Listed:
    """Return a part with the entities e0, e1, …"""
    return Listed(
        np.array(vertices, dtype=float),
        list(faces),
        {f"e{i}": tuple(pair) for i, pair in enumerate(pairs)},
    )


def from_file(path: Path, n_entities: int) -> Listed:
    """Return the part in a file with its first edges."""
    solid = read_solid(path)
    faces = [(face.outer, face.holes) for face in solid.faces]
    return listed(
        solid.vertices, faces, [edge.vertices for edge in solid.straight_edges()][:n_entities]
    )


def moved(part: Listed, rng: np.random.Generator, turn: Rotation | None = None) -> Listed:
    """Return the part turned at random (or by `turn`), scaled by 1/100 to 100 and shifted."""
    turn = Rotation.random(random_state=int(rng.integers(2**31))) if turn is None else turn
    vertices = turn.apply(part.vertices) * 10 ** rng.uniform(-2, 2) + rng.uniform(-100, 100, 3)
    return part._replace(vertices=vertices)


def shuffled(part: Listed, rng: np.random.Generator) -> Listed:
    """Return the part with vertices, faces, starts of loops, entities and their ends in random order."""
    order = rng.permutation(len(part.vertices))
    place = np.argsort(order)

    def renumbered(loop):
        start = rng.integers(len(loop))
        return tuple(int(place[i]) for i in (*loop[start:], *loop[:start]))

    faces = [(renumbered(outer), tuple(map(renumbered, holes))) for outer, holes in part.faces]
    names = [list(part.entities)[i] for i in rng.permutation(len(part.entities))]
    entities = {
        name: tuple(place[list(part.entities[name])][:: rng.choice([1, -1])].tolist())
        for name in names
    }
    return Listed(part.vertices[order], [faces[i] for i in rng.permutation(len(faces))], entities)


def graph_of(part: Listed, room: float = 200.0) -> nx.Graph:
    """Return the graph in a cube reaching `room` diagonals from the part: wide, because it does not turn with it."""
    solid = Solid(part.vertices, part.faces)
    low, high = solid.bounds
    centre = (low + high) / 2
    reach = room * np.linalg.norm(high - low)
    ends = {name: solid.vertices[list(pair)] for name, pair in part.entities.items()}
    entities = resolve_entities(solid, ends, min_dihedral_deg=1e-3)
    return build_aspect_graph(solid, entities, (centre - reach, centre + reach)).graph


def same_graph(one: nx.Graph, other: nx.Graph) -> bool:
    """Return whether graphs agree in lists, degrees and adjacencies, whatever the order of their nodes."""
    one, other = (nx.Graph(graph) for graph in (one, other))
    for graph in (one, other):
        nx.set_node_attributes(
            graph, {k: frozenset(names) for k, names in graph.nodes(data="observable")}, "list"
        )
    return nx.is_isomorphic(one, other, node_match=lambda p, q: p["list"] == q["list"])
