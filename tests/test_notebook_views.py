"""What notebooks show of parts, graphs, plans, lamps and results, in a real browser: readable at any width."""

import pickle
import re
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from browser import Browser, needs_browser
from measured_plate import POSES, dimensions_of, fine_plate, measured_plan, photograph, thick_plate
from plan_examples import LIGHT, plan, setting

from aspectgraph import Solid, build_aspect_graph, read_requirements, read_solid
from errors.checks import probability_text
from errors.measurands import Decision
from ground.notebook import TONES, ShownInNotebook
from planner import (
    ArmUncertainty,
    Cell,
    CoaxialLight,
    GivenPose,
    LightComparison,
    Lighting,
    LightPlan,
    LightShows,
    LitImage,
    PartResult,
    PartResults,
    Registration,
    look_at,
    measure,
    predict_poses,
    read_plan,
    read_poses,
    robot_program,
)

CTC_01 = "examples/nist_ctc_01_ap242.stp"
BEHIND = look_at([[30.0, -400.0, 20.0]], [30.0, 30.0, 20.0])[0]
PLOTLY = "application/vnd.plotly.v1+json"


def test_the_page_on_notebooks_lists_every_value_with_a_display():
    """The tables of a plan are a part of it, and have no name of their own."""
    ours = [
        kind
        for kind in ShownInNotebook.__subclasses__()
        if kind.__module__.startswith(("aspectgraph.", "planner."))
    ]
    shown = {kind.__name__ for kind in ours} - {"PlanTables"}
    assert {"Solid", "RobotProgram", "PartResults"} <= shown
    page = Path("docs/notebooks.md").read_text("utf-8")
    table = page[page.index("| value |") : page.index("JupyterLab and VS Code")]
    assert {name for name in shown if f"`{name}`" not in table} == set()


@cache
def values():
    """A value of each class, by name."""
    solid = thick_plate()
    images = photograph(fine_plate(left=0.2), POSES)
    exact = Registration.given({1: POSES[0], 2: POSES[1]})
    results = measure(measured_plan(solid, ["left", "right"]), solid, images, registration=exact)
    names = {f"edge {k}": edge.id for k, edge in enumerate(solid.straight_edges()[:4])}
    return {
        "solid": solid,
        "graph": build_aspect_graph(solid, names),
        "plan": replace(plan(), light=LIGHT).simulated(100),
        "light": LIGHT,
        "results": results,
        "result": results["left"],
        "predicted": predicted(),
        "poses": read_poses("examples/two_pocket_block_poses.yaml"),
        "required": read_requirements(CTC_01, read_solid(CTC_01)),
        "program": programmed(),
        "parts": PARTS,
        "shows": SHOWS,
        "compared": LightComparison([SHOWS]),
        "reached": reached(),
        "celled": celled(),
    }


PARTS = PartResults(
    [
        PartResult("lids/lid.step", "planned", "", 8, 3, 2, 12.5),
        PartResult("a<b.step", "incomplete", "no lamp shows rim & edge", 6, 2, 2, 9.0, left_out=3),
        PartResult("open.stl", "refused", "the part must be closed. Got 3 holes."),
    ]
)


SHOWS = LightShows("coaxial", "a window of 50 mm", ("d1", "d2"), {"d3": "only 70 % of <r0> shows"})


def reached():
    """What an arm reaches of a plan's settings."""
    block = read_solid("examples/two_pocket_block.off")
    made = read_plan("examples/two_pocket_block_plan.json")
    return Cell.from_toml("examples/cell.toml").reachability(made, block)


def celled():
    """A plan whose first setting an arm takes."""
    made = replace(plan(), cell={"robot": "made"})
    arm = {"clearance_robot_mm": 12.34, "closest": "link_2 and table"}
    stands = replace(
        made.settings[0],
        fixturing="up",
        angle_deg=30.0,
        joints=(np.pi / 2, -np.pi / 4, 0.0, -1e-9, 0.0, 0.0),
        arm={**arm, "to_limit_rad": np.pi / 6, "singular_value": 0.256},
    )
    return replace(made, settings=(stands, *made.settings[1:]))


