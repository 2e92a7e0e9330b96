"""Parts moved, turned, scaled and listed in another order, and parts with one very small detail."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import networkx as nx
import numpy as np
from generated_solids import Part, cell_solid, rotation
from scipy.spatial.transform import Rotation

from aspectgraph.entities.entity import resolve_entities
from aspectgraph.graph.build_graph import build_aspect_graph
from aspectgraph.read.part_file import read_solid
from aspectgraph.solid.solid import Solid

# Parts moved, turned, scaled and listed in another order, and whether their graphs are the same.


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


# Parts with one very small detail, in units of 2⁻³⁴ of a size: coordinates are whole numbers and
# yet fit no grid.
#
# Sizes and places are random to the last unit: no common denominator is small, so the engine has
# to displace vertices.


SIZE = 1 << 34

# small in one direction only; snapping turns no partition plane through such a detail noticeably
THIN = ("gap", "offset gap", "stack", "slot", "step", "wall", "plate", "wedge")
# small in two or three directions
TINY = ("groove", "rib", "bump", "pocket")

_TURNS = ((2, 1, 0, 0), (1, 1, 1, 0), (1, 2, 0, 1), (2, 1, 1, 1))


def fine_part(kind: str, share: float, seed: int, turned: bool) -> Part:
    """Return a part whose detail measures about `share` of `SIZE`."""
    rng = np.random.default_rng(seed)
    part = _MAKERS[kind](_Sizes(rng, share))
    return part.mapped(rotation(_TURNS[seed % len(_TURNS)]), f"turned {kind}") if turned else part


class _Sizes:
    """Random lengths: of the part, and of its detail."""

    def __init__(self, rng: np.random.Generator, share: float):
        self.rng = rng
        self.share = share

    def large(self) -> int:
        return int(SIZE * self.rng.uniform(0.3, 0.4))

    def small(self) -> int:
        return max(2, int(SIZE * self.share * self.rng.uniform(1.0, 2.0)))


def _boxes(*corners) -> Part:
    vertices = []
    faces = []
    for low, high in corners:
        box = cell_solid(np.ones((1, 1, 1), bool), list(zip(low, high, strict=True)))
        faces += [(tuple(i + len(vertices) for i in outer), ()) for outer, _ in box.faces]
        vertices += box.vertices
    return Part("boxes", tuple(vertices), tuple(faces))


def _gap(sizes) -> Part:
    x = sizes.large()
    y = sizes.large()
    z = sizes.large()
    gap = sizes.small()
    return _boxes(((0, 0, 0), (x, y, z)), ((x + gap, 0, 0), (x + gap + sizes.large(), y, z)))


def _offset_gap(sizes) -> Part:
    x = sizes.large()
    y = sizes.large()
    z = sizes.large()
    gap = sizes.small()
    return _boxes(
        ((0, 0, 0), (x, y, z)),
        ((x + gap, y // 5, z // 7), (x + gap + sizes.large(), y // 2, 2 * z)),
    )


def _stack(sizes) -> Part:
    """Two thin plates: the usual grid is far coarser across them than it has to be."""
    x = sizes.large()
    y = sizes.large()
    gap = sizes.small()
    thick = sizes.large() // 100
    return _boxes(
        ((0, 0, 0), (x, y, thick)),
        ((x // 9, y // 8, thick + gap), (x // 2, y // 2, 2 * thick + gap)),
    )


def _profile(solid_columns: tuple[bool, bool, bool], sizes, width: int, height: int) -> Part:
    full = np.ones((3, 1, 2), bool)
    full[:, 0, 1] = solid_columns
    x = sizes.large()
    z = sizes.large()
    ticks = [[0, x, x + width, x + width + sizes.large()], [0, sizes.large()], [0, z, z + height]]
    return cell_solid(full, ticks)


def _step(sizes) -> Part:
    full = np.ones((2, 1, 2), bool)
    full[1, 0, 1] = False
    x = sizes.large()
    z = sizes.large()
    return cell_solid(
        full, [[0, x, x + sizes.large()], [0, sizes.large()], [0, z, z + sizes.small()]]
    )


def _plate(sizes) -> Part:
    return _boxes(((0, 0, 0), (sizes.large(), sizes.large(), sizes.small())))


def _wedge(sizes) -> Part:
    x = sizes.large()
    thick = sizes.small()
    y = sizes.large()
    more = 9
    vertices = (
        (0, 0, 0),
        (x, 0, 0),
        (x, thick, 0),
        (0, 0, y),
        (x, 0, y + more),
        (x, thick, y + more),
    )
    faces = ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5))
    return Part("wedge", vertices, tuple((face, ()) for face in faces))


def _on_top(middle: bool, sizes) -> Part:
    full = np.ones((3, 3, 2), bool)
    full[:, :, 1] = not middle
    full[1, 1, 1] = middle
    x = sizes.large()
    y = sizes.large()
    z = sizes.large()
    u = sizes.small()
    v = sizes.small()
    w = sizes.small()
    ticks = [
        [0, x, x + u, x + u + sizes.large()],
        [0, y, y + v, y + v + sizes.large()],
        [0, z, z + w],
    ]
    return cell_solid(full, ticks)


_MAKERS = {
    "gap": _gap,
    "offset gap": _offset_gap,
    "stack": _stack,
    "slot": lambda sizes: _profile((True, False, True), sizes, sizes.small(), sizes.large()),
    "wall": lambda sizes: _profile((False, True, False), sizes, sizes.small(), sizes.large()),
    "step": _step,
    "plate": _plate,
    "wedge": _wedge,
    "groove": lambda sizes: _profile((True, False, True), sizes, sizes.small(), sizes.small()),
    "rib": lambda sizes: _profile((False, True, False), sizes, sizes.small(), sizes.small()),
    "bump": lambda sizes: _on_top(True, sizes),
    "pocket": lambda sizes: _on_top(False, sizes),
}
