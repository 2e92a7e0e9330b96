"""A target owns its model and its witnesses: any of them gives its value, each as a set of entities seen together."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from holed_plate import CAMERA, FRONT, HOLES, UNCERTAINTY, holed_plate, upper_rims

from errors.measurands import Localisation
from planner import Dimension, look_at
from planner.request.models import Means
from planner.request.reach import Seen, TargetSpace
from planner.request.request import Objective
from planner.request.resolve import resolve_wanted
from planner.request.targets import EdgeTarget, PlannedDimension

PLATE = holed_plate()
MEANS = Means(CAMERA, UNCERTAINTY, 0.98, Localisation.gaussian(0.1))
BORE, _ = upper_rims(PLATE)


def space_of(seen: dict[str, list[bool]]):
    """Return a space whose entities are seen from viewpoints 0, 1, ... as stated, whatever their coordinates."""

    def observable(points, names):
        rows = np.asarray(points)[:, 0].astype(int)
        return np.array([seen[name] for name in names]).T[rows]

    return SimpleNamespace(observable=observable)


def test_a_target_is_observable_where_all_entities_of_any_witness_are():
    seen = {
        "a": [True, True, False, False, True],
        "b": [True, False, False, True, True],
        "c": [False, False, True, False, True],
    }
    ends = np.eye(3)[:2]
    space = TargetSpace(
        space_of(seen), {"width": Seen([("a", "b"), ("c",)], ends), "c": Seen([("c",)], ends)}
    )
    points = np.arange(5)[:, None] * [1.0, 0.0, 0.0]
    either = [(a and b) or c for a, b, c in zip(*seen.values(), strict=True)]
    assert space.observable(points).T.tolist() == [either, seen["c"]]
    assert space.observable(points, ["c"]).T.tolist() == [seen["c"]]
    assert space.entities_of(["width", "c"]) == ["a", "b", "c"]


def test_the_objective_asks_each_target_for_its_own_model():
    """Edges and dimensions in any order: column by column what the target says alone."""
    wanted = {
        "front": FRONT,
        "bore": Dimension.diameter(BORE, max_error_mm=0.1),
        "length": Dimension.length(FRONT, max_error_mm=0.1),
        "side": [[0, 0, 10], [0, 50, 10]],
    }
    _, targets = resolve_wanted(PLATE, wanted, 0.98)
    rng = np.random.default_rng(3)
    poses = look_at(rng.uniform([-80, -80, 300], [140, 130, 450], (50, 3)), [40.0, 25.0, 10.0])
    whole = Objective(targets, MEANS).probability(poses)
    alone = np.stack([target.probability(poses, MEANS) for target in targets], axis=1)
    assert whole == pytest.approx(alone, abs=1e-12)
    assert (whole.max(axis=0) > 0.5).all()
    some = rng.random(whole.shape) < 0.5
    assert Objective(targets, MEANS).probability_where(poses, some) == pytest.approx(whole[some])


def test_what_is_necessary_is_the_target_s_own():
    """The image of an edge has a least length. Of two points of a rim nothing is known."""
    wanted = {"front": FRONT, "bore": Dimension.diameter(BORE, max_error_mm=0.1)}
    _, (edge, bore) = resolve_wanted(PLATE, wanted, 0.98)
    # half of ln(1.02 / 0.98) is 0.020003
    assert edge.least_image_mm(0.98, 0.01, 0.1) == pytest.approx(0.01 / 0.020003, rel=1e-4)
    assert edge.least_image_mm(0.98, 0.01, 1.0) == 1.0
    assert bore.least_image_mm(0.98, 0.01, 1.0) == 0.0


def test_a_plan_keeps_an_edge_as_it_keeps_a_dimension():
    wanted = {"front": FRONT, "bore": Dimension.diameter(BORE, max_error_mm=0.1)}
    _, targets = resolve_wanted(PLATE, wanted, 0.98)
    edge, bore = (target.measured_with(MEANS) for target in targets)
    assert isinstance(edge, EdgeTarget)
    assert isinstance(bore, PlannedDimension)
    assert (edge.kind, edge.unit, bore.kind, bore.unit) == ("length", "mm", "diameter", "mm")
    assert edge.nominal == pytest.approx(80.0)
    assert edge.permitted_error == pytest.approx(0.02 * 80.0)
    assert bore.nominal in [pytest.approx(2 * radius) for _, radius in HOLES.values()]
    pose = look_at([[40.0, 25.0, 410.0]], [40.0, 25.0, 10.0])[0]
    # square on at 400 mm, a share of the image's length is the permitted error times the scale
    scale = CAMERA.image_distance_mm / (400.0 * CAMERA.pixel_pitch_mm[0])
    assert edge.permitted_error_px(pose, CAMERA) == pytest.approx(0.02 * 80.0 * scale)
    assert bore.permitted_error_px(pose, CAMERA) == pytest.approx(0.1 * scale)
    # the localisation of the plan is the dimension's; an edge's ends are on whole pixels
    assert bore.localisation == MEANS.localisation
    assert edge.localisation.model == "rounding"
    for target in (edge, bore):
        described = target.describe(pose, MEANS)
        assert described.nominal == pytest.approx(target.nominal)
        assert described.standard_uncertainty > 0
