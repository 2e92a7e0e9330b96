"""The report in a real browser: it loads alone, its buttons and circles move and show what they say, fits a phone."""

import shutil

import numpy as np
import pytest
from browser import Browser, needs_browser
from grid_box import EDGES, BoxSpace
from plan_examples import CAMERA, plan, setting

from aspectgraph import build_aspect_graph
from planner.report.figure import figure_views
from planner.report.page import report_html

NAMES = ("+z-y", "+z+x", "-z+y")
SPACE = BoxSpace((80.0, 50.0, 60.0), [[-900.0] * 3, [900.0] * 3], EDGES)
EYE = "(({x, y, z}) => [x, y, z])(plan3d.layout.scene.camera.eye)"

pytestmark = needs_browser


def box_plan():
    entities = {name: SPACE.entities[name].endpoints for name in NAMES}
    settings = (
        setting((40.0, -180.0, 620.0), ["+z-y", "+z+x"]),
        setting((250.0, 40.0, 600.0), ["+z+x"], probability=0.99),
    )
    return plan(
        entities=entities,
        settings=settings,
        uninspectable={"-z+y": "unobservable: <hidden> & gone"},
    )


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    graph = build_aspect_graph(
        SPACE.solid,
        {name: SPACE.entities[name].endpoints for name in NAMES},
        workspace=SPACE.workspace,
    )
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(report_html(box_plan().simulated(500), SPACE, graph=graph), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    folder = tmp_path_factory.mktemp("profile")
    program = Browser(folder)
    yield program
    program.close()
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="module")
def page(browser, file):
    shown = browser.page(file, 1400, 900)
    shown.wait("document.body.dataset.ready === 'yes'")
    yield shown
    shown.close()


def click(page, selector):
    """Click the middle of an element with the mouse."""
    x, y = page.run(
        f"(() => {{ const one = document.querySelector({selector!r}); one.scrollIntoView({{block: 'center'}});"
        "const r = one.getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2]; })()"
    )
    page.click(x, y)


def test_it_asks_for_nothing_and_complains_of_nothing(page):
    assert page.requests == []
    assert page.complaints == []


def test_the_picture_in_space_is_as_wide_as_its_frame(page):
    """On a desktop the graph stands beside it, which comes after the picture was drawn."""
    widths = page.run(
        "[plan3d.querySelector('svg.main-svg'), plan3d, plan3d.closest('.scene')]"
        ".map((one) => one.getBoundingClientRect().width)"
    )
    assert widths[2] < 900
    # the frame has a border of 1 px
    assert widths[:2] == pytest.approx([widths[2] - 2] * 2, abs=1)


def test_the_first_view_is_that_of_everything(page):
    wanted = figure_views(box_plan(), SPACE.solid)["everything"]["eye"]
    # a wide picture is filled to its height, so the eye is where it was computed
    assert page.run(EYE) == pytest.approx([wanted[i] for i in "xyz"])


@pytest.mark.parametrize("name", ["part", "setting-2", "everything"])
def test_a_click_moves_the_camera(page, name):
    click(page, f'.views [data-view="{name}"]')
    wanted = figure_views(box_plan(), SPACE.solid)[name]["eye"]
    page.wait(f"Math.abs(plan3d.layout.scene.camera.eye.x - {wanted['x']}) < 1e-9")
    assert page.run(EYE) == pytest.approx([wanted[i] for i in "xyz"])


def test_the_view_of_a_setting_has_the_field_of_its_camera(page):
    fovy = "plan3d._fullLayout.scene._scene.glplot.fovy"
    click(page, '.views [data-view="setting-1"]')
    width, height = page.run("(({w, h}) => [w, h])(plan3d._fullLayout._size)")
    # half the sensor over the image distance; the picture is wider than the sensor
    half_height = 2048 / 2 * 0.0035 / CAMERA.image_distance_mm
    assert width / height > 2448 / 2048
    wanted = 2 * np.arctan(1.04 * half_height)
    page.wait(f"Math.abs({fovy} - {wanted}) < 1e-9")
    click(page, '.views [data-view="everything"]')
    page.wait(f"{fovy} === Math.PI / 4")


