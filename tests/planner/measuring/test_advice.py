"""What is said where an image or a reading fails: each cause is made in an image, and must be named."""

from dataclasses import replace

import numpy as np
import pytest
from measured_plate import CAMERA, POSES, fine_plate, measured_plan, photograph, thick_plate

from planner import LightPlan, LitImage, MeasureOptions, Registration, measure
from planner.measuring import advice
from planner.measuring.images import Picture
from planner.measuring.measurer import Measurer

PLACES = np.array([[100.0, 100.0], [200.0, 150.0]])


@pytest.fixture(scope="module")
def solid():
    return thick_plate()


@pytest.fixture(scope="module")
def image():
    return photograph(fine_plate(), POSES[:1])[1]


def grey_picture(level):
    return Picture.of("grey", np.full((512, 640), level, np.uint8), CAMERA)


@pytest.mark.parametrize(
    ("counts", "level", "blur_px", "text"),
    [
        ({"weak": 30, "found": 10}, 100, 0.5, advice.LIGHT),
        ({"weak": 30, "found": 10}, 20, 0.5, "expose for 10 times as long"),
        ({"weak": 30, "found": 10}, 100, 3.0, advice.FOCUS),
        ({"overexposed": 9, "weak": 4}, 255, 0.5, advice.SHORTER),
        ({"overexposed": 9, "weak": 4}, 255, 3.0, advice.SHORTER),
        ({"two steps": 20, "weak": 19}, 100, 0.5, advice.TWO_STEPS),
        ({"next to a shadow": 20, "found": 30}, 100, np.nan, advice.SHADOW),
        ({"next to another line": 20, "weak": 3}, 100, np.nan, advice.NEAR_LINE),
        ({"found": 30}, 100, 0.5, ""),
    ],
)
def test_the_largest_loss_gives_the_advice(counts, level, blur_px, text):
    """An image of 20 of 255 must have 0.8 of white: 10.2 times as much light."""
    given = advice.advice_of(counts, grey_picture(level), PLACES, blur_px)
    assert given.startswith(text)
    assert bool(given) == bool(text)


def test_brightness_is_that_around_the_places():
    grey = np.full((512, 640), 40, np.uint8)
    grey[90:110, 90:110] = 200
    picture = Picture.of("spot", grey, CAMERA)
    assert advice.brightness(picture, PLACES[:1]) == pytest.approx(200 / 255)
    assert advice.brightness(picture, PLACES[1:]) == pytest.approx(40 / 255)
    assert advice.brightness(picture, np.array([[np.nan, 1.0]])) == 0.0


def test_an_edge_that_is_nowhere_has_moved(solid, image):
    """The left bore is painted over with the grey of the face around it; all other edges are found."""
    names = ["left", "right"]
    (reading,) = measure(measured_plan(solid, names, settings=1), solid, {1: image})[
        "left"
    ].readings
    assert reading.measured
    points = reading.points[0]
    u, v = np.meshgrid(np.arange(image.shape[1]), np.arange(image.shape[0]))
    middle = points["u"].mean(), points["v"].mean()
    radius = np.hypot(points["u"] - middle[0], points["v"] - middle[1]).max() + 8
    away = np.hypot(u - middle[0], v - middle[1])
    face = np.median(image[(away > radius) & (away < radius + 4)])
    painted = np.where(away < radius, face, image).astype(np.uint8)
    results = measure(measured_plan(solid, names, settings=1), solid, {1: painted})
    assert results["right"].measured
    rim = measured_plan(solid, names).targets["left"].entities[0]
    assert f"no edge is where the model has rim {rim} (moved more than" in results["left"].reason
    assert results["left"].advice == advice.MOVED
    assert results.to_dict()["results"][0]["advice"] == advice.MOVED
    assert results.rows()[0]["advice"] == advice.MOVED
    assert "moved" not in results.to_dict()["results"][0]["readings"][0]


def test_what_no_planned_lamp_shows_is_not_to_be_exposed_longer(solid, image, monkeypatch):
    made = measured_plan(solid, ["left", "right"], settings=1)
    (reading,) = measure(made, solid, {1: image})["left"].readings
    lost = replace(reading, value=np.nan, reason="in the dark", counts={"weak": 30})
    assert "times as long" in advice.advised(lost, grey_picture(5), 0.5).advice
    assert advice.advised(lost, grey_picture(5), 0.5, is_unlit=True).advice == advice.UNLIT
    asked = {}

    def recorded(reading, *_, is_unlit):
        asked[reading.name] = is_unlit
        return reading

    monkeypatch.setattr("planner.measuring.measurer.advised", recorded)
    lit = LitImage((0,), {"right": 0.5})
    place = POSES[:1, :3, 3]
    unlit = ({"left": "in the shadow"},)
    light = LightPlan("placed", 0.1, 0.05, "dark", place, ((lit,),), unlit, 1, "by hand")
    measure(replace(made, light=light), solid, {1: image})
    assert asked == {"left": True, "right": False}


def test_an_image_that_fails_says_what_to_change(solid, image):
    measurer = Measurer(measured_plan(solid, ["left"], settings=1), solid)
    options = MeasureOptions(Registration.own_edges(0.02))
    bright = np.minimum(image.astype(float) * 20, 255).astype(np.uint8)
    results = measurer.measure({1: bright}, options)
    assert results.failed["setting_01"].endswith("much of the image is overexposed")
    assert results["left"].advice.startswith("expose for half of the time or less")
    results = measurer.measure({1: image // 60}, options)
    assert "times as long" in results["left"].advice


@pytest.mark.parametrize(("found", "is_other"), [(0, True), (1, True), (30, False)])
def test_an_image_without_the_part_is_asked_for(found, is_other):
    """Contrast is no matter where nothing of the part is found; with a third of it found, light is."""
    lost = {"found": found, "weak": 99 - found}
    text = advice.advice_of_images([grey_picture(120)], lost)
    assert (text == advice.ANOTHER) == is_other
    assert text.startswith("light more of the part") != is_other
