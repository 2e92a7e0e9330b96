"""Surfaces of type C, ruled by three skew edges, never bound a domain of whole-edge observability.

Walk along a segment from a viewpoint that sees an entity to one that does not, halve it until the change is pinned
between two neighbouring grid points, and ask which planes of types A and B (through the entity and a vertex, or through
an end of it and another edge) pass between the two. The referee knows nothing of such planes; if anything else could
make an entity appear, some change would be left unexplained. That the walk would notice is shown by asking for *partly*
visible edges instead, where type C is real.
"""

from itertools import pairwise

import numpy as np
import pytest
from engine_pairs import partition_planes
from exact_checker import ExactChecker, dot
from generated_solids import Part, generated_solid, prism

from aspectgraph.graph.complete_graph import Drawing

STEPS_PER_MM = 2**20


def some_plane_between(planes, p, q):
    """Return whether one of the planes has p and q on different sides, or holds one of them."""
    return any((dot(n, p) - d) * (dot(n, q) - d) <= 0 for n, d in planes)


def pin_down(sees, p, q):
    """Halve the segment from p, which sees, to q, which does not, until the ends are neighbours on the grid."""
    while max(abs(x - y) for x, y in zip(p, q, strict=True)) > 1:
        middle = tuple((x + y) // 2 for x, y in zip(p, q, strict=True))
        p, q = (middle, q) if sees(middle) else (p, middle)
    return p, q


def changes(sees, low, high, rng, n):
    """Yield n pairs of neighbouring grid points, the first of which sees."""
    while n:
        p, q = (tuple(row) for row in rng.integers(low, high, (2, 3)).tolist())
        if sees(p) and not sees(q):
            yield pin_down(sees, p, q)
            n -= 1


@pytest.mark.parametrize("seed", range(30))
def test_every_change_of_whole_edge_observability_is_at_a_plane_of_type_a_or_b(seed):
    part = generated_solid(seed)
    checker = ExactChecker(part.vertices, part.faces, STEPS_PER_MM)
    rng = np.random.default_rng(seed)
    edges = [pair for pair in part.edges() if checker.convexity[pair]]
    low = np.array(checker.vertices).min(axis=0)
    high = np.array(checker.vertices).max(axis=0)
    room = int(2 * (high - low).max())
    for a, b in [edges[i] for i in rng.permutation(len(edges))[:2]]:

        def sees(v, pair=(a, b)):
            point = np.array([v]) / STEPS_PER_MM
            return bool(checker.generic(point)[0] and checker.observable(point, [pair])[0, 0])

        planes = partition_planes(checker, a, b)
        for p, q in changes(sees, low - room, high + room, rng, 3):
            assert some_plane_between(planes, p, q)


def edge_behind_two_plates():
    """Return an edge along x under two plates one above the other, whose edges cross over it: three skew lines."""
    pieces = [
        (prism([(-10, -2), (10, -2), (10, 0), (-10, 0)], 4), -4),
        (prism([(-50, -200), (50, 200), (-400, 200), (-400, -200)], 1), 10),
        (prism([(50, -200), (400, -200), (400, 200), (-50, 200)], 1), 20),
    ]
    vertices = []
    faces = []
    for piece, z in pieces:
        first = len(vertices)
        vertices += [(x, y, height + z) for x, y, height in piece.vertices]
        faces += [(tuple(first + i for i in outer), ()) for outer, _ in piece.faces]
    part = Part("edge behind two plates", tuple(vertices), tuple(faces))
    return part, part.edge_between((-10, 0, 0), (10, 0, 0))


LOW, HIGH = (np.array(corner) * STEPS_PER_MM for corner in ((-15, -15, 40), (15, 15, 60)))


def test_whole_edge_between_three_skew_lines_appears_at_planes_only():
    part, (a, b) = edge_behind_two_plates()
    checker = ExactChecker(part.vertices, part.faces, STEPS_PER_MM)

    def sees(v):
        return bool(checker.observable([np.array(v) / STEPS_PER_MM], [(a, b)])[0, 0])

    wide_low = LOW * np.array([20, 20, 1])
    wide_high = HIGH * np.array([20, 20, 4])
    planes = partition_planes(checker, a, b)
    for p, q in changes(sees, wide_low, wide_high, np.random.default_rng(0), 10):
        assert some_plane_between(planes, p, q)


def test_partly_visible_edge_appears_at_surfaces_of_type_c_too():
    part, (a, b) = edge_behind_two_plates()
    checker = ExactChecker(part.vertices, part.faces, STEPS_PER_MM)
    edges = part.edges()
    triangles = [(loop[0], *pair) for loop, _ in part.faces for pair in pairwise(loop[1:])]
    drawing = Drawing(np.array(part.vertices), np.array(edges), np.array(triangles))

    def sees_partly(v):
        return bool(
            drawing.visible_parts(np.array(v) / STEPS_PER_MM)[edges.index(tuple(sorted((a, b))))]
        )

    planes = partition_planes(checker, a, b)
    found = [
        some_plane_between(planes, p, q)
        for p, q in changes(sees_partly, LOW, HIGH, np.random.default_rng(0), 10)
    ]
    assert found.count(False) >= 5
