"""Files of dimensions: what a user writes, and what is refused by name."""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np
import pytest
from browser import Browser, needs_browser
from solids import prism, ring

from aspectgraph import ModelDimension
from aspectgraph.dimensions.features import SurfaceZone
from aspectgraph.plot.picker import picker_html
from errors.measurands import Localisation
from errors.measurands.measurand import kinds
from planner import Dimension, RequestError, dimensions_to_plan
from planner.request.dimension_files import (
    SURFACES_MM,
    read_wanted,
    surfaces_of_zone,
    with_surfaces_of_call,
)
from planner.request.resolve import resolve_wanted

FILE = """
bore = { diameter = "r3", tolerance = [-0.05, 0.05] }
step = { distance = [17, 18], max_error = 0.02 }
rim = { edge = 17, max_error = 0.05 }
inch = { radius = "a0", tolerance = [-0.001, 0.001], unit = "in" }
slope = { angle = [17, 21], max_error = 0.001, unit = "rad" }
plain = 18
ends = [[0, 0, 10], [80, 0, 10]]
long = { length = [[0, 0, 10], [80, 0, 10]], accuracy = 0.99 }
fit = { diameter = "r3", tolerance = "H7", share = 0.1, unit = "um" }
"""


def written(tmp_path, text, name="dimensions.toml"):
    path = tmp_path / name
    path.write_text(text)
    return path


def test_every_way_to_say_it(tmp_path):
    found = read_wanted(written(tmp_path, FILE), kinds())
    assert list(found) == ["bore", "step", "rim", "inch", "slope", "plain", "ends", "long", "fit"]
    assert found["bore"] == Dimension.diameter("r3", tolerance_mm=(-0.05, 0.05))
    assert found["step"] == Dimension.distance(17, 18, max_error_mm=0.02)
    assert found["rim"] == Dimension.length(17, max_error_mm=0.05)
    assert found["inch"].tolerance == pytest.approx((-0.0254, 0.0254))
    assert found["slope"].max_error == pytest.approx(0.0572958, rel=1e-5)
    assert found["plain"] == 18
    assert found["fit"] == Dimension.diameter("r3", tolerance="H7", share=0.1)
    assert found["long"].entities == ([[0, 0, 10], [80, 0, 10]],)


