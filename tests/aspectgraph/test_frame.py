"""The part's own frame, unit and order: copies of a part get the same integers, bit for bit."""

from pathlib import Path

import moved_parts
import numpy as np
import pytest
from generated_solids import generated_solid

from aspectgraph.reader import read_solid
from aspectgraph.regions import make_scene
from aspectgraph.solid import Solid

EXAMPLES = Path(__file__).parents[2] / "examples"


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


@pytest.mark.parametrize("first", range(0, 200, 20))
def test_generated_solids(first):
    for seed in range(first, first + 20):
        part = generated_solid(seed)
        assert_same_integers(moved_parts.listed(part.vertices, part.faces, []), np.random.default_rng(seed))


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.st*p")), ids=lambda path: path.stem)
def test_real_parts(path):
    solid = read_solid(path)
    part = moved_parts.listed(solid.vertices, [(face.outer, face.holes) for face in solid.faces], [])
    assert_same_integers(part, np.random.default_rng(0))
