"""What a stated probability means: parts are never exactly nominal, so the phases of the pixel grid are random."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from one_grid import OneGrid
from scipy.spatial.transform import Rotation
from scipy.stats import binom

from aspectgraph import read_solid
from planner import Camera, Effort, PoseUncertainty, plan_inspection
from planner.request.models import Means
from planner.request.request import Objective
from planner.verify.simulate_setting import simulate_setting

CAMERA = Camera(8.0, (0.00345, 0.00345), (2448, 2048), f_number=8.0, focus_distance_mm=300.0)
DEPTH = 300.0
RIMS = {"e1": [[60, 20, 10], [60, 40, 10]], "e4": [[20, 60, 10], [40, 60, 10]]}
EFFORT = Effort(viewpoints=20, pricing_rounds=2, refutations=1, bound_nodes=1000)
SLIDE = np.diag(
    [2.0**2, 0, 0, 0, 0, 0]
)  # mm: some tens of pixels, so that the edge begins anywhere


def _across(length_px):
    """An edge along the image's x axis, so many pixels long, seen from the origin along z."""
    half = 0.5 * length_px * CAMERA.pixel_pitch_mm[0] * DEPTH / CAMERA.image_distance_mm
    return np.array([[-half, 0.0, DEPTH], [half, 0.0, DEPTH]])


def _simulated(length_px, tolerance_px, n, **options):
    posed = SimpleNamespace(cam2world=np.eye(4), entities=("e",), probability={})
    accuracy = 1.0 - tolerance_px / length_px
    ends = {"e": _across(length_px)}
    uncertainty = PoseUncertainty(SLIDE)
    rates = simulate_setting(posed, ends, CAMERA, uncertainty, accuracy=accuracy, n=n, **options)
    return rates["e"].frequency


@pytest.mark.parametrize("tolerance_px", [0.2, 0.4, 0.7])
def test_one_grid_averaged_over_lengths_is_the_papers_density(tolerance_px):
    """n + f px are read as n px with chance 1 - f, otherwise as n + 1: over f that is 1 - (1 - tolerance)²."""
    expected = 1.0 - (1.0 - tolerance_px) ** 2
    lengths = 50.0 + (np.arange(100) + 0.5) / 100
    on_one_grid = [_simulated(px, tolerance_px, 300, rng=OneGrid()) for px in lengths]
    # they are far apart: what holds for one length is false for another
    assert max(on_one_grid) - min(on_one_grid) > 0.3
    assert np.mean(on_one_grid) == pytest.approx(expected, abs=0.01)
    # of any single length, with random phases
    assert _simulated(50.2, tolerance_px, 40_000) == pytest.approx(expected, abs=0.01)
    edge = _across(50.2)
    law = Objective.of_edges(
        edge[None], Means(CAMERA, PoseUncertainty(SLIDE), 1.0 - tolerance_px / 50.2)
    )
    assert law.probability(np.eye(4)[None])[0, 0] == pytest.approx(expected, abs=2e-3)


def _share_accurate(ends, cam2world, uncertainty, accuracy, n, rng):
    """Measure an edge of n parts from n displaced poses with own projection; return how often that is accurate.

    Each end of the part is off by up to half a pixel's width in both directions across the view.
    """
    f = CAMERA.image_distance_mm / CAMERA.pixel_pitch_mm[0]
    middle = (np.array(CAMERA.resolution) - 1) / 2
    moves = rng.multivariate_normal(np.zeros(6), uncertainty.covariance, n)
    turn = Rotation.from_matrix(cam2world[:3, :3]) * Rotation.from_rotvec(moves[:, 3:])
    place = cam2world[:3, 3] + moves[:, :3] @ cam2world[:3, :3].T

    def image(points):
        seen = np.stack([turn.inv().apply(points[:, i] - place) for i in range(2)], axis=1)
        return f * seen[..., :2] / seen[..., 2:] + middle

    still = (np.asarray(ends, dtype=float) - cam2world[:3, 3]) @ cam2world[:3, :3]
    flat = rng.uniform(-0.5, 0.5, (n, 2, 2)) * still[:, 2:] / f
    parts = still + np.concatenate([flat, np.zeros((n, 2, 1))], axis=2)
    image_px = image(parts @ cam2world[:3, :3].T + cam2world[:3, 3])
    planned_px = f * parts[..., :2] / parts[..., 2:]
    length = np.linalg.norm(planned_px[:, 1] - planned_px[:, 0], axis=1)
    whole = np.linalg.norm(np.rint(image_px[:, 1]) - np.rint(image_px[:, 0]), axis=1)
    return np.abs(whole - length) <= (1.0 - accuracy) * length


def _planned(accuracy, probability):
    solid = read_solid("examples/two_pocket_block.off")
    camera = Camera.named("basler-acA2440-20gm-8mm")
    uncertainty = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.0005)
    return plan_inspection(
        solid, RIMS, camera, uncertainty, accuracy=accuracy, probability=probability, effort=EFFORT
    )


@pytest.fixture(scope="module")
def fine_plan():
    return _planned(0.996, 0.6)


def test_a_promise_under_two_pixels_holds_for_parts_of_any_length(fine_plan):
    """Own projection, own draws: 0.5 to 1 px are permitted, and the ends fall anywhere within a pixel."""
    assert fine_plan.complete
    rng = np.random.default_rng(11)
    n = 40_000
    for setting in fine_plan.settings:
        for name in setting.entities:
            stated = setting.probability[name]
            args = setting.cam2world, fine_plan.pose_uncertainty, fine_plan.accuracy, n, rng
            accurate = _share_accurate(fine_plan.entities[name], *args)
            assert stated < 0.995
            assert binom.cdf(accurate.sum(), n, stated) > 1e-3


def test_simulation_confirms_it(fine_plan):
    result = fine_plan.simulate(20_000, rng=3)
    assert result.confirmed
    assert result.worst_difference < 0.02


def test_what_only_whole_pixels_of_the_nominal_part_would_promise_is_refused():
    """0.2 px permitted: on one grid a length of whole pixels is always right, and one .3 px longer never."""
    plan = _planned(0.9985, 0.65)
    assert plan.inspected == {}
    assert all("probability too low" in reason for reason in plan.uninspectable.values())
