"""Values whose entities no image shows together: each is read where it is seen, and surfaces are common."""

from dataclasses import replace

import numpy as np
import pytest
from measured_plate import (
    TOP,
    UNCERTAINTY,
    fine_plate,
    measured_plan,
    photograph,
    thick_plate,
)

from planner import MeasureOptions, Measurer, Registration, look_at, measure
from planner.measuring.registered import displaced
from planner.report.measured_report import measured_html

# each image shows both bores and one side
POSES = np.concatenate(
    [look_at([[45.0, y - 5.0, 342.0]], [40.0, y, TOP], roll=0.0) for y in (-3.0, 53.0)]
)
WHY = "no pose shows all of it"


@pytest.fixture(scope="module")
def solid():
    return thick_plate()


@pytest.fixture(scope="module")
def plan(solid):
    """Both settings measure the bores; the width and the distance of the bores are not planned."""
    whole = measured_plan(solid, ("left", "right", "apart", "width"))
    settings = [
        replace(
            setting,
            cam2world=pose,
            entities=("left", "right"),
            probability=dict.fromkeys(("left", "right"), 0.95),
        )
        for setting, pose in zip(whole.settings, POSES, strict=True)
    ]
    return replace(whole, settings=tuple(settings), uninspectable={"apart": WHY, "width": WHY})


def images_of(seed, width, left=0.0):
    rng = np.random.default_rng(seed)
    root = np.linalg.cholesky(UNCERTAINTY.covariance)
    real = [displaced(pose, root @ rng.normal(size=6))[0] for pose in POSES]
    return photograph(fine_plate(width=width, left=left), real, seed=seed)


@pytest.fixture(scope="module")
def results(solid, plan):
    return measure(plan, solid, images_of(1, 0.08, 0.03))


def test_a_width_that_no_image_shows_is_read_from_two(results):
    width = results["width"]
    assert width.measured, width.reason
    assert [reading.image for reading in width.readings] == ["setting_01", "setting_02"]
    front, back = (reading.entity for reading in width.readings)
    assert front != back
    assert abs(width.deviation - 0.08) <= width.expanded_uncertainty
    assert any("no image shows all of it" in note for note in width.notes)
    assert f"setting_02, {back} alone: 50." in measured_html(results)
    # the budget is that of the sum
    assert sum(width.budget.values()) == pytest.approx(width.standard_uncertainty**2)


def test_values_of_the_plan_are_what_they_are_without_it(solid, plan, results):
    fewer = replace(
        plan,
        request=replace(
            plan.request,
            targets=tuple(t for t in plan.request.targets if t.name in ("left", "right")),
        ),
        uninspectable={},
    )
    alone = measure(fewer, solid, images_of(1, 0.08, 0.03))
    for name in ("left", "right"):
        assert alone[name].value == results[name].value
        assert alone[name].standard_uncertainty == results[name].standard_uncertainty


def test_draws_of_plates_and_poses_lie_within_u(solid, plan):
    rng = np.random.default_rng(4)
    z = []
    for seed in range(2, 6):
        width = rng.normal(0.0, 0.06)
        result = measure(plan, solid, images_of(seed, width))["width"]
        assert result.measured, result.reason
        z.append((result.deviation - width) / result.standard_uncertainty)
    # chi squared of 4 is above 13.3 in 1 of 100
    assert np.square(z).sum() < 13.3


def test_correlations_stay_those_of_a_covariance(results):
    assert np.linalg.eigvalsh(results.correlation).min() > -1e-9
    np.testing.assert_allclose(results.correlation, results.correlation.T)


def test_what_one_image_shows_alone_is_not_read(solid, plan):
    options = MeasureOptions(Registration.own_edges())
    partial = Measurer(plan, solid).measure({1: images_of(1, 0.0)[1]}, options, partial=True)
    assert not partial["width"].measured
    assert partial["width"].reason == f"not planned: {WHY}"


def test_planned_poses_are_not_used(solid, plan):
    """Entities are searched near their predictions, so images must be registered."""
    results = measure(plan, solid, images_of(1, 0.0), registration=Registration.none())
    assert not results["width"].measured
