"""Values of parts whose edges are broken: plates with a true chamfer or radius, seen by rays."""

from functools import cache

import holed_plate as plates
import measured_plate as plate
import numpy as np
import pytest
from scipy.stats import norm

from aspectgraph import Solid
from errors.measurands import Circle
from planner import MeasureOptions, Measurer, Registration, measure
from planner.measuring.breaks import steepest

OWN = Registration.own_edges(0.02)
CHAMFER = 0.3
# .17 mm are a pixel
PROFILES = {
    "chamfer": [(CHAMFER, 0.0), (0.0, CHAMFER)],
    "radius": [
        (CHAMFER * (1 - np.sin(turn)), CHAMFER * (1 - np.cos(turn)))
        for turn in np.linspace(0.0, np.pi / 2, 7)
    ],
}


@cache
def measurer():
    solid = plate.thick_plate()
    return Measurer(plate.measured_plan(solid, settings=1), solid)


@cache
def images(kind):
    return plate.photograph(plate.broken_plate(PROFILES[kind]), plate.POSES[:1], samples=3)


def results(kind, edge_break_mm):
    return measurer().measure(images(kind), MeasureOptions(OWN, edge_break_mm=edge_break_mm))


@pytest.mark.parametrize("kind", PROFILES)
def test_values_of_stated_breaks_are_right_within_their_uncertainty(kind):
    for result in results(kind, (0.2, 0.4)):
        for reading in result.readings:
            if reading.measured:
                assert abs(reading.value - result.nominal) <= 2 * reading.standard_uncertainty
                assert reading.budget["edge state"] > 0


def test_what_is_assumed_is_said_with_u_of_what_images_do_not_show():
    sharp = plate.photograph(plate.fine_plate(), plate.POSES[:1], samples=2)
    assumed = measurer().measure(sharp, MeasureOptions(OWN))
    assert assumed.edges.startswith("assumed sharp within 0.05 mm; U holds for that. Images may ")
    assert "it is open whether left, right, apart, width conform" in assumed.edges
    assert not assumed.notes
    unseen = assumed.unseen
    # 3 px, in the plane of focus
    camera = plate.CAMERA
    pixel = camera.pixel_pitch_mm[0] * 300.0 / camera.image_distance_mm
    assert unseen.limit_mm == pytest.approx(3 * pixel, rel=0.1)
    assert assumed.to_dict()["unseen_breaks"]["U"].keys() == {"left", "right", "apart", "width"}
    # at least that of edges that are broken by anything up to there, with what is corrected then
    stated = measurer().measure(sharp, MeasureOptions(OWN, edge_break_mm=(0.0, unseen.limit_mm)))
    for result in stated:
        corrected = abs(result.value - assumed[result.name].value)
        u = np.hypot(result.standard_uncertainty, corrected)
        # steps of lines that merge do not move in proportion
        assert 0.8 < unseen.uncertainties[result.name] / (2 * u) < 1.4
    told = results("chamfer", (0.2, 0.4))
    assert told.edges == "broken by 0.2 to 0.4 mm"
    assert told.unseen is None


def test_a_sharp_part_has_no_part_of_its_uncertainty_from_breaks():
    sharp = plate.photograph(plate.fine_plate(), plate.POSES[:1], samples=2)
    stated = measurer().measure(sharp, MeasureOptions(OWN, edge_break_mm=(0.0, 0.0)))
    assumed = measurer().measure(sharp, MeasureOptions(OWN))
    for result, wider in zip(stated, assumed, strict=True):
        assert result.budget["edge state"] == 0.0
        assert wider.value == pytest.approx(result.value, abs=result.standard_uncertainty)
        assert wider.standard_uncertainty > result.standard_uncertainty


def test_the_steepest_place_is_that_of_the_blurred_steps():
    sigma = 1.3
    ends = np.array([[[0.0, 1.5]], [[0.0, 4.0]]])
    steps = np.array([[0.3, 0.1]])
    place = steepest(ends, steps, sigma)[:, 0]
    at = np.linspace(-3.0, 7.0, 100_001)
    for k, (first, second) in enumerate(ends[:, 0]):
        grey = 0.3 * norm.cdf(at, first, sigma) + 0.1 * norm.cdf(at, second, sigma)
        assert place[k] == pytest.approx(at[np.argmax(np.diff(grey))], abs=0.02)
    assert steepest(np.array([[[-1.0, 2.0]]]), np.array([[0.2, 0.2]]), 2.0) == pytest.approx(
        0.5, abs=0.02
    )
    assert np.isnan(steepest(ends, np.array([[0.2, -0.2]]), sigma)).all()


def test_a_hole_with_a_modelled_chamfer_is_measured_at_the_rim_of_the_cylinder():
    """The outer circle of the chamfer is 3.2 mm larger; the hole is 0.2 mm too large."""
    chamfer = 1.6
    profile = [(chamfer, 0.0), (0.0, chamfer)]
    solid = Solid(*plate.broken_plate(profile), name="plate")
    centre, radius = plates.HOLES["left"]
    at = np.array([*centre, plate.TOP - chamfer])
    rim = min(solid.rims(), key=lambda rim: np.linalg.norm(rim.centre - at))
    assert rim.radius_mm == pytest.approx(radius, abs=1e-3)
    circle = Circle(at, plate.UP, radius)
    hole = plate.dimension("diameter", (rim.id,), (circle,), (-0.3, 0.3))
    plan = plate.measured_plan(solid, ("left",), 1, dimensions={"left": hole})
    taken = plate.photograph(plate.broken_plate(profile, left=0.1), plate.POSES[:1], samples=3)
    result = Measurer(plan, solid).measure(taken, MeasureOptions(OWN))["left"]
    assert result.measured, result.reason
    assert abs(result.deviation - 0.2) < result.expanded_uncertainty < 0.1


@pytest.mark.parametrize(
    ("off_mm", "read"), [(0.04, True), (0.12, False)], ids=["within", "beyond"]
)
def test_a_stretch_that_an_assumed_break_may_move_is_no_gap(off_mm, read):
    """A quarter of a rim is off: by what U counts with anyway, or by more. Less than 80 % of it fits."""
    (x, y), radius = plates.HOLES["left"]
    vertices, triangles = plate.fine_plate()
    off = vertices[:, :2] - [x, y]
    distance = np.linalg.norm(off, axis=1)
    moved = (distance < 1.2 * radius) & (off[:, 0] > abs(off[:, 1]))
    vertices[moved, :2] += off_mm * off[moved] / distance[moved, None]
    solid = plate.thick_plate()
    plan = plate.measured_plan(solid, ("left",), 1)
    images = plate.photograph((vertices, triangles), plate.POSES[:1])
    result = measure(plan, solid, images)["left"]
    assert result.measured == read, result.reason
    if read:
        assert result.readings[0].found_share < 0.8
        assert abs(result.value - 2 * radius) < 2 * result.standard_uncertainty
