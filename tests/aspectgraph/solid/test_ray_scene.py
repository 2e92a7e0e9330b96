"""Rays: what is in the way is what a ray hits first, and known answers on a block."""

import numpy as np

from aspectgraph import read_solid
from aspectgraph.solid.ray_scene import RayScene


def test_a_block_is_in_the_way_of_what_is_behind_it():
    block = read_solid("examples/two_pocket_block.off")
    scene = RayScene(block.vertices, block.triangles)
    low, high = block.bounds
    middle = (np.array(low) + high) / 2
    eye = np.array([middle[0], middle[1], high[2] + 100.0])
    behind = middle - [0, 0, 200]
    before = eye - [0, 0, 50]
    beside = eye + np.array([500.0, 0, 0])
    towards = np.array([behind, before, beside]) - eye
    assert scene.blocked(eye, towards).tolist() == [True, False, False]


def test_what_is_blocked_is_hit_on_the_way():
    block = read_solid("examples/two_pocket_block.off")
    scene = RayScene(block.vertices, block.triangles, n_threads=1)
    rng = np.random.default_rng(3)
    low, high = (np.asarray(corner, dtype=float) for corner in block.bounds)
    start = (low + high) / 2 + rng.normal(size=(2000, 3)) * 3 * (high - low)
    towards = rng.uniform(low, high, (2000, 3)) - start
    hit = scene.cast(start, towards)["t_hit"]
    assert 100 < (hit < 0.87).sum() < 1900
    for share in (0.87, 1.0):
        sure = np.abs(hit - share) > 1e-4
        assert np.array_equal(scene.blocked(start, towards, share)[sure], (hit < share)[sure])
