"""The report of a measurement shows what was measured: counted in its own text."""

import base64
import re
import shutil
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
from browser import Browser, needs_browser
from measured_plate import POSES, fine_plate, measured_plan, photograph, thick_plate

from errors.measurands import Decision
from planner import Registration, measure, measured_html
from planner.measuring.results import UnseenBreaks, number_text
from planner.measuring.samples import State
from planner.report.measured_report import (
    COLOURS,
    PLANNED,
    REGISTERED,
    _accepted_text,
    print_results,
    residual_plot,
    value_bar,
)


@pytest.fixture(scope="module")
def results():
    solid = thick_plate()
    images = photograph(fine_plate(left=0.05), POSES)
    plan = measured_plan(solid, ["left", "right"])
    exact = Registration.given({1: POSES[0], 2: POSES[1]})
    return measure(plan, solid, images, registration=exact)


@pytest.fixture(scope="module")
def page(results):
    return measured_html(results)


def test_every_target_and_image_is_there(page, results):
    for one in results:
        assert f"{one.nominal:g} mm" in page
        assert one.decision.value in page
    assert page.count('<section class="target"') == 2
    assert page.count('<section class="picture"') == 2
    assert "ISO 14253-1, 95 %" in page


def test_one_reason_of_targets_that_are_not_planned_is_said_last_and_once():
    """Both names share a section after the measured one; the table gives the reason once, and in the section once."""
    solid = thick_plate()
    plan = measured_plan(solid, ["left", "right", "apart"])
    why = "no light shows it."
    settings = tuple(
        replace(setting, entities=("left",), probability={"left": 0.95})
        for setting in plan.settings
    )
    plan = replace(plan, settings=settings, uninspectable={"right": why, "apart": why})
    exact = Registration.given({1: POSES[0], 2: POSES[1]})
    few = measure(plan, solid, photograph(fine_plate(), POSES), registration=exact)
    page = measured_html(few)
    assert [few[name].measured for name in ("left", "right", "apart")] == [True, False, False]
    assert page.count(why.removesuffix(".")) == 2
    assert f"{why}." not in page
    headings = re.findall(r'<section class="target" id="[^"]*"><h3>([^<]*?) <', page)
    assert headings == ["left", "right, apart"]
    lead = '<p class="lead">1 of 1 planned target measured in 2 images; 2 more are not planned. '
    assert lead in page


def test_the_values_stand_between_the_verdict_and_the_notes(results):
    some = replace(results.results["left"], name="short", reason="too few points")
    page = measured_html(
        replace(results, results={**results.results, "short": some}, notes=("lens unknown",))
    )
    verdict = page.index('<p class="lead">2 of 3 planned targets measured in 2 images. ')
    assert verdict < page.index("<table") < page.index("note: lens unknown")
    assert page.index("</table>") < page.index('<p class="note">') < page.index('class="facts"')


def test_nothing_outside_the_page_is_needed(page):
    assert not re.search(r'(?:src|href)="(?!#|data:)', page)


def test_pictures_are_well_formed(page):
    pictures = re.findall(r"<svg.*?</svg>", page, re.S)
    assert pictures
    assert {ET.fromstring(svg).tag.rpartition("}")[2] for svg in pictures} == {"svg"}


def test_each_point_is_drawn_with_the_colour_of_its_state(results):
    points = results["left"].readings[0].points[0]
    dots = residual_plot(points, "one").dots
    for state in State:
        n = int(np.sum(points["state"] == state))
        assert sum(path.d.count("M") for path in dots if path.color == COLOURS[state]) == n


def luminance(colour):
    """Return the relative luminance of a colour, as WCAG 2 defines it."""
    parts = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ (0.2126, 0.7152, 0.0722))


def contrast(first, second):
    dark, light = sorted(map(luminance, (first, second)))
    return (light + 0.05) / (dark + 0.05)


def test_states_have_colours_of_their_own_and_grey_is_not_twice():
    """Weak and outside differ in lightness, which everybody sees, and show on the plot and on dark images."""
    assert len(set(COLOURS.values())) == len(COLOURS)
    pair = COLOURS[State.WEAK], COLOURS[State.OUTSIDE]
    assert contrast(*pair) > 1.5
    for colour in pair:
        assert min(contrast(colour, "#f5f7f9"), contrast(colour, "#111111")) > 2.8


@needs_browser
def test_printed_labels_of_distances_lie_in_their_plot(page, tmp_path):
    file = tmp_path / "report.html"
    file.write_text(page, encoding="utf-8")
    folder = tmp_path / "browser"
    browser = Browser(folder)
    try:
        shown = browser.page(file)
        for media in ("screen", "print"):
            shown.call("Emulation.setEmulatedMedia", media=media)
            inside = shown.run(
                "[...document.querySelectorAll('svg.plot text')].map((text) => {"
                " const a = text.getBBox(), b = text.ownerSVGElement.viewBox.baseVal;"
                " return a.y >= 0 && a.y + a.height <= b.height; })"
            )
            assert inside
            assert all(inside)
    finally:
        browser.close()
        shutil.rmtree(folder, ignore_errors=True)


