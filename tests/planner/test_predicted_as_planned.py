"""What `predict` says at the poses of a plan is what the plan says: bare edges, dimensions, and any effort."""

from dataclasses import replace

import pytest

from aspectgraph import read_solid
from planner import (
    Camera,
    Dimension,
    Effort,
    InspectionOptions,
    PoseUncertainty,
    plan_inspection,
    predict,
)

CAMERA = Camera.named("basler-acA2440-20gm-8mm")
SIGMA = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
SHORT = Effort(viewpoints=10, pricing_rounds=2, refutations=1, bound_nodes=1000)
POCKETS = {"e1": [[60, 20, 10], [60, 40, 10]], "e4": [[20, 60, 10], [40, 60, 10]]}
STEP = Dimension.distance(
    [[50, 20, 10], [50, 40, 10]], [[60, 20, 10], [60, 40, 10]], max_error_mm=0.08
)
BOSS = {
    "left": [[-45, -25.981, 50], [-45, 25.981, 50]],
    "right": [[45, -25.981, 50], [45, 25.981, 50]],
}
ACROSS = Dimension.distance(BOSS["left"], BOSS["right"], max_error_mm=0.5)


@pytest.mark.parametrize("witnesses", [1, 12])
@pytest.mark.parametrize(
    ("part", "wanted"),
    [
        ("two_pocket_block.off", POCKETS),
        ("two_pocket_block.off", {"step": STEP, **POCKETS}),
        ("mfcad_6-11-11-19.step", {"a": 1, "b": 3, "c": 5}),
        ("nist_ctc_01_ap242.stp", {"across": ACROSS, **BOSS}),
    ],
)
def test_a_prediction_at_a_planned_pose_is_that_of_the_plan(part, wanted, witnesses):
    solid = read_solid(f"examples/{part}")
    effort = replace(SHORT, witnesses=witnesses)
    plan = plan_inspection(solid, wanted, CAMERA, SIGMA, accuracy=0.95, effort=effort)
    assert plan.settings
    options = InspectionOptions(effort=effort)
    for setting in plan.settings:
        told = predict(
            solid, wanted, setting.cam2world, CAMERA, SIGMA, accuracy=0.95, options=options
        )
        for name, probability in setting.probability.items():
            assert told[name].inspected
            assert told[name].probability == pytest.approx(probability, abs=1e-9)