def test_a_setting_leads_to_its_view_in_space(page):
    click(page, '#setting-1 [data-view="setting-1"]')
    wanted = figure_views(box_plan(), SPACE.solid)["setting-1"]["eye"]
    page.wait(f"Math.abs(plan3d.layout.scene.camera.eye.x - {wanted['x']}) < 1e-9")
    top = page.run("document.getElementById('space').getBoundingClientRect().top")
    assert 0 <= top < 200


def test_a_chosen_target_stands_out_and_all_of_them_come_back(page):
    def choose(value):
        page.run(
            f"(() => {{ target.value = {value!r}; target.dispatchEvent(new Event('change')); }})()"
        )

    def faint(group):
        shown = (
            f"plan3d.data.filter((one) => one.legendgroup === '{group}').map((one) => one.opacity)"
        )
        return set(page.run(shown))

    count = "plan3d.data.filter((one) => one.name === 'chosen target').length"
    # the second target of the first setting is the only one of the second
    choose("1:1")
    page.wait(f"{count} === 1")
    xs = page.run("Array.from(plan3d.data.find((one) => one.name === 'chosen target').x)")
    assert xs == [*SPACE.entities["+z+x"].endpoints[:, 0], None]
    told = page.run("ways.textContent")
    assert told.startswith("Setting 1 measures +z+x. Measured in setting 2, too.")
    assert (faint("setting 1"), faint("setting 2")) == ({0.5}, {0.12})
    choose("none:0")
    page.wait("ways.textContent.startsWith('-z+y is not inspected: unobservable: <hidden> & gone')")
    page.wait(
        f"{count} === 1 && plan3d.data.at(-1).x[0] === {SPACE.entities['-z+y'].endpoints[0][0]}"
    )
    choose("")
    page.wait(f"{count} === 0")
    assert page.run("ways.textContent") == ""
    assert faint("setting 1") == faint("setting 2") == {1}


def test_domains_of_a_setting_are_switched_in_the_legend(page):
    index = page.run("plan3d.data.findIndex((one) => one.name === 'domains of setting 1')")
    shown = f"plan3d.data[{index}].visible"
    assert page.run(shown) == "legendonly"
    x, y = page.run(
        "(() => { plan3d.scrollIntoView({block: 'center'});"
        "const name = 'domains of setting 1';"
        "const one = [...plan3d.querySelectorAll('.traces')].find((t) => t.textContent.includes(name));"
        "const r = one.querySelector('.legendtoggle').getBoundingClientRect();"
        "return [r.x + r.width / 2, r.y + r.height / 2]; })()"
    )
    page.click(x, y)
    page.wait(f"{shown} === true")


def test_a_click_on_a_domain_shows_it_and_the_next_hides_it(page):
    node = page.run("Object.keys(JSON.parse(document.getElementById('domains').textContent))[0]")
    count = "plan3d.data.filter((one) => one.name === 'chosen domain').length"
    assert page.run(count) == 0
    click(page, f'[data-domain="{node}"] circle')
    page.wait(f"{count} === 1")
    found = page.run(
        "(({x, y, z}) => [x, y, z].map((c) => Array.from(c)))(plan3d.data.find((one) => one.name === 'chosen domain'))"
    )
    low = np.min(found, axis=1)
    high = np.max(found, axis=1)
    assert (high > low).all()
    assert page.run("document.getElementById('domain').textContent").startswith(
        f"Domain {node} sees"
    )
    # another one takes its place
    other = page.run(
        f"[...document.querySelectorAll('[data-domain]')].find((g) => g.dataset.domain !== '{node}').dataset.domain"
    )
    click(page, f'[data-domain="{other}"] circle')
    page.wait(
        f"{count} === 1 && document.getElementById('domain').textContent.startsWith('Domain {other} ')"
    )
    assert page.run("document.querySelectorAll('.graph .chosen').length") == 1
    click(page, f'[data-domain="{other}"] circle')
    page.wait(f"{count} === 0")
    assert page.run("document.getElementById('domain').textContent") == ""
    assert page.complaints == []


