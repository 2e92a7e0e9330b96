"""Broken edges in what plans promise, against measurements whose breaks are drawn."""

import measured_plate as plate
import numpy as np
import pytest

from aspectgraph import read_solid
from errors.measurands import Localisation
from errors.measurands.geometry import DETECTOR_FLOOR_PX
from planner import Camera, InspectionOptions, PlanFileError, PoseUncertainty, RequestError
from planner.identity import restored_request
from planner.report.wording import edges_text
from planner.request.edge_state import EdgeState, value_sigma
from planner.request.models import Means
from planner.resolve_request import resolve_request
from planner.verify.simulate_setting import displaced_poses, measured_errors

N = 20_000
NAMES = ("left", "apart", "width", "long")
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.02, rotation_rad=0.0002)


def plan_of(**changes):
    return plate.measured_plan(plate.thick_plate(), names=NAMES, settings=1, **changes)


@pytest.mark.parametrize("limits", [(0.1, 0.3), (0.2, 0.2), (0.0, 0.4)])
def test_uncertainty_is_that_of_drawn_breaks_and_p_is_never_too_large(limits):
    plan = plan_of()
    state = EdgeState(*limits, True)
    fine = Localisation.gaussian(0.05, floor_px=0.01)
    means = Means(plan.camera, UNCERTAINTY, localisation=fine, edges=state)
    pose = np.asarray(plan.settings[0].cam2world)
    rng = np.random.default_rng(3)
    for target in plan.targets.values():
        target = target.measured_with(means)
        predicted = target.describe(pose, means)
        poses = displaced_poses(pose, UNCERTAINTY, N, rng)
        errors, _ = measured_errors(target, pose, poses, plan.camera, rng)
        assert predicted.standard_uncertainty == pytest.approx(errors.std(), rel=0.03)
        assert abs(errors.mean()) < 4 * errors.std() / np.sqrt(N) + 1e-3
        for factor in (1.5, 2.0, 2.5):
            limit = factor * predicted.standard_uncertainty
            drawn = float(np.mean(np.abs(errors) <= limit))
            model = target.description(means)
            model.permitted_error = limit
            stated = float(model.probability(np.linalg.inv(pose)[None])[0])
            assert stated <= drawn + 4 * np.sqrt(drawn * (1 - drawn) / N) + 0.004


def test_a_circle_moves_twice_and_its_centre_not_at_all():
    targets = plan_of().targets
    state = EdgeState(0.2, 0.2, True)
    # a step anywhere on a way of 0.2 mm on each side
    assert value_sigma(targets["left"].measurand, state) == pytest.approx(2 * 0.2 / np.sqrt(12))
    assert value_sigma(targets["apart"].measurand, state) == pytest.approx(0.0, abs=1e-9)
    two = np.sqrt(2) * 0.2 / np.sqrt(12)
    assert value_sigma(targets["width"].measurand, state) == pytest.approx(two)
    assert value_sigma(targets["long"].measurand, state) == pytest.approx(two)


def test_a_plan_counts_what_is_stated_and_says_what_is_not():
    sharp = plan_of()
    broken = plan_of(edge_break_mm=(0.1, 0.3))
    assert edges_text(sharp).startswith("planned as sharp; a break of 0.1 mm would move ")
    assert edges_text(broken) == "broken by 0.1 to 0.3 mm"
    pose = sharp.settings[0].cam2world
    for name in NAMES:
        by_edges = [
            plan.targets[name].measured_with(plan.means).describe(pose, plan.means).budget
            for plan in (sharp, broken)
        ]
        assert by_edges[0]["edge_state"] == 0.0
        state = EdgeState(0.1, 0.3, True)
        expected = value_sigma(sharp.targets[name].measurand, state) ** 2
        assert by_edges[1]["edge_state"] == pytest.approx(expected)


def test_a_request_keeps_breaks_and_an_earlier_one_has_none():
    request = plan_of(edge_break_mm=(0.1, 0.3)).request
    identity = request.identity()
    assert restored_request(identity).edge_break_mm == (0.1, 0.3)
    del identity["edge_break_mm"]
    assert restored_request(identity).edge_break_mm is None
    with pytest.raises(PlanFileError, match="edge_break_mm"):
        restored_request({**identity, "edge_break_mm": [0.3, 0.1]})


def test_lengths_of_entities_count_breaks_and_whole_pixels_do_not_take_them():
    block = read_solid("examples/two_pocket_block.off")
    camera = Camera.named("basler-acA2440-20gm-8mm")

    def request(**options):
        return plan_of_length(block, camera, InspectionOptions(accuracy=0.95, **options))

    target = request(edge_break_mm=(0.2, 0.2)).targets[0]
    # each end is anywhere between the edge of the model and a break away
    state = EdgeState(*request(edge_break_mm=(0.2, 0.2)).edge_break_mm, True)
    assert value_sigma(target.measurand, state) == pytest.approx(np.sqrt(2) * 0.2 / np.sqrt(12))
    assert request(edge_break_mm=(0.2, 0.2)).localisation.floor_px == DETECTOR_FLOOR_PX
    assert request().localisation.model == "rounding"
    with pytest.raises(RequestError, match="edge_break_mm must be given without the localisation"):
        request(edge_break_mm=(0.2, 0.2), localisation=Localisation.rounding())


def plan_of_length(block, camera, options):
    """Return the request for the length of an edge of 60 mm."""
    edge = {"long": [[0, 0, 0], [60, 0, 0]]}
    return resolve_request(block, edge, camera, UNCERTAINTY, options).request
