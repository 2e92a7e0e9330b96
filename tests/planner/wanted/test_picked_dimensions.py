"""Holes picked in a browser become a file of dimensions with tolerances that `plan --dimensions` reads."""

from __future__ import annotations

import time

import numpy as np
import pytest
from browser import Browser, needs_browser
from solids import prism, ring

from aspectgraph.plot.picker import picker_html
from errors.measurands.measurand import kinds
from planner.request.dimension_files import read_wanted
from planner.request.resolve import resolve_wanted

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