def programmed():
    """The round of an arm through a plan's settings."""
    made = read_plan("examples/two_pocket_block_plan.json")
    block = read_solid("examples/two_pocket_block.off")
    uncertainty = ArmUncertainty(joints_rad=1e-4)
    cell = Cell.from_toml("examples/cell.toml")
    return robot_program(made, block, cell, uncertainty=uncertainty, simulate=0)


def predicted():
    """What two poses measure, one of which sees nothing of it."""
    block = read_solid("examples/two_pocket_block.off")
    made = read_plan("examples/two_pocket_block_plan.json")
    poses = [GivenPose("taught", made.settings[0].cam2world), GivenPose("behind", BEHIND)]
    wanted = {name: made.entities[name] for name in ("e1", "e4")}
    return predict_poses(block, wanted, poses, made.camera, made.pose_uncertainty, accuracy=0.95)


NAMES = (
    "solid", "graph", "plan", "light", "results", "result", "predicted", "poses", "program", "parts", "shows",
    "reached", "celled", "required",
)  # fmt: skip


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    process = Browser(tmp_path_factory.mktemp("browser"))
    yield process
    process.close()


@needs_browser
@pytest.mark.parametrize("width", [1280, 400])
def test_all_is_in_the_page_and_nothing_is_loaded(browser, tmp_path, width):
    parts = [f'<section id="{name}">{values()[name]._repr_html_()}</section>' for name in NAMES]
    path = tmp_path / "page.html"
    head = '<meta charset="utf-8"><meta name="viewport" content="width=device-width">'
    path.write_text(f"<!DOCTYPE html>{head}{'<hr>'.join(parts)}", encoding="utf-8")
    page = browser.page(path, width=width)
    assert page.run("document.documentElement.scrollWidth") <= width
    # and nothing has to be scrolled to within it
    wide = "[...document.querySelectorAll('div')].filter((d) => d.scrollWidth > d.clientWidth)"
    assert page.run(f"{wide}.map((d) => d.textContent.slice(0, 60))") == []
    assert page.complaints == []
    assert page.requests == []
    # no text is cut off, and no column is so narrow that words become letters
    spans = (
        "[...document.querySelectorAll('td')].filter((c) => c.textContent && c.clientWidth < 12)"
    )
    assert page.run(f"{spans}.length") == 0
    heights = page.run("[...document.querySelectorAll('section')].map((s) => s.offsetHeight)")
    assert min(heights) > 40
    # the last one lists all that a model requires
    assert max(heights[:-1]) < 700
    page.close()


@needs_browser
def test_in_the_narrow_output_of_a_cell_a_table_scrolls_in_its_frame(browser, tmp_path):
    """JupyterLab leaves 354 px of a phone's 400, and cuts off what stands out of an output."""
    names = [f"chamfer_back_right_{k}" for k in range(4)]
    entities = {
        name: np.array([[0.0, 0.0, 9.0 * k], [60.0, 0.0, 9.0 * k]]) for k, name in enumerate(names)
    }
    made = plan(
        entities=entities,
        settings=(setting((164.9, -450.1, 629.3), names),),
        uninspectable={},
    )
    path = tmp_path / "page.html"
    head = '<meta charset="utf-8"><meta name="viewport" content="width=device-width">'
    frame = f'<div style="width:354px;overflow:hidden">{made._repr_html_()}</div>'
    path.write_text(f"<!DOCTYPE html>{head}{frame}", encoding="utf-8")
    page = browser.page(path, width=400)
    page.run(
        "document.querySelectorAll('table').forEach((t) => { t.parentElement.scrollLeft = 9999; })"
    )
    ends = page.run(
        "[...document.querySelectorAll('table')].map((t) => [t.getBoundingClientRect().right,"
        " t.parentElement.getBoundingClientRect().right, t.parentElement.clientWidth])"
    )
    assert len(ends) == 2
    for table_right, frame_right, width in ends:
        assert width <= 354
        assert table_right <= frame_right + 0.5
    page.close()


@pytest.mark.parametrize("name", NAMES)
def test_each_class_has_its_views(name):
    value = values()[name]
    views = value._repr_mimebundle_()
    assert views.keys() == {"text/plain", "text/html"} | ({PLOTLY} if name == "solid" else set())
    assert views["text/plain"] == repr(value)
    assert views["text/html"] == value._repr_html_()
    assert "<script" not in views["text/html"]


