"""Positions against datums in images of a plate whose hole is off its place, with the bonus of its size."""

from __future__ import annotations

import math
from dataclasses import replace

import holed_plate as plates
import measured_plate as plate
import numpy as np
import pytest

from errors.measurands import Decision
from planner import Dimension, Measurer, Registration, RequestError, measure
from planner.measuring.foreseen import foreseen_uncertainties
from planner.measuring.part_posterior import PartPosterior
from planner.measuring.reading import SOURCES, Reading
from planner.measuring.response import JudgedResponse
from planner.request.dimension import MaterialCondition
from planner.request.resolve import resolve_wanted
from planner.request.target_records import plain_target, target_from

MOVED = (0.22, -0.11)
LARGER = 0.03
ZONE = 0.42
ENDS = {"B": [[0, 0, plate.TOP], [80, 0, plate.TOP]], "C": [[0, 0, plate.TOP], [0, 50, plate.TOP]]}


@pytest.fixture(scope="module")
def solid():
    return plate.thick_plate()


@pytest.fixture(scope="module")
def exact():
    return Registration.given(
        {k + 1: pose for k, pose in enumerate(plate.POSES[:1])}, np.diag([1e-8] * 3 + [1e-12] * 3)
    )


@pytest.fixture(scope="module")
def images():
    """The left hole is off its place, and larger."""
    (x, y), radius = plates.HOLES["left"]
    holes = dict(plates.HOLES)
    try:
        plates.HOLES["left"] = ((x + MOVED[0], y + MOVED[1]), radius)
        return plate.photograph(plate.fine_plate(left=LARGER), plate.POSES[:1])
    finally:
        plates.HOLES.update(holes)


def datum_edges(solid):
    """Edges of the top that show the datums B and C, by their ends."""
    found = []
    for ends in ENDS.values():
        middle = np.mean(ends, axis=0)
        apart = [
            np.linalg.norm(solid.edge_points(k).mean(axis=0) - middle)
            for k in range(len(solid.edges))
        ]
        found.append(int(np.argmin(apart)))
    return found


def position(solid, **stated):
    return Dimension.position(
        plate.upper_rims(solid)[0], datum_edges(solid), ZONE, share=0.5, **stated
    )


def result_of(solid, images, exact, **stated):
    _, targets = resolve_wanted(solid, {"hole": position(solid, **stated)}, 0.99)
    plan = plate.measured_plan(solid, ("hole",), 1, dimensions={"hole": targets[0]})
    return measure(plan, solid, images, registration=exact)["hole"]


def test_the_deviation_of_a_hole_is_read_in_the_frame_of_its_datums(solid, images, exact):
    one = result_of(solid, images, exact)
    (reading,) = one.readings
    # x along B, y across it
    off = np.array(reading.deviation_mm) - MOVED
    covariance = np.array(reading.covariance_mm2)
    assert off @ np.linalg.solve(covariance, off) < 9.21
    assert np.linalg.norm(off) < 0.02
    assert one.decision is Decision.DOES_NOT_CONFORM
    low, high = one.interval
    assert low < 2 * math.hypot(*MOVED) < high


def test_a_pattern_of_holes_as_the_datum_is_resolved_and_kept_in_files(solid):
    rims = plate.upper_rims(solid)
    edges = datum_edges(solid)
    item = Dimension.position(rims[0], [edges[0], list(rims[1:]), edges[1]], ZONE)
    with pytest.raises(RequestError, match="datum 3, which fixes nothing"):
        resolve_wanted(solid, {"hole": item}, 0.99)
    lower = [rim.id for rim in solid.rims() if rim.id not in rims]
    item = Dimension.position(rims[0], [lower], ZONE)
    _, (target,) = resolve_wanted(solid, {"hole": item}, 0.99)
    assert target.measurand.datum_names(target.entities) == ["-".join(lower)]
    assert target_from(plain_target(target)).measurand.groups == (2,)


@pytest.mark.parametrize(
    ("material", "size", "bonus"),
    [
        # of a hole with (M) its size minus the least one; with (L) the largest minus its size
        ("M", (-0.2, 0.1), 2 * LARGER + 0.2),
        ("L", (-0.1, 0.32), 0.32 - 2 * LARGER),
        # no bonus below the limit
        ("M", (0.1, 0.2), 0.0),
    ],
)
def test_the_size_that_is_measured_with_it_widens_the_zone(
    solid, images, exact, material, size, bonus
):
    one = result_of(solid, images, exact, material=material, size=size)
    assert one.bonus_mm == pytest.approx(bonus, abs=0.012)
    zone = ZONE + one.bonus_mm
    expected = Decision.CONFORMS if zone > one.value else Decision.DOES_NOT_CONFORM
    assert one.decision is expected


def test_size_and_deviation_are_known_together(solid, images, exact):
    """The rim's points tell centre and diameter apart, datums do not tell the diameter."""
    one = result_of(solid, images, exact, material="M", size=(-0.1, 0.1))
    covariance = np.array(one.readings[0].covariance_mm2)
    assert covariance.shape == (3, 3)
    assert np.linalg.eigvalsh(covariance).min() > 0
    diameter = measure(plate.measured_plan(solid, ("left",), 1), solid, images, registration=exact)
    alone = diameter["left"].readings[0]
    assert one.readings[0].size_mm == pytest.approx(alone.value, abs=1e-5)
    assert covariance[2, 2] == pytest.approx(alone.standard_uncertainty**2, rel=0.02)