def test_one_limit_of_a_tolerance(tmp_path):
    """An inch is 25.4 mm."""
    text = """
most = { diameter = "r3", tolerance = { upper = 0.05 }, max_error = 0.02 }
least = { radius = "a0", tolerance = { lower = -0.001 }, unit = "in" }
endless = { distance = [17, 18], tolerance = [-inf, 0.1] }
both = { distance = [17, 18], tolerance = { lower = -0.3, upper = 0.2 } }
"""
    found = read_wanted(written(tmp_path, text), kinds())
    assert found["most"] == Dimension.diameter("r3", tolerance_mm=(None, 0.05), max_error_mm=0.02)
    assert found["least"].tolerance == (pytest.approx(-0.0254), math.inf)
    assert found["endless"].tolerance == (-math.inf, 0.1)
    assert found["both"] == Dimension.distance(17, 18, tolerance_mm=(-0.3, 0.2))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            'a = { diameter = "r3", tolerance = { most = 1 } }',
            "dimension 'a': tolerance must be a table of lower, upper or both. Got {'most': 1}",
        ),
        ('a = { diameter = "r3", tolerance = {} }', "must be a table of lower, upper or both"),
        (
            'a = { diameter = "r3", tolerance = [-inf, inf] }',
            "dimension 'a': tolerance must have a finite limit",
        ),
        ('a = { width = "r3" }', "dimension 'a' must be made of a kind .* Got 'width'"),
        (
            'a = { diameter = "r3", tol = [-1, 1] }',
            "Got 'tol'; 'tolerance' may be meant",
        ),
        ("a = { max_error = 1 }", "dimension 'a' must have one kind. Got none"),
        ('a = { diameter = "r3", radius = "r3" }', "Got diameter, radius"),
        (
            'a = { diameter = "r3", max_error = 1, unit = "furlong" }',
            "dimension 'a': unit must be one of mm.*furlong",
        ),
        (
            'a = { diameter = "r3", max_error = 1, unit = "deg" }',
            "unit must be one of mm, um, in, inch. Got 'deg'",
        ),
        (
            'a = { diameter = "r3", tolerance = [1, -1] }',
            "dimension 'a': tolerance must have its lower",
        ),
        (
            'a = { diameter = "r3", tolerance = "H77" }',
            "dimension 'a': tolerance must be a letter and a grade of ISO 286.* Got 'H77'",
        ),
        (
            'a = { diameter = "r3", tolerance = "Ø24 H7" }',
            "Got 'Ø24 H7'; write H7 alone, because the nominal size is the part's",
        ),
        (
            'a = { diameter = "r3", tolerance = "±.1" }',
            r"tolerance must be two numbers.* Got '±.1'; write \[-0.1, 0.1\] without quotes",
        ),
        (
            "front = 12\n[dimensions]\nback = 13",
            "must stand in the table dimensions, or be the table datums. Got 'front'",
        ),
        (
            'a = { radius = "r3", tolerance = "H7" }',
            "dimension 'a': tolerance must be two numbers, because only a diameter",
        ),
        (
            'a = { diameter = "r3", max_error = 0 }',
            "dimension 'a': max_error must be a positive number. Got 0",
        ),
        ("", "must hold one name at least"),
        ("a = [", "must be valid TOML or JSON"),
    ],
)
def test_refusals(tmp_path, text, message):
    with pytest.raises(RequestError, match=message):
        read_wanted(written(tmp_path, text), kinds())


def test_json_and_a_missing_file(tmp_path):
    path = written(
        tmp_path, '{"dimensions": {"bore": {"diameter": "r3", "accuracy": 0.99}}}', "d.json"
    )
    assert read_wanted(path, kinds()) == {"bore": Dimension.diameter("r3", accuracy=0.99)}
    with pytest.raises(RequestError, match="name an existing file"):
        read_wanted(tmp_path / "none.toml", kinds())


def test_dimensions_without_a_share_of_their_own_take_the_given_one(tmp_path):
    path = tmp_path / "d.toml"
    path.write_text(
        "a = { length = 17, tolerance = [-0.1, 0.1] }\n"
        "b = { length = 18, tolerance = [-0.1, 0.1], share = 0.1 }\n"
    )
    assert [one.share for one in read_wanted(path, kinds(), 0.5).values()] == [0.5, 0.1]
    assert [one.share for one in read_wanted(path, kinds()).values()] == [0.25, 0.1]


# Holes picked in a browser become a file of dimensions with tolerances that `plan --dimensions`
# reads.


RADIUS = 4.0
CHORDS = 24
# of a chord's middle from its circle
SAGITTA = RADIUS * (1 - np.cos(np.pi / CHORDS))


def bored_block():
    """A block 40 × 20 × 10 with a bore of radius 4 that is known by 24 chords only."""
    bore = ring(RADIUS, CHORDS, clockwise=True)
    return prism([(-20, -10), (20, -10), (20, 10), (-20, 10)], 10, [bore])


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    opened = Browser(tmp_path_factory.mktemp("browser"))
    yield opened
    opened.close()