def test_a_plan_says_what_breaks_of_its_edges_do():
    """It stands where nothing is stated of them. `measure` then assumes some."""
    made = read_plan("examples/two_pocket_block_plan.json")
    line = (
        "planned as sharp, and P holds for that; &#39;measure&#39; assumes breaks of up to 0.05 mm"
    )
    assert line in made._repr_html_()
    stated = replace(made, request=replace(made.request, edge_break_mm=(0.0, 0.0)))
    assert "planned as sharp" not in stated._repr_html_()


def test_a_part_is_a_figure_in_3d():
    figure = values()["solid"]._repr_mimebundle_(include={PLOTLY})[PLOTLY]
    assert {trace["type"] for trace in figure["data"]} == {"mesh3d", "scatter3d"}
    corners = values()["solid"].bounds
    html = values()["solid"]._repr_html_()
    assert " × ".join(f"{c:.5g}" for c in corners[1] - corners[0]) in html


def test_a_graph_lists_its_domains():
    eag = values()["graph"]
    html = eag._repr_html_()
    n = len(eag.graph)
    assert f"4 entities, {n} domains, {eag.graph.number_of_edges()} adjacencies." in html
    assert html.count("<tr>") == 1 + min(n, 12)
    longest = max((data["observable"] for _, data in eag.graph.nodes(data=True)), key=len)
    assert all(name in html for name in longest)
    cells = re.findall("<td[^>]*>([^<]*)</td>", html.split("<tr>")[2])
    assert cells[:2] == ["0", f"{len(longest)} entities: {', '.join(longest)}"]


def test_one_of_a_kind_is_singular():
    eag = build_aspect_graph(values()["solid"], {"edge": 0})
    counts = f"1 entity, {len(eag.graph)} domains, "
    assert f"{counts}{eag.graph.number_of_edges()} adjacenc" in eag._repr_html_()
    assert f": {counts}" in repr(eag)
    assert ": 1 entity, vertices snapped" in repr(eag.regions)
    one = replace(LIGHT, images=(LIGHT.images[0][:1],), unlit=({"bottom": "no lamp"},))
    assert f", {one.ground} background" in one._repr_html_()
    assert "1 image, " in one._repr_html_()
    assert "1 image, 1 unlit>" in repr(one)
    assert "1 target is not lit." in one._repr_html_()


def test_the_table_of_a_plan_names_its_targets():
    """The accuracy A is stated where the error of some target depends on it."""
    edges = plan()
    assert ">entities</th>" in edges._repr_html_()
    assert "A = 0.98, P" in edges._repr_html_()
    named = {"left": dimensions_of(thick_plate())["left"]}
    stated = measured_plan(thick_plate(), ["left"], dimensions=named)
    assert ">dimensions</th>" in stated._repr_html_()
    assert "A = " in stated._repr_html_()
    toleranced = {"left": replace(named["left"], share=0.25)}
    html = measured_plan(thick_plate(), ["left"], dimensions=toleranced)._repr_html_()
    assert "A = " not in html
    assert "needed), P ≥ " in html


def test_the_verdict_of_a_plan_has_its_colour():
    request = plan().request
    inspected = replace(request, targets=request.targets[:2])
    for lower_bound, tone, words in (
        (2, "good", "no plan has fewer settings"),
        (1, "open", "at least 1 of 2 settings are needed"),
    ):
        found = replace(plan(), request=inspected, uninspectable={}, lower_bound=lower_bound)
        assert f"color:{TONES[tone]}" in found._repr_html_()
        assert f"Every target is inspected; smallest P 0.9400; {words}." in found._repr_html_()
    assert f"color:{TONES['bad']}" in plan()._repr_html_()
    assert "1 of 3 targets not inspected; smallest P 0.9400." in plan()._repr_html_()


def test_a_plan_without_the_light_of_its_request_is_not_shown_as_whole():
    request = plan().request
    inspected = replace(request, targets=request.targets[:2])
    whole = replace(plan(), request=inspected, uninspectable={})
    assert whole.complete
    dark = replace(whole, request=replace(inspected, lighting=Lighting("ring")))
    assert not dark.complete
    assert "Light is not planned yet; poses inspect every target" in dark._repr_html_()


