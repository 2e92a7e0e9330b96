"""Values whose entities no image shows together: each is read where it is seen, and surfaces are common."""

from dataclasses import replace

import numpy as np
import pytest
from holed_plate import HOLES
from measured_plate import (
    POSES as POSES_OF_ALL,
)
from measured_plate import (
    TOP,
    UNCERTAINTY,
    fine_plate,
    measured_plan,
    photograph,
    thick_plate,
    upper_rims,
)

from planner import Dimension, MeasureOptions, Measurer, Registration, look_at, measure
from planner.measuring.registered import displaced
from planner.measuring.results import verdict
from planner.report.measured_report import measured_html
from planner.request.resolve import resolve_wanted

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
    assert f"the plan does not inspect it: {WHY}" in width.notes
    assert [result.name for result in results if result.is_planned] == ["left", "right"]
    # a record of its own, whatever the words are
    reworded = {
        result.name: replace(result, notes=(), reason=result.reason and "none")
        for result in results
    }
    assert verdict(replace(results, results=reworded)) == verdict(results)
    rows = results.to_dict()["results"]
    assert [row["planned"] for row in rows] == [result.is_planned for result in results]
    counts = (
        "2 of 2 planned targets measured in 2 images; 2 more are not planned, 2 of them measured."
    )
    assert verdict(results).startswith(counts)
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


MOVED = (0.12, -0.09)


@pytest.fixture(scope="module")
def position_plan(solid, plan):
    """The left bore against the middle of front and back, and the right bore; no image shows both sides."""
    sides = [
        next(
            k
            for k in range(len(solid.edges))
            if np.allclose(solid.edge_points(k).mean(axis=0), [40.0, y, TOP])
        )
        for y in (0.0, 50.0)
    ]
    left, right = upper_rims(solid)
    wanted = {"bolt": Dimension.position(left, [sides, right], 0.4, material="M", size=(-0.1, 0.1))}
    _, (bolt,) = resolve_wanted(solid, wanted, 0.99)
    targets = [target for target in plan.request.targets if target.name in ("left", "right")]
    request = replace(plan.request, targets=(*targets, bolt))
    return replace(plan, request=request, uninspectable={"bolt": WHY})


def moved_images(seed, width, moved, left=0.0):
    rng = np.random.default_rng(seed)
    root = np.linalg.cholesky(UNCERTAINTY.covariance)
    real = [displaced(pose, root @ rng.normal(size=6))[0] for pose in POSES]
    (x, y), radius = HOLES["left"]
    designed = dict(HOLES)
    try:
        HOLES["left"] = ((x + moved[0], y + moved[1]), radius)
        return photograph(fine_plate(width=width, left=left), real, seed=seed)
    finally:
        HOLES.update(designed)


def test_a_position_whose_datums_are_in_other_images_is_read_from_all(solid, position_plan):
    results = measure(position_plan, solid, moved_images(3, 0.08, MOVED, 0.02))
    bolt = results["bolt"]
    assert bolt.measured, bolt.reason
    assert len({reading.image for reading in bolt.readings}) == 2
    assert [len(reading.entity) > 0 for reading in bolt.readings] == [True] * 4
    # half of the width moves the middle of the datum, along y
    e = np.array([MOVED[0], MOVED[1] - 0.04])
    low, high = bolt.interval
    assert low < 2 * np.linalg.norm(e) < high
    assert high - low < 0.16
    assert bolt.value == pytest.approx(2 * np.linalg.norm(e), abs=0.05)
    # of the least size of 15.9 mm
    assert bolt.bonus_mm == pytest.approx(0.1 + 2 * 0.02, abs=0.015)
    assert any("no image shows all of it: r" in note for note in bolt.notes)
    assert "alone" in measured_html(results)
    assert sum(bolt.budget.values()) == pytest.approx(bolt.standard_uncertainty**2)
    assert np.linalg.eigvalsh(results.correlation).min() > -1e-9


def test_entities_of_one_image_give_the_position_that_the_image_gives(solid, position_plan):
    """What is added up entity by entity is the value of all of them, with its covariance."""
    (setting,) = measured_plan(solid, ("left",), 1).settings
    whole = replace(setting, entities=("bolt",), probability={"bolt": 0.95})
    bolt = position_plan.targets["bolt"]
    request = replace(position_plan.request, targets=(bolt,))
    planned = replace(position_plan, request=request, settings=(whole,), uninspectable={})
    apart = replace(
        planned,
        settings=(replace(setting, entities=("left",)),),
        request=replace(request, targets=(position_plan.targets["left"], bolt)),
        uninspectable={"bolt": WHY},
    )
    images = {1: photograph(fine_plate(left=0.02), POSES_OF_ALL[:1])[1]}
    one, other = (measure(each, solid, images)["bolt"] for each in (planned, apart))
    assert len(other.readings) == 4
    (note,) = [note for note in other.notes if "by itself" in note]
    assert note.startswith(
        "no setting is planned for all of it, so each entity is read by itself in setting_01: "
    )
    assert note.count("setting_01") == 1
    assert other.value == pytest.approx(one.value, abs=0.3 * one.standard_uncertainty)
    assert other.standard_uncertainty == pytest.approx(one.standard_uncertainty, rel=0.2)
    assert other.bonus_mm == pytest.approx(one.bonus_mm, abs=0.005)