def test_a_position_is_decided_in_a_disc_and_not_in_a_tolerance(results):
    position = replace(results["left"], kind="position", tolerance=(0.0, 0.3), accepted=None)
    assert value_bar(position, results.rule) is None
    assert _accepted_text(position) == "decided in a disc"
    other = replace(position, kind="distance")
    assert _accepted_text(other) == "none: u is too large"


def test_the_value_stands_in_its_tolerance(results):
    one = results["left"]
    bar = value_bar(one, results.rule)
    (tolerance,) = (band[1:] for band in bar.bands if band[0] == "tolerance")
    share = (bar.middle - tolerance[0]) / (tolerance[1] - tolerance[0])
    # of -0.1 to 0.1
    assert share == pytest.approx((one.deviation + 0.1) / 0.2, abs=0.01)


def test_what_is_not_measured_comes_first_and_is_named():
    solid = thick_plate()
    plan = measured_plan(solid, ["left"], settings=1)
    dark = measure(plan, solid, {1: np.zeros((512, 640), np.uint8)})
    page = measured_html(dark)
    assert "Not measured: setting_01: the image cannot be registered" in page
    assert "Cannot be registered: none of the part" in page


def test_the_outline_is_drawn_as_planned_and_as_registered():
    """The camera is 0.6 mm to the side, which is 3.5 px on this part: the planned outline is off by that."""
    solid = thick_plate()
    plan = measured_plan(solid, ["left"], settings=1)
    real = POSES[0].copy()
    real[:3, 3] += 0.6 * real[:3, 0]
    results = measure(plan, solid, photograph(fine_plate(), [real]))
    page = measured_html(results)
    places = []
    for colour in (PLANNED, REGISTERED):
        (path,) = re.findall(rf'class="outline" stroke="{colour}"[^>]* d="([^"]*)"', page)
        places.append(np.array(re.findall(r"[\d.]+", path), dtype=float).reshape(-1, 2))
    planned, registered = places
    assert len(planned) == len(registered) > 100
    shift = np.median(planned - registered, axis=0)
    # focal length 25 mm, pixels of 13.8 µm, at about 300 mm
    assert shift[0] == pytest.approx(0.6 * 25 / 0.0138 / 300, rel=0.1)
    assert abs(shift[1]) < 0.3


def test_no_name_smuggles_markup(results):
    nasty = "</title><script>alert(1)</script>\"'&"
    one = replace(results["left"], name=nasty, notes=(nasty,), reason=nasty)
    page = measured_html(
        replace(
            results,
            results={nasty: one},
            serial=nasty,
            source=replace(results.source, part=nasty),
            notes=[nasty],
        )
    )
    assert page.count("<script") == 1
    assert "</title><script" not in page
    assert page.count("&lt;script&gt;alert(1)") > 8


def test_budgets_stand_in_one_table_and_sum_to_u(page, results):
    (table,) = re.findall(r'<h2 id="budgets">.*?(<table.*?</table>)', page, re.S)
    rows = re.findall(r"<tr>(.*?)</tr>", table, re.S)
    assert len(rows) == 1 + sum(len(one.readings) for one in results)
    for row in rows[1:]:
        cells = re.findall(r"<td[^>]*>(.*?)</td>", row)
        *parts, total = [re.sub(r"<[^>]*>| µm", "", cell) for cell in cells[2:]]
        squares = sum(float(part or 0) ** 2 for part in parts)
        # every part is rounded to 0.1 µm
        assert squares**0.5 == pytest.approx(float(total), abs=0.2)
    assert table.count('class="strong"') == len(rows) - 1


def test_u_with_unseen_breaks_is_marked_where_the_decision_is_then_open(results):
    wider = {one.name: 2 * one.expanded_uncertainty for one in results}
    unseen = UnseenBreaks(0.16, wider, ("left",))
    page = measured_html(replace(results, unseen=unseen))
    assert "U with breaks to 0.16 mm" in page
    assert "U with breaks is red where the decision would be open" in page
    wanted = number_text(wider["left"], wider["left"])
    assert re.findall(r'<span class="bad">([0-9.]+)</span>', page) == [wanted]
    assert "U with breaks" not in measured_html(replace(results, unseen=None))


def test_a_value_far_outside_conforms_with_less_than_any_number(results):
    far = replace(results["left"], conformance_probability=1e-9)
    page = measured_html(replace(results, results={"left": far}))
    assert "within its tolerance with P &lt; 0.0001." in page