def test_predictions_and_requirements_are_tables():
    html = values()["predicted"]._repr_html_()
    assert "The poses inspect 2 of 2 targets." in html
    assert html.count(">taught</td>") == 2
    assert "behind" not in html
    html = values()["required"]._repr_html_()
    assert html.count("<tr>") == 1 + len(values()["required"])
    assert "e477, e459" in html
    assert "flatness of a face: edges do not show it" in html


def test_poses_of_a_file_are_a_table():
    poses = values()["poses"]
    html = poses._repr_html_()
    assert html.count("<tr>") == 1 + len(poses.poses)
    assert "The file gives them in the frame part." in html
    for pose in poses.poses:
        assert f">{pose.name}</td>" in html
        assert ", ".join(f"{c:.1f}" for c in pose.cam2world[:3, 3]) in html


def test_a_program_lists_its_stops_and_what_to_look_at():
    made = values()["program"]
    html = made._repr_html_()
    (stop,) = made.tours[0].stops
    cells = re.findall("<td[^>]*>([^<]*)</td>", html)
    angles = [float(angle) for angle in cells[2].split(", ")]
    assert angles == pytest.approx(np.degrees(stop.joints), abs=0.0501)
    assert cells[:2] == [made.tours[0].fixturing, "1"]
    assert cells[3:] == [
        f"{stop.move.seconds:.1f}",
        probability_text(min(stop.probability.values())).replace(">", "&gt;"),
    ]
    assert f'color:{TONES["good"]}">The program visits 1 of 1 setting.<' in html
    assert f"1 round from home to home, moves {made.seconds:.1f} s at " in html
    missing = replace(made, unreached={1: "behind <the> table"}, warnings=("look",))
    html = missing._repr_html_()
    assert f'color:{TONES["bad"]}">The program visits 1 of 2 settings.<' in html
    assert "<li>setting 2 is not reached: behind &lt;the&gt; table</li>" in html
    assert "<li>warning 1: look</li>" in html


def test_the_results_of_a_folder_are_one_table():
    assert repr(PARTS) == "<PartResults of 3 parts: 1 planned, 1 incomplete, 1 refused>"
    html = PARTS._repr_html_()
    # what is not planned comes first, and the reasons below the table
    cells = re.findall("<td[^>]*>(?:<span[^>]*>)?([^<]*)", html)
    assert cells[::4] == ["a&lt;b.step", "open.stl", "lids/lid.step"]
    assert cells[1:4] == ["incomplete", "", "2 (at least 2)"]
    assert re.findall("<li>([^<]*)</li>", html) == [
        "a&lt;b.step: no lamp shows rim &amp; edge",
        "open.stl: the part must be closed. Got 3 holes.",
    ]
    assert f'color:{TONES["bad"]}">1 planned, 1 incomplete, 1 refused.<' in html
    assert "3 requirements left out." in html
    both = PartResults(
        [
            replace(PARTS[0], inspected=8, targets=8),
            replace(PARTS[1], inspected=4, targets=6),
            PARTS[2],
        ]
    )
    assert repr(both).endswith("1 refused; 12 of 14 targets inspected>")
    assert "12 of 14 targets inspected." in both._repr_html_()
    assert ">4 of 6</td>" in both._repr_html_()
    long = PartResults(PARTS[:1] * 20)
    assert long._repr_html_().count("<tr>") == 13
    assert "and 8 more; results.csv in the folder lists all." in long._repr_html_()
    assert "1 part" in PartResults(PARTS[:1])._repr_html_()


def test_decisions_have_their_colours():
    results = values()["results"]
    assert results["left"].decision == Decision.DOES_NOT_CONFORM
    assert results["right"].decision == Decision.CONFORMS
    html = results._repr_html_()
    assert f'color:{TONES["bad"]}">does not conform<' in html
    assert f'color:{TONES["good"]}">conforms<' in html
    for result in results:
        assert f"{result.value:.3f}" in html
        assert f"{result.nominal:g} mm" in html


def test_lamps_that_miss_a_target_say_so():
    unlit = replace(LIGHT, unlit=({"bottom": "no lamp reaches it"}, {}))
    assert "<li>bottom in setting 1: no lamp reaches it</li>" in unlit._repr_html_()
    assert "300.0, 25.0, 90.0" in LIGHT._repr_html_()
    assert "0.30" in LIGHT._repr_html_()