@pytest.mark.parametrize(
    ("is_hole", "condition", "limit"),
    [(True, "M", 9.9), (True, "L", 10.2), (False, "M", 10.2), (False, "L", 9.9)],
)
def test_a_condition_has_the_limit_of_its_side(is_hole, condition, limit):
    one = MaterialCondition.of(condition, (-0.1, 0.2), 10.0, is_hole)
    assert one.limit_mm == pytest.approx(limit)
    # the zone grows towards the other limit
    assert one.surplus_mm(10.0) == pytest.approx(abs(10.0 - limit))
    assert MaterialCondition.of(condition, one.deviations(10.0), 10.0, is_hole) == one


def test_a_target_with_a_condition_is_the_same_in_a_file(solid):
    wanted = {"hole": position(solid, material="M", size="H9")}
    _, (target,) = resolve_wanted(solid, wanted, 0.99)
    # a hole of 16 mm: H9 is 0 to 0.043
    assert (target.material.condition, target.material.is_hole) == ("M", True)
    assert target.material.limit_mm == pytest.approx(16.0)
    again = target_from(plain_target(target))
    assert again.material == target.material
    assert resolve_wanted(solid, {"hole": target.item_of(solid)}, 0.99)[1][0].material == (
        target.material
    )


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ({"material": "M"}, "size must be stated with a material condition"),
        ({"material": "X", "size": (0, 1)}, "material must be M or L"),
        ({"size": (0, 1)}, "material must be M or L"),
        ({"material": "M", "size": (1, 0)}, "size must have its lower deviation below"),
        ({"material": "M", "size": (None, 0.1)}, "size must have a lower limit for"),
        ({"material": "M", "size": "g6"}, "must be a class of holes"),
    ],
)
def test_what_is_no_condition_is_refused(solid, stated, message):
    with pytest.raises(RequestError, match=message):
        resolve_wanted(solid, {"hole": position(solid, **stated)}, 0.99)


def test_a_hole_may_be_off_its_place_by_its_tolerance_when_images_are_joined(solid):
    """Eight holes that are off by 0.3 mm moved the pose by 0.6 mm where they were taken for right within 5 um."""
    _, targets = resolve_wanted(solid, {"hole": position(solid)}, 0.99)
    plan = plate.measured_plan(solid, ("hole",), 1, dimensions={"hole": targets[0]})
    measurer = Measurer(plan, solid)
    ((number, place_mm),) = measurer._places_mm().items()
    assert place_mm == pytest.approx(ZONE / 4)
    bore = measurer.model.carriers.surfaces[number]
    assert not bore.is_plane
    assert np.asarray(bore.point)[:2] == pytest.approx([20.0, 25.0], abs=1e-6)
    as_stated, usual = (
        PartPosterior(measurer.model, plan.camera, [], {}, places)._as_stated().reshape(-1, 3)
        for places in ({number: place_mm}, None)
    )
    # the axis, and neither the radius nor another surface
    assert as_stated[number, 1:] == pytest.approx([(ZONE / 4) ** 2] * 2)
    as_stated[number, 1:] = usual[number, 1:]
    np.testing.assert_array_equal(as_stated, usual)


def test_a_response_that_is_not_known_makes_a_position_less_sure():
    reading = Reading(
        *("hole", "setting_01", 0, 0.2, 0.01, dict.fromkeys(SOURCES, 0.0)),
        deviation_mm=(0.1, 0.0),
        covariance_mm2=((1e-4, 0.0, 0.0), (0.0, 1e-4, 0.0), (0.0, 0.0, 1e-4)),
        size_mm=16.0,
    )
    other = replace(reading, value=0.24, deviation_mm=(0.12, 0.01), size_mm=16.02)
    judged = JudgedResponse({}, 1.0, 0.0, [], "", "", False)
    more = np.array(judged.counted(reading, [other]).covariance_mm2) - reading.covariance_mm2
    apart = [0.02, 0.01, 0.02]
    assert more == pytest.approx(np.outer(apart, apart), abs=1e-15)
    # where it is not found, nothing is known of it
    lost = replace(reading, reason="not found")
    twice = np.array(judged.counted(reading, [lost]).covariance_mm2)
    assert twice == pytest.approx(2 * np.array(reading.covariance_mm2))


def test_broken_edges_widen_what_is_foreseen_of_a_position(solid):
    """2‖e‖ has no derivative where e is 0. Its variance is between 4 times that of one component and of their sum."""
    hole = plate.upper_rims(solid)[0]
    wanted = {"hole": position(solid)}
    for name, edge in zip(ENDS, datum_edges(solid), strict=True):
        wanted[name] = Dimension.centre_to_edge(hole, edge, tolerance_mm=(-1.0, 1.0))
    _, targets = resolve_wanted(solid, wanted, 0.99)
    named = {target.name: target for target in targets}
    plan = plate.measured_plan(solid, tuple(named), 1, dimensions=named)

    def variances(edges):
        rows = foreseen_uncertainties(plan, solid, edges)
        return {row.name: (row.expanded_uncertainty / 2.0) ** 2 for row in rows}

    sharp = variances((0.0, 0.0))
    broken = variances((0.05, 0.15))
    by_breaks = {name: broken[name] - sharp[name] for name in named}
    components = [by_breaks[name] for name in ENDS]
    assert min(components) > 0.0
    assert 3.99 * max(components) < by_breaks["hole"] < 4.01 * sum(components)
