"""The part's own frame, unit and order: copies of a part get the same integers, bit for bit."""

from pathlib import Path

import moved_parts
import numpy as np
import pytest
from generated_solids import CUBE, L_BLOCK, SLOTTED_BLOCK, TWO_POCKET_BLOCK, generated_solid
from scipy.spatial.transform import Rotation

from aspectgraph.exact.grid import own_frame
from aspectgraph.read.part_file import read_solid
from aspectgraph.solid.solid import Solid
from aspectgraph.visibility.scene import make_scene

EXAMPLES = Path(__file__).parents[3] / "examples"


def scene_of(part):
    return make_scene(Solid(part.vertices, part.faces))


def in_own_numbers(scene):
    """What the engine works on, vertices by their places: points, planes and pieces with their planes, in order."""
    pieces = scene.pieces
    planes = scene.plane_of_face[pieces.face], scene.side_of_face[pieces.face]
    return [
        np.unique(scene.points, axis=0),
        scene.planes,
        scene.points[pieces.vertices],
        pieces.first,
        *planes,
        np.array(scene.resolution),
    ]


def assert_same_integers(part, rng):
    grid, scene = scene_of(part)
    copy = moved_parts.shuffled(moved_parts.moved(part, rng), rng)
    other_grid, other = scene_of(copy)
    for one, two in zip(in_own_numbers(scene), in_own_numbers(other), strict=True):
        assert one.shape == two.shape
        assert (one == two).all()
    assert other_grid.scale == pytest.approx(grid.scale, rel=1e-9)


@pytest.mark.parametrize("first", range(0, 60, 20))
def test_generated_solids(first):
    for seed in range(first, first + 20):
        part = generated_solid(seed)
        assert_same_integers(
            moved_parts.listed(part.vertices, part.faces, []), np.random.default_rng(seed)
        )


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.st*p")), ids=lambda path: path.stem)
def test_real_parts(path):
    solid = read_solid(path)
    part = moved_parts.listed(
        solid.vertices, [(face.outer, face.holes) for face in solid.faces], []
    )
    assert_same_integers(part, np.random.default_rng(0))


@pytest.mark.parametrize("turn", Rotation.create_group("O").as_matrix().round()[::3])
@pytest.mark.parametrize(
    "part", [CUBE, L_BLOCK, SLOTTED_BLOCK, TWO_POCKET_BLOCK], ids=lambda part: part.name
)
def test_frame_of_an_axis_aligned_part_is_exactly_a_signed_permutation(part, turn):
    frame = own_frame(Solid(np.array(part.vertices) @ turn.T * 0.7 + 3.3, part.faces))
    assert sorted(np.abs(frame).ravel()) == [0.0] * 6 + [1.0] * 3
    assert np.linalg.det(frame) == 1.0


@pytest.mark.parametrize("seed", range(10))
def test_frame_is_a_rotation_along_faces_and_edges_of_the_part(seed):
    part = generated_solid(seed)
    solid = Solid(
        Rotation.random(random_state=seed).apply(np.array(part.vertices, dtype=float)), part.faces
    )
    frame = own_frame(solid)
    assert frame @ frame.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(frame) == pytest.approx(1.0)
    runs = np.array([np.subtract(*solid.edge_points(edge.id)) for edge in solid.edges])
    runs /= np.linalg.norm(runs, axis=1, keepdims=True)
    x, _, z = frame
    assert np.abs(solid.normals @ z).max() == pytest.approx(1.0)
    assert max(np.abs(solid.normals @ x).max(), np.abs(runs @ x).max()) == pytest.approx(1.0)


def test_entities_tell_the_sides_of_a_symmetric_part_apart():
    """Turned about each other's axes, cubes with one marked edge: the edge comes to the same place on the grid."""
    places = set()
    for k, turn in enumerate(Rotation.create_group("O")):
        vertices = turn.apply(np.array(CUBE.vertices, dtype=float))
        solid = Solid(vertices, CUBE.faces)
        ends = (vertices - vertices.mean(axis=0))[list(solid.edges[5].vertices)] @ own_frame(
            solid, [[5]]
        ).T
        places.add(frozenset(map(tuple, ends.round(9).tolist())))
        assert len(places) == 1, k
