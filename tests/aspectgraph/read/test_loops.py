"""Boundary cycles, and the vertices on them that say nothing: by hand."""

from __future__ import annotations

import numpy as np

from aspectgraph.read.join_faces import _split_at_repeats, drop_idle_vertices, turns_of_runs


def prism_of(outline):
    """Vertices and loops of an upright prism over a polygon, and the pairs of its vertical edges."""
    n = len(outline)
    vertices = np.array([[x, y, z] for z in (0.0, 1.0) for x, y in outline])
    walls = [[[i, (i + 1) % n, (i + 1) % n + n, i + n]] for i in range(n)]
    return vertices, [[list(range(n))[::-1]], [list(range(n, 2 * n))], *walls]


def test_a_cycle_that_touches_itself_is_cut_there():
    assert _split_at_repeats([0, 1, 2, 3]) == [[0, 1, 2, 3]]
    # an eight, and a flower whose leaves meet in 9
    assert sorted(map(sorted, _split_at_repeats([0, 1, 2, 3, 1, 4]))) == [[0, 1, 4], [1, 2, 3]]
    leaves = _split_at_repeats([9, 1, 2, 9, 3, 4, 9, 5, 6])
    assert sorted(map(sorted, leaves)) == [[1, 2, 9], [3, 4, 9], [5, 6, 9]]
    assert all(len(set(leaf)) == len(leaf) for leaf in leaves)


def test_vertices_of_a_straight_side_between_two_faces_go():
    """A wall whose foot has two vertices more; of the two faces there only the bottom and that wall know them."""
    vertices, loops = prism_of([(0, 0), (3, 0), (3, 3), (0, 3)])
    vertices = np.vstack([vertices, [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]])
    loops[0] = [[3, 2, 1, 9, 8, 0]]
    loops[2] = [[0, 8, 9, 1, 5, 4]]
    kept, curved = drop_idle_vertices(vertices, loops, set(), 1e-6)
    assert kept[0] == [[3, 2, 1, 0]]
    assert kept[2] == [[0, 1, 5, 4]]
    assert curved == set()
    # as a run of curved chords, it stays curved
    chords = {(0, 8), (8, 9), (1, 9)}
    kept, curved = drop_idle_vertices(vertices, loops, chords, 1e-6)
    assert (kept[0], curved) == ([[3, 2, 1, 0]], {(0, 1)})
    # and the largest turn along it is that of what stands for it
    turns = turns_of_runs(loops, kept, {(0, 8): 5.0, (8, 9): 7.0, (1, 9): 6.0})
    assert turns == {(0, 1): 7.0}


def test_of_a_bent_run_the_vertex_that_leaves_the_line_stays():
    """Vertices at x = 1, 2, 3 of a side of 4: the middle one is 0.01 mm out, the others nearly in line with it."""
    vertices, loops = prism_of([(0, 0), (4, 0), (4, 4), (0, 4)])
    vertices = np.vstack([vertices, [[1.0, -0.005, 0.0], [2.0, -0.01, 0.0], [3.0, -0.005, 0.0]]])
    loops[0] = [[3, 2, 1, 10, 9, 8, 0]]
    loops[2] = [[0, 8, 9, 10, 1, 5, 4]]
    assert drop_idle_vertices(vertices, loops, set(), 1e-3)[0][0] == [[3, 2, 1, 9, 0]]
    assert drop_idle_vertices(vertices, loops, set(), 0.02)[0][0] == [[3, 2, 1, 0]]


def test_a_cycle_that_would_vanish_keeps_its_vertices():
    """Two faces that share all of a triangle with one corner nearly in line: without it there are two vertices."""
    vertices = np.array([[0.0, 0.0, 0.0], [1.0, 1e-9, 0.0], [2.0, 0.0, 0.0]])
    loops = [[[0, 1, 2]], [[2, 1, 0]]]
    kept, _ = drop_idle_vertices(vertices, loops, set(), 1e-6)
    assert kept == loops