@needs_browser
def test_ten_targets_fit_on_six_pages(results, tmp_path):
    ten = {f"target {k}": replace(results["left"], name=f"target {k}") for k in range(10)}
    unseen = UnseenBreaks(0.2, dict.fromkeys(ten, 0.2))
    path = tmp_path / "report.html"
    path.write_text(measured_html(replace(results, results=ten, unseen=unseen)), "utf-8")
    folder = tmp_path / "profile"
    browser = Browser(folder)
    try:
        pdf = browser.page(path).call("Page.printToPDF", paperWidth=8.27, paperHeight=11.69)
    finally:
        browser.close()
        shutil.rmtree(folder, ignore_errors=True)
    n_pages = len(re.findall(rb"/Type\s*/Page\b", base64.b64decode(pdf["data"])))
    assert 2 <= n_pages <= 6


@needs_browser
def test_no_table_is_wider_than_the_page(results, tmp_path):
    """Every column is full, and names and reasons are long."""
    long = {
        f"Linear Size.11 [{k} of 30]": replace(
            result, name=f"Linear Size.11 [{k} of 30]", foreseen_uncertainty=0.01
        )
        for k, result in enumerate([*results, *results])
    }
    path = tmp_path / "report.html"
    path.write_text(measured_html(replace(results, results=long)), "utf-8")
    folder = tmp_path / "profile"
    browser = Browser(folder)
    over = "Math.max(...[...document.querySelectorAll('.scroll')].map((e) => e.scrollWidth - e.clientWidth))"
    try:
        wider = {
            width: browser.page(path, width, 900).run(over) for width in (400, 760, 1000, 1280)
        }
    finally:
        browser.close()
        shutil.rmtree(folder, ignore_errors=True)
    assert wider == dict.fromkeys((400, 760, 1000, 1280), 0)


def table_of(page):
    """The headings, and the texts of the cells of each row."""
    table = page[page.index("<table") : page.index("</table>")]
    head, body = table.split("</thead>")
    rows = [re.findall(r"<td[^>]*>(.*?)</td>", row, re.DOTALL) for row in body.split("<tr")[1:]]
    return re.findall(r"<th[^>]*>(.*?)</th>", head), rows


def test_a_reason_stands_below_its_row_over_all_columns(results):
    """In the column of the pictures it was as narrow as a word."""
    lost = replace(results["left"], value=np.nan, reason="no image shows it")
    page = measured_html(replace(results, results={"left": lost, "right": results["right"]}))
    heads, rows = table_of(page)
    assert [len(row) for row in rows] == [len(heads), 1, len(heads)]
    assert rows[1] == ["Reason: no image shows it"]
    assert f'<td colspan="{len(heads)}">Reason: no image shows it' in page


def test_without_any_tolerance_no_column_is_about_one(results, capsys):
    free = {
        result.name: replace(result, tolerance=None, decision=Decision.NO_TOLERANCE)
        for result in results
    }
    print_results(replace(results, results=free))
    printed = capsys.readouterr().out
    assert "decision" not in printed.splitlines()[0]
    heads, rows = table_of(measured_html(replace(results, results=free)))
    assert heads[1] == "Nominal"
    assert not any("olerance" in head or "Accepted" in head for head in heads)
    assert all(len(row) == len(heads) for row in rows)
    heads, _ = table_of(measured_html(results))
    assert {"Nominal, tolerance", "Accepted deviation"} < set(heads)


def test_both_uncertainties_are_named_and_an_interval_is_explained(results):
    foreseen = {result.name: replace(result, foreseen_uncertainty=0.01) for result in results}
    page = measured_html(replace(results, results=foreseen))
    heads, _ = table_of(page)
    assert heads[4:6] == ["U measured (k = 2)", "U foreseen by the plan"]
    assert "U measured is that of these images, and decides." in page
    assert "is not the value ± U" not in page
    axis = replace(foreseen["left"], kind="coaxiality", interval=(0.0, 0.03), tolerance=(0.0, 0.1))
    page = measured_html(replace(results, results={"left": axis}))
    assert "is not the value ± U" in page
    assert "Coaxiality " in page


def test_images_with_one_fault_are_told_of_once(results, capsys):
    why = "none of the edges were found; expose for 40 times as long: the image is dark"
    names = [f"setting_0{k}" for k in (1, 2)]
    lost = {
        result.name: replace(
            result, value=np.nan, reason=f"setting_01: the image cannot be registered: {why}"
        )
        for result in results
    }
    notes = ["setting_01: dark: expose for 40 times as long", "setting_02: blurred"]
    dark = replace(results, results=lost, failed=dict.fromkeys(names, why), notes=notes)
    print_results(dark)
    printed = capsys.readouterr().out
    assert printed.count(why) == 1
    assert f"setting_01 and setting_02 cannot be registered: {why}" in printed
    assert "not measured: left and right: setting_01 and setting_02 are not registered" in printed
    assert "note: setting_02: blurred" in printed
    assert "note: setting_01" not in printed