def test_a_light_says_what_it_shows_and_why_not_all():
    html = SHOWS._repr_html_()
    assert f'color:{TONES["bad"]}">It shows 2 of 3 targets.<' in html
    assert "a window of 50 mm" in html
    assert "<li>d3: only 70 % of &lt;r0&gt; shows</li>" in html
    assert repr(SHOWS) == "<LightShows 'coaxial': 2 of 3 targets>"
    whole = replace(SHOWS, dark={})
    assert f'color:{TONES["good"]}">It shows 2 of 2 targets.<' in whole._repr_html_()


def test_compared_lights_are_a_table_with_reasons_and_a_tuple():
    # reasons are sentences, which a list of them joins
    dark = {f"e{k}": f"reason {k}." for k in range(5)}
    both = LightComparison((SHOWS, replace(SHOWS, kind="lamps", dark=dark)))
    html = both._repr_html_()
    assert "<b>2 lights</b>" in html
    assert "d3: only 70 % of &lt;r0&gt; shows<" in html
    assert "e0: reason 0; e1: reason 1; e2: reason 2; and 2 more<" in html
    assert "reason 3" not in html
    assert (
        repr(both) == "<LightComparison of 2 lights: coaxial 2 of 3 targets, lamps 2 of 7 targets>"
    )
    first, second = both
    assert (first, second) == both == tuple(both)
    assert both[0] is SHOWS
    assert pickle.loads(pickle.dumps(both)) == both
    whole = LightComparison([replace(SHOWS, dark={})])
    assert f'color:{TONES["good"]}">2 of 2 targets' in whole._repr_html_()


def test_what_an_arm_reaches_is_a_table():
    """The last column is the fixturing in which an object is in the way."""
    html = values()["reached"]._repr_html_()
    assert f'color:{TONES["good"]}">1 of 1 setting reached.<' in html
    cells = re.findall("<td[^>]*>([^<]*)</td>", html)
    ((name, joints, why),) = values()["reached"].rows()
    assert cells == [name, joints, why]
    assert len(joints.split()) == 6
    assert why.endswith("touches pedestal")


def test_a_plan_for_a_cell_says_how_the_robot_stands():
    html = values()["celled"]._repr_html_()
    assert html.count("<table") == plan()._repr_html_().count("<table") + 1
    cells = re.findall("<td[^>]*>([^<]*)</td>", html.rpartition("<table")[2])
    assert cells == [
        "1",
        "up, table at 30°",
        "90.0, -45.0, 0.0, 0.0, 0.0, 0.0",
        "12.3 between link_2 and table",
        "30",
        "0.26",
    ]
    assert "made reaches these settings." in html
    assert "part lies" not in plan()._repr_html_()


def test_names_bring_no_markup():
    solid = thick_plate()
    sly = Solid(solid.vertices, solid.faces, name="<b>plate</b>")
    assert "<b>plate" not in sly._repr_html_()
    assert "&lt;b&gt;plate" in sly._repr_html_()


IN_A_NOTEBOOK = """
import builtins
class ZMQInteractiveShell:
    pass
builtins.get_ipython = ZMQInteractiveShell
from aspectgraph.solid.solid import RayScene
RayScene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
"""


def test_casting_rays_in_a_notebook_prints_nothing():
    told = subprocess.run(
        [sys.executable, "-c", IN_A_NOTEBOOK], capture_output=True, text=True, check=True
    )
    assert (told.stdout, told.stderr) == ("", "")


def test_a_light_with_an_area_has_no_lamps():
    """It was shown as 0 lamps, of which fewer may be enough."""
    shows = (LitImage((), {"top front": 0.3}),)
    made = LightPlan(
        "coaxial",
        0.1,
        0.05,
        "dark",
        np.zeros((0, 3)),
        (shows,),
        ({},),
        0,
        "",
        area=CoaxialLight(104.0, 250.0),
    )
    html = made._repr_html_()
    assert "<b>Light</b>" in html
    assert f'color:{TONES["good"]}">Every target of the settings is lit.<' in html
    assert str(made.area) in html
    assert "lamp" not in html
