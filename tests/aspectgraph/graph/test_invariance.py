"""The graph of a part must not change when the part is moved, turned, scaled, or listed in another order."""

from pathlib import Path

import moved_parts
import numpy as np
import pytest
from engine_pairs import (
    STEPS_PER_MM,
    entities_of,
    sharp_edges,
    solid_of,
    uniform_viewpoints,
    workspace_of,
)
from exact_checker import ExactChecker
from generated_solids import (
    CUBE,
    L_BLOCK,
    SLOTTED_BLOCK,
    TWO_POCKET_BLOCK,
    generated_solid,
    rotation,
)
from scipy.spatial.transform import Rotation
from solids import SLOT_ENTITIES, STEP_ENTITIES, TWO_POCKET_ENTITIES

from aspectgraph.graph.build_graph import build_aspect_graph
from aspectgraph.solid.solid import Solid
from aspectgraph.visibility.visibility_regions import compute_regions

EXAMPLES = Path(__file__).parents[3] / "examples"
KNOWN = {
    "cube": (CUBE, CUBE.edges()),
    "L-block": (L_BLOCK, L_BLOCK.edges()),
    "L-block step": (L_BLOCK, [L_BLOCK.edge_between(*ends) for ends in STEP_ENTITIES.values()]),
    "slotted block": (
        SLOTTED_BLOCK,
        [SLOTTED_BLOCK.edge_between(*ends) for ends in SLOT_ENTITIES.values()],
    ),
    "two pockets": (
        TWO_POCKET_BLOCK,
        [TWO_POCKET_BLOCK.edge_between(*e) for e in TWO_POCKET_ENTITIES.values()],
    ),
}


def graph_of(vertices, faces, pairs, room=20.0):
    """Return the graph of vertex pairs in a cube reaching `room` diagonals from the part: wide, to outdo its turn."""
    solid = Solid(vertices, faces)
    low, high = solid.bounds
    centre = (low + high) / 2
    reach = room * np.linalg.norm(high - low)
    return build_aspect_graph(
        solid, entities_of(solid, pairs), (centre - reach, centre + reach)
    ).graph


@pytest.fixture(scope="module")
def reference():
    return {
        name: graph_of(part.vertices, part.faces, pairs) for name, (part, pairs) in KNOWN.items()
    }


@pytest.mark.parametrize("name", KNOWN)
@pytest.mark.parametrize("seed", range(2))
def test_any_rotation_scale_and_place(reference, name, seed):
    part, pairs = KNOWN[name]
    rng = np.random.default_rng(seed)
    turned = np.array(part.vertices) @ Rotation.random(random_state=seed).as_matrix().T
    moved = turned * 10 ** rng.uniform(-2, 2) + rng.uniform(-100, 100, 3)
    assert moved_parts.same_graph(graph_of(moved, part.faces, pairs), reference[name])


@pytest.mark.parametrize("seed", [1, 2, 4, 6, 7, 9, 10, 12])
def test_any_rotation_of_generated_solids(seed):
    part = generated_solid(seed)
    pairs = sharp_edges(part, ExactChecker(part.vertices, part.faces))[::3]
    turned = Rotation.random(random_state=seed).apply(np.array(part.vertices, dtype=float))
    assert moved_parts.same_graph(
        graph_of(turned, part.faces, pairs), graph_of(part.vertices, part.faces, pairs)
    )


# Copies whose graph once differed: a sliver of a wide domain parted others (46, 26, 146, 25), a strip or a gap left by
# snapping counted (8, 33, 438, 443), a contact is hardly wide enough (63), planes that are parallel met far away
# (208, 468). The last three always agreed.
@pytest.mark.parametrize(
    ("seed", "turn"),
    [
        (46, 0),
        (8, 3),
        (25, 3),
        (26, 0),
        (33, 2),
        (146, 3),
        (63, 0),
        (208, 0),
        (208, 1),
        (468, 0),
        (438, 0),
        (443, 1),
        (100, 0),
        (103, 1),
        (109, 0),
    ],
)
def test_turned_shifted_scaled_and_shuffled_copies(seed, turn):
    part = generated_solid(seed)
    pairs = sharp_edges(part, ExactChecker(part.vertices, part.faces))[::2]
    original = moved_parts.listed(part.vertices, part.faces, pairs)
    rng = np.random.default_rng([seed, turn])
    copy = moved_parts.moved(original, rng, Rotation.random(random_state=0) if seed == 46 else None)
    graphs = [
        moved_parts.graph_of(variant) for variant in (original, moved_parts.shuffled(copy, rng))
    ]
    assert moved_parts.same_graph(*graphs)


@pytest.mark.parametrize("first", range(500, 520, 10))
def test_copies_of_many_solids(first):
    for seed in range(first, first + 10):
        part = generated_solid(seed)
        pairs = sharp_edges(part, ExactChecker(part.vertices, part.faces))[::4]
        original = moved_parts.listed(part.vertices, part.faces, pairs)
        rng = np.random.default_rng(seed)
        copy = moved_parts.shuffled(moved_parts.moved(original, rng), rng)
        graphs = [moved_parts.graph_of(variant, room=50.0) for variant in (original, copy)]
        assert moved_parts.same_graph(*graphs), seed


