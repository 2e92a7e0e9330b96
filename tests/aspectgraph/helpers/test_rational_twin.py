"""The twin: known answers, agreement with the referee, and blocked sets without facets of a third type."""

from fractions import Fraction

import numpy as np
import pytest
from exact_checker import ExactChecker
from generated_solids import (
    CUBE,
    L_BLOCK,
    SLOTTED_BLOCK,
    TWO_POCKET_BLOCK,
    generated_solid,
    pocket_plate,
    prism,
    rotation,
)
from rational_twin import (
    at,
    blocked_set,
    box_cell,
    facets_by_brute_force,
    reduced,
    split,
    twin_graph,
    volume,
)
from solids import SLOT_ENTITIES, SLOT_LISTS, STEP_ENTITIES, TWO_POCKET_ENTITIES, TWO_POCKET_LISTS


def twin(part, entities=None, reach=60, number=int):
    """Return the twin's graph; entities: name -> vertex pair, or all edges."""
    checker = ExactChecker(part.vertices, part.faces)
    entities = (
        {f"e{i}": pair for i, pair in enumerate(part.edges())} if entities is None else entities
    )
    return twin_graph(checker, entities, (-reach,) * 3, (reach + 1,) * 3, number)


def named(part, entities):
    return {name: part.edge_between(*ends) for name, ends in entities.items()}


def in_order(lists):
    return sorted(sorted(names) for names in lists)


@pytest.mark.parametrize(
    ("part", "entities", "domains", "adjacencies", "distinct"),
    [
        (CUBE, None, 26, 48, 26),
        (L_BLOCK, None, 55, 116, 55),
        (prism([(0, 0), (7, 0), (7, 2), (3, 2), (3, 5), (0, 5)], 4), None, 55, 116, 55),
        (L_BLOCK, STEP_ENTITIES, 20, 40, 13),
        (SLOTTED_BLOCK, SLOT_ENTITIES, 8, 11, 8),
        (TWO_POCKET_BLOCK, TWO_POCKET_ENTITIES, 9, 13, 9),
    ],
    ids=["cube", "L-block", "other L-block", "L-block step", "Table I", "Table II"],
)
def test_known_answers(part, entities, domains, adjacencies, distinct):
    graph = twin(part, entities and named(part, entities))
    assert (len(graph.lists), len(graph.adjacencies), len(set(graph.lists))) == (
        domains,
        adjacencies,
        distinct,
    )


def test_lists_of_the_papers_tables():
    assert in_order(twin(SLOTTED_BLOCK, named(SLOTTED_BLOCK, SLOT_ENTITIES)).lists) == in_order(
        SLOT_LISTS
    )
    pockets = twin(TWO_POCKET_BLOCK, named(TWO_POCKET_BLOCK, TWO_POCKET_ENTITIES))
    assert in_order(pockets.lists) == in_order(TWO_POCKET_LISTS)


@pytest.mark.parametrize(
    ("part", "inside"),
    [(CUBE, 8), (L_BLOCK, 8), (SLOTTED_BLOCK, 6 * 20), (TWO_POCKET_BLOCK, 144 - 8)],
)
def test_domains_fill_the_workspace_outside_the_solid(part, inside):
    graph = twin(part, reach=20)
    assert sum(graph.volumes()) == 41**3 - inside


def test_volumes_of_the_cube_domains():
    volumes = twin(CUBE, reach=4).volumes()
    # The cube is [0, 2]³ in [-4, 5]³: slabs of 4, 2 and 3 mm along each axis.
    assert sorted(volumes) == sorted(
        x * y * z for x in (4, 2, 3) for y in (4, 2, 3) for z in (4, 2, 3) if x * y * z != 8
    )


def test_fractions_and_integers_give_the_same_graph():
    plain, fast = (
        twin(TWO_POCKET_BLOCK, named(TWO_POCKET_BLOCK, TWO_POCKET_ENTITIES), 60, kind)
        for kind in (Fraction, int)
    )
    assert plain.lists == fast.lists
    assert plain.adjacencies == fast.adjacencies
    assert plain.volumes() == fast.volumes()