# A4 less 10 mm at each side
def test_on_paper_nothing_is_wider_than_the_page(page):
    page.run("dispatchEvent(new Event('beforeprint'))")
    page.call("Emulation.setEmulatedMedia", media="print")
    page.call(
        "Emulation.setDeviceMetricsOverride",
        width=718,
        height=1047,
        deviceScaleFactor=1,
        mobile=False,
    )
    wide = page.run(
        "[...document.querySelectorAll('main *')].filter((one) => !one.closest('#plan3d') && !one.closest('svg')"
        " && one.getBoundingClientRect().right > innerWidth + 1).map((one) => one.tagName + '.' + one.className)"
    )
    assert wide == []
    assert page.run("getComputedStyle(document.querySelector('nav')).display") == "none"
    # the picture in 3-D as it was drawn for the screen, legend and all
    inside = "((a, b) => a.right <= b.right + 1 && a.bottom <= b.bottom + 1)"
    svg, frame = (
        f"plan3d.{part}.getBoundingClientRect()"
        for part in ("querySelector('svg')", "closest('.scene')")
    )
    assert page.run(f"{inside}({svg}, {frame})")
    page.run("dispatchEvent(new Event('afterprint'))")
    page.call("Emulation.setEmulatedMedia", media="")
    page.call(
        "Emulation.setDeviceMetricsOverride",
        width=1400,
        height=900,
        deviceScaleFactor=1,
        mobile=False,
    )


def test_a_phone_shows_it_without_scrolling_aside(browser, file):
    phone = browser.page(file, 400, 800)
    phone.wait("document.body.dataset.ready === 'yes'")
    assert phone.run("document.documentElement.scrollWidth") == 400
    # the whole picture of the targets, drawn as on a desktop but with names of its own
    shown = "[...document.querySelectorAll('#targets svg')].filter((one) => one.clientWidth)"
    assert all(
        kind.endswith("narrow")
        for kind in phone.run(f"{shown}.map((one) => one.getAttribute('class'))")
    )
    right = phone.run(f"Math.max(...{shown}.map((one) => one.getBoundingClientRect().right))")
    assert 300 < right <= 400
    fill = "getComputedStyle(document.querySelector('#targets .edge')).fill"
    assert phone.run(fill) == "none"
    least = phone.run(
        "Math.min(...[...document.querySelectorAll('#targets .narrow text')]"
        ".map((one) => one.getBoundingClientRect().height))"
    )
    assert least > 7
    # a row of results tells its columns
    label = (
        "getComputedStyle(document.querySelector('.results td:nth-child(8)'), '::before').content"
    )
    assert phone.run(label).startswith('"P')
    # the eye steps back, as the picture is higher than wide
    eye = np.array(phone.run(EYE))
    centre = figure_views(box_plan(), SPACE.solid)["everything"]
    middle, near = (np.array([centre[key][i] for i in "xyz"]) for key in ("center", "eye"))
    assert np.linalg.norm(eye - middle) > np.linalg.norm(near - middle)
    assert phone.requests == []
    assert phone.complaints == []
    phone.close()


def test_a_plan_of_nothing_is_shown_too(browser, tmp_path):
    name = "-z+y"
    nothing = plan(
        settings=(),
        entities={name: SPACE.entities[name].endpoints},
        uninspectable={name: "unobservable"},
        lower_bound=0,
    )
    path = tmp_path / "report.html"
    path.write_text(report_html(nothing, SPACE), encoding="utf-8")
    shown = browser.page(path, 1400, 900)
    shown.wait("document.body.dataset.ready === 'yes'")
    assert shown.complaints == []
    # part and what is not inspected
    assert "not inspected" in shown.run("plan3d.data.map((one) => one.name)")
    shown.close()