@pytest.mark.parametrize(
    ("name", "n_entities"),
    [("nist_ctc_01_ap242.stp", 6), ("mfcad_4-5-5-6-9-23.step", 12), ("mfcad_6-11-11-19.step", 12)],
)
def test_copy_of_a_real_part_in_another_workspace(name, n_entities):
    """Coordinates that fit no grid, curved faces: copies are displaced alike, and cut alike whatever the workspace."""
    part = moved_parts.from_file(EXAMPLES / name, n_entities)
    rng = np.random.default_rng(1)
    copy = moved_parts.shuffled(moved_parts.moved(part, rng), rng)
    graph = moved_parts.graph_of(part, room=60.0)
    other = moved_parts.graph_of(copy, room=200.0)
    assert graph.graph["snapping_mm"] > 0
    assert moved_parts.same_graph(graph, other)


@pytest.mark.parametrize("name", KNOWN)
def test_mirror_image(reference, name):
    part, pairs = KNOWN[name]
    faces = [(outer[::-1], tuple(hole[::-1] for hole in holes)) for outer, holes in part.faces]
    mirrored = np.array(part.vertices) * (-1, 1, 1)
    assert moved_parts.same_graph(graph_of(mirrored, faces, pairs), reference[name])


@pytest.mark.parametrize("name", KNOWN)
@pytest.mark.parametrize("seed", range(2))
def test_order_of_vertices_faces_loops_and_entities(reference, name, seed):
    part, pairs = KNOWN[name]
    known = moved_parts.Listed(
        np.array(part.vertices, dtype=float),
        part.faces,
        {f"e{i}": pair for i, pair in enumerate(pairs)},
    )
    moved = moved_parts.shuffled(known, np.random.default_rng(seed))
    graph = graph_of(moved.vertices, moved.faces, list(moved.entities.values()))
    names = {f"e{new}": old for new, old in enumerate(moved.entities)}
    for _, node in graph.nodes(data=True):
        node["observable"] = tuple(names[name] for name in node["observable"])
    assert moved_parts.same_graph(graph, reference[name])


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 5, 6, 7, 14])
@pytest.mark.parametrize("quaternion", [(1, 1, 1, 0), (1, 2, 3, 4)])
def test_exactly_rotated_generated_solids(seed, quaternion):
    """Integer rotations need no snapping: nothing but the workspace's turn can make a difference, so it is wide."""
    part = generated_solid(seed)
    pairs = sharp_edges(part, ExactChecker(part.vertices, part.faces))[::3]
    turned = part.mapped(rotation(quaternion), "turned")
    graph, other = (graph_of(p.vertices, p.faces, pairs, room=100.0) for p in (part, turned))
    assert moved_parts.same_graph(graph, other)


@pytest.mark.parametrize("seed", range(0, 60, 2))
def test_snapping_a_rotated_part_moves_no_boundary_by_more_than_it_must(seed):
    """The referee answers for the unrotated part; only at viewpoints on a partition plane may the two differ."""
    part = generated_solid(seed)
    checker = ExactChecker(part.vertices, part.faces, STEPS_PER_MM)
    pairs = sharp_edges(part, checker)
    rng = np.random.default_rng(seed)
    points = uniform_viewpoints(rng, workspace_of(part), 60)
    points = points[checker.generic(points)]
    turn = Rotation.random(random_state=seed)
    scale = 10 ** rng.uniform(-2, 2)
    shift = rng.uniform(-50, 50, 3)
    solid = Solid(turn.apply(np.array(part.vertices, dtype=float)) * scale + shift, part.faces)
    moved = turn.apply(points) * scale + shift
    box = (moved.min(axis=0) - 1000 * scale, moved.max(axis=0) + 1000 * scale)
    regions = compute_regions(solid, entities_of(solid, pairs), box)
    wrong = np.argwhere(regions.observable(moved) != checker.observable(points, pairs))
    assert all(distance_to_partition_planes(part, pairs[k], points[i]) < 1e-4 for i, k in wrong)
    assert len(wrong) <= 2


def distance_to_partition_planes(part, pair, point):
    """Return the distance in mm to the nearest plane through the entity and a vertex, or its end and an edge."""
    vertices = np.array(part.vertices, dtype=float)
    a, b = vertices[list(pair)]
    trios = [(a, b, w) for w in vertices] + [
        (end, *vertices[list(e)]) for end in (a, b) for e in part.edges()
    ]
    base = np.array([trio[0] for trio in trios])
    normals = np.array([np.cross(q - p, r - p) for p, q, r in trios])
    length = np.linalg.norm(normals, axis=1)
    return np.min(np.abs(((point - base) * normals).sum(axis=1))[length > 0] / length[length > 0])


@pytest.mark.parametrize("seed", range(10))
def test_every_adjacency_shows_a_surface_of_every_entity_that_changes(seed):
    part = generated_solid(seed)
    solid = solid_of(part)
    pairs = sharp_edges(part, ExactChecker(part.vertices, part.faces))[::2]
    graph = build_aspect_graph(solid, entities_of(solid, pairs), workspace_of(part)).graph
    for i, j, edge in graph.edges(data=True):
        changed = set(graph.nodes[i]["observable"]) ^ set(graph.nodes[j]["observable"])
        assert {surface.entity for surface in edge["surfaces"]} == changed
        assert {surface.type for surface in edge["surfaces"]} <= {"A", "B"}