@pytest.fixture
def page(browser, tmp_path):
    path = tmp_path / "edges.html"
    path.write_text(picker_html(bored_block()), encoding="utf-8")
    opened = browser.page(path)
    opened.wait("state.codes !== null && !state.timer && !state.frame")
    opened.call("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
    yield opened
    assert opened.complaints == []
    opened.close()


def type_in(page, field, text):
    page.run(
        f"(() => {{ const one = {field}; one.value = {text!r}; "
        "one.dispatchEvent(new Event('input')); one.dispatchEvent(new Event('change')); })()"
    )


def tolerance_of(name):
    return f"document.querySelector(\"[aria-label='tolerance of {name}']\")"


def text_of(page, name):
    return page.run(f"document.getElementById('{name}').textContent")


def saved(page, folder):
    page.run("document.getElementById('save').click()")
    for _ in range(200):
        for path in folder.glob("*_dimensions.toml"):
            return path
        time.sleep(0.05)
    raise AssertionError("nothing was saved")


@needs_browser
def test_a_hole_with_its_tolerance_becomes_a_dimension(page, tmp_path):
    solid = bored_block()
    edge = next(e for e in solid.straight_edges() if solid.edge_length_mm(e.id) == 40.0)
    numbers = f"items.findIndex((one) => one.id === 'r0'), items.findIndex((one) => one.id === '{edge.id}')"
    page.run(f"choice.add([{numbers}]); chosen()")
    type_in(page, "document.getElementById('kind-of-file')", "dimensions")
    type_in(page, "document.getElementById('tolerance')", "±0.05")
    # a quarter of 0.05 is permitted, and 24 chords are farther off their circle than that
    assert SAGITTA > 0.0125
    assert "rim r0 is known by 24 chords only" in text_of(page, "fault")
    assert page.run("document.getElementById('save').disabled")
    type_in(page, tolerance_of("rim r0"), "-0.1/+0.3")
    told = page.run("[...document.querySelectorAll('#chosen span')].map((one) => one.textContent)")
    assert told[0] == "diameter 8 mm +0.3/-0.1: error up to 0.05 mm (25 %)"
    assert told[1] == "length 40 mm ±0.05: error up to 0.0125 mm (25 %)"
    assert text_of(page, "fault") == ""
    wanted = read_wanted(saved(page, tmp_path), kinds())
    _, (hole, length) = resolve_wanted(solid, wanted, 0.98)
    assert (hole.kind, length.kind) == ("diameter", "length")
    assert hole.tolerance == (-0.1, 0.3)
    assert length.tolerance == (-0.05, 0.05)
    assert hole.error_at(0.98) == pytest.approx(0.05)
    assert length.error_at(0.98) == pytest.approx(0.0125)


FAULTS = {
    "wide": "must be a number like 0.05",
    "0.1 0.1": "must differ",
    "-0.1": "must be a number like 0.05",
    "1 2 3": "must be a number like 0.05",
    "99": "the permitted error must be below 8 mm",
}


@needs_browser
def test_a_bad_tolerance_is_refused_before_the_file(page):
    page.run("choice.add([items.findIndex((one) => one.id === 'r0')]); chosen()")
    type_in(page, "document.getElementById('kind-of-file')", "dimensions")
    for text, fault in FAULTS.items():
        type_in(page, tolerance_of("rim r0"), text)
        assert fault in text_of(page, "fault")
        assert page.run("document.getElementById('save').disabled")
        assert page.run("document.getElementById('toml').value") == ""
    # entities have no tolerance, so their file stays
    type_in(page, "document.getElementById('kind-of-file')", "entities")
    assert not page.run("document.getElementById('save').disabled")


@needs_browser
def test_the_share_and_a_rim_without_tolerance(page, tmp_path):
    page.run("choice.add([items.findIndex((one) => one.id === 'r0'), 0]); chosen()")
    type_in(page, "document.getElementById('kind-of-file')", "dimensions")
    type_in(page, "document.getElementById('share')", "50")
    type_in(page, tolerance_of("rim r0"), "0.2")
    wanted = read_wanted(saved(page, tmp_path), kinds())
    hole, edge = wanted.values()
    assert (hole.share, hole.tolerance) == (0.5, (-0.2, 0.2))
    assert edge.tolerance is None
    _, (target, _) = resolve_wanted(bored_block(), wanted, 0.98)
    assert target.error_at(0.98) == pytest.approx(0.1)


# Where the position of a dimension's faces comes from: the model, the default or the caller.


FINE = Localisation.gaussian()
BORE = ModelDimension(
    "bore",
    "diameter",
    12.0,
    (-0.05, 0.05),
    ("r1",),
    None,
    features=((("r1",),), (("r2",),)),
    n_features=2,
    feature_reasons=(None, None),
    surfaces=(SurfaceZone("profile", 0.12, True), None),
)


def test_a_zone_has_the_deviation_of_equally_likely_places():
    """Uniform over a width t: the mean of x^2 from -t/2 to t/2 is t^2/12."""
    n = 1001
    places = [0.12 * ((k + 0.5) / n - 0.5) for k in range(n)]
    by_sum = math.sqrt(math.fsum(x * x for x in places) / n)
    sigma, source = surfaces_of_zone(SurfaceZone("profile", 0.12, True))
    assert sigma == pytest.approx(by_sum, rel=1e-5)
    assert source == "profile 0.12 mm"
    assert surfaces_of_zone(None) == (None, "")


def test_a_form_alone_makes_nothing_better_than_the_default():
    """A face that is flat to 1 µm may still be anywhere; one that is not flat to 1 mm is worse."""
    assert surfaces_of_zone(SurfaceZone("flatness", 0.001, False))[0] == SURFACES_MM
    worse, _ = surfaces_of_zone(SurfaceZone("flatness", 1.0, False))
    assert worse == pytest.approx(1.0 / math.sqrt(12.0))


def test_each_feature_has_the_zone_of_its_own_face():
    wanted, _ = dimensions_to_plan([BORE])
    first, second = wanted.values()
    assert first.surfaces_mm == pytest.approx(0.12 / math.sqrt(12.0))
    assert first.surfaces_from == "profile 0.12 mm"
    assert (second.surfaces_mm, second.surfaces_from) == (None, "")
    one, _ = dimensions_to_plan([BORE], one_per_pattern=True)
    assert one["bore"].surfaces_from == "profile 0.12 mm"
    by_hand, _ = dimensions_to_plan([replace(BORE, surfaces=())])
    assert [item.surfaces_mm for item in by_hand.values()] == [None, None]


def test_what_the_caller_gives_takes_the_place_of_the_model():
    wanted, _ = dimensions_to_plan([BORE])
    own = Dimension.diameter("r3", tolerance_mm=(-0.05, 0.05), surfaces_mm=0.01)
    items = {**wanted, "own": own, "edge": 17}
    assert with_surfaces_of_call(items, None, FINE) == items
    for surfaces_mm, how in ((0.05, FINE), (0.0, FINE), (None, Localisation.rounding())):
        found = with_surfaces_of_call(items, surfaces_mm, how)
        assert [found[name].surfaces_mm for name in wanted] == [None, None]
        assert [found[name].surfaces_from for name in wanted] == ["", ""]
        # what is stated for one dimension stays
        assert found["own"] == own
        assert found["edge"] == 17


@pytest.mark.parametrize("wrong", [-0.1, math.inf, "0.1", True])
def test_a_position_that_is_none_is_refused(wrong):
    with pytest.raises(RequestError, match="surfaces_mm must be finite and not negative"):
        Dimension("diameter", ("r1",), max_error=0.1, surfaces_mm=wrong)


def test_limits_are_those_of_the_drawing_where_its_value_is_rounded():
    """A hole of 3/16 in, 4.7625 mm, for which the drawing states 0.187 in ±0.005 in."""
    stated = replace(BORE, nominal=4.7498, tolerance=(-0.127, 0.127), geometry=4.7625)
    dimension = dimensions_to_plan([stated], one_per_pattern=True)[0]["bore"]
    lower, upper = (4.7625 + deviation for deviation in dimension.tolerance)
    assert (lower, upper) == pytest.approx((4.6228, 4.8768), abs=1e-12)
    same = replace(stated, geometry=4.7498)
    assert dimensions_to_plan([same], one_per_pattern=True)[0]["bore"].tolerance == (-0.127, 0.127)