@pytest.mark.parametrize("seed", range(10))
def test_every_point_gets_the_list_the_referee_gives_it(seed):
    part = generated_solid(seed)
    checker = ExactChecker(part.vertices, part.faces, 16)
    entities = dict(list({f"e{i}": pair for i, pair in enumerate(part.edges())}.items())[::2])
    reach = 4 + int(np.abs(part.vertices).max())
    graph = twin(part, entities, reach)
    rng = np.random.default_rng(seed)
    points = rng.integers(-reach * 16, reach * 16, (40, 3))
    points = points[checker.generic(points / 16)]
    seen = checker.observable(points / 16, list(entities.values()))
    inside = checker.contains(points / 16)
    planes = [plane for cells in graph.cells for cell in cells for plane, _ in cell]
    generic = [all(at(plane, (*point, 16)) for plane in planes) for point in points.tolist()]
    assert sum(generic) > 10
    for point, row, covered in zip(
        points[generic].tolist(), seen[generic], inside[generic], strict=True
    ):
        expected = {name for name, visible in zip(entities, row, strict=True) if visible}
        found = [
            graph.lists[k]
            for k, cells in enumerate(graph.cells)
            for c in cells
            if _strictly_in((*point, 16), c)
        ]
        assert found == ([] if covered else [expected])


def _strictly_in(point, cell):
    return max(at(plane, point) for plane, _ in cell) < 0


@pytest.mark.parametrize("seed", [0, 3, 5, 7])
def test_order_of_entities_does_not_matter(seed):
    part = generated_solid(seed)
    entities = {f"e{i}": pair for i, pair in enumerate(part.edges()[:8])}
    forward = twin(part, entities)
    backward = twin(part, dict(reversed(entities.items())))
    assert in_order(forward.lists) == in_order(backward.lists)
    assert sorted(forward.volumes()) == sorted(backward.volumes())
    assert len(forward.adjacencies) == len(backward.adjacencies)


@pytest.mark.parametrize("quaternion", [(1, 1, 0, 0), (1, 1, 1, 0), (2, 1, 0, 1)])
def test_rotated_copy_has_the_same_graph(quaternion):
    turned = L_BLOCK.mapped(rotation(quaternion), "turned")
    entities = named(L_BLOCK, STEP_ENTITIES)
    graph = twin(L_BLOCK, entities)
    other = twin(turned, entities, 400)
    assert in_order(graph.lists) == in_order(other.lists)
    assert len(graph.adjacencies) == len(other.adjacencies)


def test_chain_of_collinear_edges_is_one_entity():
    # A notch in the far side splits the face behind, not the near edge; halving an edge by hand makes a chain.
    part, _ = pocket_plate(1)
    vertices = (*part.vertices, (2, 0, 0))
    ends = part.edge_between((0, 0, 0), (4, 0, 0))
    faces = [(_halved(outer, ends, 16), holes) for outer, holes in part.faces]
    halved = part._replace(vertices=vertices, faces=tuple(faces))
    chain = twin(halved, {"e": (ends[0], 16, ends[1])})
    single = twin(part, {"e": ends})
    assert sorted(chain.volumes()) == sorted(single.volumes())


def _halved(loop, ends, middle):
    result = []
    for i, vertex in enumerate(loop):
        result.append(vertex)
        if {vertex, loop[(i + 1) % len(loop)]} == set(ends):
            result.append(middle)
    return tuple(result)


def random_occluder(rng):
    """Return a convex polygon in a random plane, that plane, and a segment with a part in front of it."""
    while True:
        origin, u, w = rng.integers(-5, 6, (3, 3))
        corners = [(0, 0), (3, 0), (4, 2), (2, 4), (0, 3)][: rng.integers(3, 6)]
        piece = [(*(origin + x * u + y * w).tolist(), 1) for x, y in corners]
        normal = np.cross(u, w)
        plane = (*normal.tolist(), int(normal @ origin))
        a, b = ((*p, 1) for p in rng.integers(-9, 10, (2, 3)).tolist())
        if normal.any() and a != b and max(at(plane, a), at(plane, b)) > 0:
            return piece, plane, a, b


@pytest.mark.parametrize("seed", range(60))
def test_blocked_set_has_facets_of_types_a_and_b_only(seed):
    """Any three generators of the blocked set are tried; a facet of another kind would be missing on one side."""
    piece, plane, a, b = random_occluder(np.random.default_rng(seed))
    planes = blocked_set(piece, plane, a, b)
    if min(at(plane, a), at(plane, b)) >= 0:
        scaled = set(map(reduced, planes))
        assert {p for p in scaled if _is_needed(p, scaled)} == facets_by_brute_force(piece, a, b)


def _is_needed(plane, planes):
    """Return whether a half-space is not implied by the others, seen in a box large against the figure."""
    rest = box_cell((-9999,) * 3, (9999,) * 3)
    for other in planes - {plane}:
        rest, _ = split(rest, other)
    return split(rest, plane)[1] is not None and volume(split(rest, plane)[1]) > 0
