"""Picking in a notebook: the widget's front end in a real browser, and what a plan takes of it."""

import contextlib
import json
import sys
import tomllib
from itertools import permutations

import numpy as np
import pytest
from browser import Browser, needs_browser
from solids import prism, ring

from aspectgraph import MissingExtraError, Solid, ToleranceError
from aspectgraph.dimensions.tolerances import (
    DEVIATIONS_UM,
    GRADES,
    ToleranceClass,
    class_tables,
)
from aspectgraph.plot.picker import picker_html
from errors.exceptions import MeasurandError
from errors.measurands.geometry import Circle, Line
from errors.measurands.measurand import kinds, measurand
from ground.templates import asset
from planner import Dimension, pick
from planner.request import dimension_files
from planner.request.dimension_files import read_wanted
from planner.request.resolve import resolve_wanted

WIDTH_PX = 1000
HEIGHT_PX = 640

# the model of a widget, as notebooks give it to a front end
STUB = """
const model = {
  values: VALUES, handlers: [], saved: [],
  get(name) { return this.values[name]; },
  set(name, value) {
    const same = JSON.stringify(this.values[name]) === JSON.stringify(value);
    this.values[name] = value;
    if (!same) this.handlers.filter(([event]) => event === `change:${name}`).forEach(([, act]) => act());
  },
  save_changes() { this.saved.push(JSON.stringify(this.values.picked)); },
  on(event, act) { this.handlers.push([event, act]); },
  off(event, act) { this.handlers = this.handlers.filter(([e, a]) => e !== event || a !== act); },
};
let widget, ends = [];
const show = (id) => ends.push(widget.render({ model, el: document.getElementById(id) }));
import(URL.createObjectURL(new Blob([ESM], { type: "text/javascript" }))).then((module) => {
  widget = module.default;
  show("first");
});
"""


@pytest.fixture(scope="module")
def part():
    """A block 40 × 20 × 10 with a bore of radius 4."""
    solid = prism([(-20, -10), (20, -10), (20, 10), (-20, 10)], 10, [ring(4.0, 24, clockwise=True)])
    return Solid(solid.vertices, solid.faces, name="block </script>")


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    process = Browser(tmp_path_factory.mktemp("browser"))
    yield process
    process.close()


def script(value):
    return json.dumps(value).replace("</", "<\\/")


@pytest.fixture
def notebook(browser, part, tmp_path):
    """A page with one view of the widget, and room for another below."""
    values = {"page": picker_html(part), "height_px": HEIGHT_PX, "picked": {}}
    esm = script(str(asset("aspectgraph.plot", "page/widget.js")))
    stub = STUB.replace("VALUES", script(values)).replace("ESM", esm)
    path = tmp_path / "notebook.html"
    cells = '<div id="first"></div><div id="second"></div>'
    style = f'<meta charset="utf-8"><style>body {{ margin: 0; width: {WIDTH_PX}px }}</style>'
    path.write_text(f"<!DOCTYPE html>{style}{cells}<script>{stub}</script>", encoding="utf-8")
    page = browser.page(path, width=WIDTH_PX, height=2 * HEIGHT_PX + 10)
    page.wait("model.saved.length > 0")
    # the frame is on the screen, so that a click reaches it
    page.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    yield page
    assert page.complaints == []
    assert page.requests == []
    page.close()


@pytest.fixture(scope="module")
def places(browser, part, tmp_path_factory):
    """Where edges are in the frame, by the page alone at the size of the frame without its border."""
    path = tmp_path_factory.mktemp("page") / "page.html"
    path.write_text(picker_html(part), encoding="utf-8")
    page = browser.page(path, width=WIDTH_PX - 2, height=HEIGHT_PX - 2)
    page.wait("state.codes !== null && !state.timer && !state.frame")
    seen = page.run("[...state.seen].map(([k, { x, y }]) => [items[k].id, x + 1, y + 1])")
    two = page.run("(({ x, y }) => [x + 9, y + 9])($('two').getBoundingClientRect())")
    page.close()
    return {"two": two} | {name: (x, y) for name, x, y in seen}


def picked(page, n):
    """What the model holds once so many are picked."""
    page.wait(f"(model.values.picked.rows || []).length === {n}")
    return page.run("model.values.picked")


@needs_browser
def test_what_is_clicked_is_in_the_model(notebook, places, part):
    rim = part.rims()[1].id
    edge = next(name for name in places if name.isdigit())
    notebook.click(*places[edge])
    assert picked(notebook, 1)["rows"][0]["asked"] == {"edge": int(edge)}
    notebook.click(*places[rim])
    rows = picked(notebook, 2)["rows"]
    assert [row["entity"] for row in rows] == [int(edge), rim]
    assert rows[1]["asked"] == {"diameter": rim}
    notebook.click(*places[edge])
    assert [row["id"] for row in picked(notebook, 1)["rows"]] == [rim]


@needs_browser
def test_views_of_one_widget_agree_and_a_closed_one_says_nothing(notebook, places):
    edges = [name for name in places if name.isdigit()][:3]
    notebook.click(*places[edges[0]])
    picked(notebook, 1)
    saved = notebook.run("model.saved.length")
    notebook.run("show('second')")
    notebook.wait(f"model.saved.length === {saved + 1}")
    # the second view took what the first has, and the model is as before
    assert len(picked(notebook, 1)["rows"]) == 1
    x, y = places[edges[1]]
    notebook.click(x, y + HEIGHT_PX)
    assert [row["id"] for row in picked(notebook, 2)["rows"]] == edges[:2]
    notebook.wait(f"model.saved.length === {saved + 3}")
    notebook.click(*places[edges[2]])
    assert [row["id"] for row in picked(notebook, 3)["rows"]] == edges
    notebook.run("ends.forEach((end) => end())")
    assert notebook.run("model.handlers.length") == 0
    saved = notebook.run("model.saved.length")
    notebook.click(*places[edges[2]])
    notebook.run("new Promise((done) => setTimeout(done, 300))")
    assert notebook.run("model.saved.length") == saved


@needs_browser
def test_the_record_says_what_the_file_says_and_is_taken_again(browser, part, tmp_path):
    path = tmp_path / "page.html"
    path.write_text(picker_html(part), encoding="utf-8")
    page = browser.page(path)
    rims = [rim.id for rim in part.rims()]
    page.run("choice.add(items.map((_, k) => k))")
    # two names that are equal, and one that is the default name of another item
    page.run("choice.rename(0, 'same'); choice.rename(1, 'same'); choice.rename(2, 'e0')")
    page.run(
        "$('tolerance').value = '±0.4'; $('share').value = 50; choice.tolerances.set(3, '0/0.3')"
    )
    page.run("chosen()")
    record = page.run("choice.record()")
    page.run("choice.remove([...choice.names.keys()]); choice.tolerances.clear(); choice.share = 1")
    page.run("chosen()")
    page.run(f"choice.restore({json.dumps(record)})")
    assert page.run("choice.record()") == record
    files = [page.run(f"choice.{kind}('part', false)") for kind in ("toml", "dimensionsToml")]
    entities, dimensions = map(tomllib.loads, files)
    assert len(record["rows"]) == len(part.straight_edges()) + len(rims)
    assert {row["key"]: row["entity"] for row in record["rows"]} == entities
    assert {row["key"]: row["asked"] for row in record["rows"]} == dimensions["dimensions"]
    assert list(entities)[:3] == ["e0_", "e1", "e0"]
    assert dimensions["dimensions"]["e3"] == {"edge": 3, "tolerance": [0, 0.3], "share": 0.5}
    assert dimensions["dimensions"][rims[0]]["tolerance"] == [-0.4, 0.4]
    assert page.complaints == []
    page.close()


@needs_browser
def test_what_lies_between_two_is_as_the_plan_has_it(browser, tmp_path):
    """Every pair of a skew block with two bores: kinds and values of the page and of the plan."""
    outline = [(-20, -10), (25, -10), (20, 10), (-20, 12)]
    bores = [ring(4.0, 24, clockwise=True), ring(2.0, 24, (10.0, 3.0), clockwise=True)]
    solid = prism(outline, 10, bores)
    corners = {tuple(corner) for corner in outline}
    rims = solid.rims()
    # the edges of the block, without the chords of the bores
    edges = [
        edge.id
        for edge in solid.straight_edges()
        if all(tuple(point[:2]) in corners for point in solid.edge_points(edge.id))
    ]
    path = tmp_path / "page.html"
    path.write_text(picker_html(solid, edges, [rim.id for rim in rims]), encoding="utf-8")
    page = browser.page(path)
    page.run(
        "items.forEach((one, j) => items.slice(j + 1).forEach((other, k) =>"
        " choice.add(betweenTwo(one, other).map((option) => choice.pair([j, j + 1 + k], option)))))"
    )
    page.run("$('kind-of-file').value = 'dimensions'; chosen()")
    told = page.run("[...choice.names.keys()].map((k) => choice.items[k].size)")
    # an option of the command line means nothing in a notebook
    texts = page.run("[...choice.names.keys()].map((k) => choice.told(k))")
    assert {text.rpartition(", ")[2] for text in texts} == {"error by the plan's accuracy"}
    assert page.run("$('count').textContent") == f"{len(texts)} picked"
    wanted = read_wanted(saved_as(page, tmp_path), kinds())
    shapes = {edge: Line(*solid.edge_points(edge)) for edge in edges}
    shapes |= {rim.id: Circle(rim.centre, rim.axis, rim.radius_mm) for rim in rims}
    values = [
        measurand(item.kind, [shapes[one] for one in item.entities], item.direction).nominal
        for item in wanted.values()
    ]
    assert values == pytest.approx(told, rel=1e-12)
    # what the page does not offer, the plan refuses
    asked = {(item.kind, frozenset(item.entities)) for item in wanted.values()}
    defined = set()
    for kind in ("distance", "angle", "centre_distance", "centre_to_edge"):
        for pair in permutations(shapes, 2):
            with contextlib.suppress(MeasurandError):
                measurand(kind, [shapes[one] for one in pair])
                defined.add((kind, frozenset(pair)))
    assert asked == defined
    assert {kind for kind, _ in asked} == {"distance", "angle", "centre_distance", "centre_to_edge"}
    assert page.complaints == []
    page.close()


def limits_of(name, size):
    """Limits of a class, or None where ISO 286 has none."""
    try:
        return list(ToleranceClass.of(name).deviations_mm(size))
    except ToleranceError:
        return None


@needs_browser
def test_classes_have_the_limits_that_the_plan_takes(browser, part, tmp_path):
    """Every class at the end of every range of sizes, and just above it: page and package agree."""
    path = tmp_path / "page.html"
    path.write_text(picker_html(part), encoding="utf-8")
    page = browser.page(path)
    ends = class_tables()["steps"]
    sizes = [0.5, 1.0, 1.001, *ends, *(end + 0.001 for end in ends)]
    letters = [*DEVIATIONS_UM, "h", "j", "js", "q", "Cd"]
    names = [f"{a}{n}" for a in (*letters, *map(str.upper, letters)) for n in (*GRADES, "19")]
    told = page.run(
        f"((names, sizes) => names.map((name) => {{ const one = choice.classes.read(name);"
        " return sizes.map((size) => (one && choice.classes.deviations(one, size)) || null); }))"
        f"({json.dumps(names)}, {json.dumps(sizes)})"
    )
    assert told == [[limits_of(name, size) for size in sizes] for name in names]
    page.run("choice.add([0])")
    page.run("$('kind-of-file').value = 'dimensions'; $('tolerance').value = 'h12'; chosen()")
    (edge,) = read_wanted(saved_as(page, tmp_path), kinds()).values()
    assert (edge.kind, edge.tolerance_class) == ("length", "h12")
    assert page.run("choice.record()")["rows"][0]["asked"]["tolerance"] == "h12"
    page.run("$('tolerance').value = 'C19'; chosen()")
    assert "or a class like H7" in page.run("$('fault').textContent")
    page.run("$('tolerance').value = '+0,05/-0,02'; chosen()")
    assert "decimal point, so write +0.05/-0.02" in page.run("$('fault').textContent")
    # the comma between two numbers is none of a number
    page.run("$('tolerance').value = '-0.1,0.1'; chosen()")
    assert "or a class like H7" in page.run("$('fault').textContent")
    assert page.run("$('toml').value") == ""
    assert page.complaints == []
    page.close()


def saved_as(page, folder):
    path = folder / "dimensions.toml"
    path.write_text(page.run("$('toml').value"), encoding="utf-8")
    return path


@needs_browser
def test_two_that_are_clicked_become_a_dimension(notebook, places, part):
    # the frame shares no origin with the notebook, so its controls are clicked
    notebook.click(*places["two"])
    long = [
        name
        for name in places
        if name.isdigit() and part.edge_length_mm(int(name)) == pytest.approx(40.0)
    ]
    notebook.click(*places[long[0]])
    notebook.click(*places[long[1]])
    # two of a cuboid's four parallel edges that are on one face, so there is one distance only
    (only,) = picked(notebook, 1)["rows"]
    assert "entity" not in only
    assert only["asked"] == {"distance": [int(name) for name in long[:2]]}
    entities, dimensions, fault = dimension_files._picked([only])
    assert (entities, fault) == ({}, "")
    _, (target,) = resolve_wanted(part, dimensions, 0.98)
    ends = [part.edge_points(int(name)).mean(axis=0) for name in long[:2]]
    assert target.nominal == pytest.approx(np.linalg.norm(ends[1] - ends[0]))


@needs_browser
def test_a_position_is_offered_where_the_plan_has_one(browser, tmp_path):
    """Every rim with up to three datums, in every order: what the page completes, the plan takes."""
    outline = [(-20, -10), (25, -10), (20, 10), (-20, 12)]
    bores = [ring(4.0, 24, clockwise=True), ring(2.0, 24, (10.0, 3.0), clockwise=True)]
    solid = prism(outline, 10, bores)
    rims = [*solid.rims()][:3]
    ends = {edge.id: solid.edge_points(edge.id) for edge in solid.straight_edges()}
    # two that cross, two that are parallel, and one along the axis of the bores
    chosen = [
        next(k for k, at in ends.items() if {tuple(p) for p in at} == {first, second})
        for first, second in (
            ((-20, -10, 0), (25, -10, 0)),
            ((-20, -10, 10), (25, -10, 10)),
            ((20, 10, 0), (25, -10, 0)),
            ((-20, -10, 0), (-20, 12, 0)),
            ((20, 10, 0), (20, 10, 10)),
        )
    ]
    path = tmp_path / "page.html"
    path.write_text(picker_html(solid, chosen, [rim.id for rim in rims]), encoding="utf-8")
    page = browser.page(path)
    offered = page.run(
        "(() => { const found = []; const go = (chain) => { const of = chained(chain);"
        " if (datumFrame(items, chain).isComplete) found.push(of.map((k) => items[k].id).join());"
        " if (of.length < 4) nextInChain(items, chain, false)"
        ".forEach((k) => go(chainWith(chain, items, k, false))); };"
        " items.forEach((item, k) => item.kind === 'rim' && go({ ...emptyChain(), first: [k] }));"
        " return found; })()"
    )
    page.close()
    shapes = {str(k): Line(*ends[k]) for k in chosen}
    shapes |= {rim.id: Circle(rim.centre, rim.axis, rim.radius_mm) for rim in rims}
    defined = set()
    for rim in rims:
        others = [name for name in shapes if name != rim.id]
        for n in (1, 2, 3):
            for datums in permutations(others, n):
                with contextlib.suppress(MeasurandError):
                    measurand("position", [shapes[name] for name in (rim.id, *datums)])
                    defined.add(",".join((rim.id, *datums)))
    assert set(offered) == defined
    assert len(defined) > 50


def plate_of_slots():
    """Return a plate with three bores, a slot, and the ids of its top rims and chosen edges."""
    outline = [(-30, -20), (30, -20), (30, 20), (12, 20), (12, 14), (4, 14), (4, 20), (-30, 20)]
    places = [(-10.0, -5.0), (8.0, -5.0), (-2.0, 6.0)]
    solid = prism(outline, 10, [ring(3.0, 24, place, clockwise=True) for place in places])
    rims = [rim for rim in solid.rims() if rim.centre[2] > 5]
    corners = [(point, outline[(k + 1) % 8]) for k, point in enumerate(outline)]
    chosen = [corners[k] for k in (0, 3, 5, 7)]
    wanted = [{(*a, 10), (*b, 10)} for a, b in chosen] + [{(-30, -20, 0), (-30, -20, 10)}]
    edges = [
        edge.id
        for edge in solid.straight_edges()
        if {tuple(point) for point in solid.edge_points(edge.id)} in wanted
    ]
    return solid, rims, edges


def position_defined(shapes, first, datums, pattern=()):
    """Whether the plan has a position of these items."""
    groups = tuple(len(group) for group in datums)
    names = [*first, *(name for group in datums for name in group), *pattern]
    kind = "position" if len(first) == 1 else "width_position"
    with contextlib.suppress(MeasurandError):
        measurand(kind, [shapes[name] for name in names], groups=groups or (0,))
        return True
    return False


@needs_browser
def test_slots_and_patterns_are_offered_where_the_plan_has_them(browser, tmp_path):
    """Every hole and slot with one or two datums, single, slots and patterns: page and plan agree."""
    solid, rims, edges = plate_of_slots()
    path = tmp_path / "page.html"
    path.write_text(picker_html(solid, edges, [rim.id for rim in rims]), encoding="utf-8")
    page = browser.page(path)
    offered = page.run(
        "(() => { const found = []; const say = (numbers) => numbers.map((k) => items[k].id).join('+');"
        " const go = (chain) => { if (datumFrame(items, chain).isComplete) {"
        " found.push([say(chain.first), chain.datums.map(say).join(), say(chain.pattern)].join('|')); }"
        " for (const isJoined of [false, true]) {"
        " if (!isJoined && chain.datums.length > 1) continue;"
        " const last = chain.datums.at(-1) || [...chain.first, ...chain.pattern];"
        " if (isJoined && last.length > 1) continue;"
        " nextInChain(items, chain, isJoined).forEach((k) => go(chainWith(chain, items, k, isJoined))); } };"
        " go(emptyChain()); return found; })()"
    )
    assert page.complaints == []
    page.close()
    shapes = {str(k): Line(*solid.edge_points(k)) for k in edges}
    shapes |= {rim.id: Circle(rim.centre, rim.axis, rim.radius_mm) for rim in rims}
    holes = [(rim.id,) for rim in rims]
    ways = {name: (shape.q - shape.p) for name, shape in shapes.items() if isinstance(shape, Line)}
    slots = [
        (a, b)
        for a, b in permutations(ways, 2)
        if np.linalg.norm(np.cross(ways[a], ways[b])) < 1e-9
        and np.linalg.norm(np.cross(ways[a], shapes[b].p - shapes[a].p)) > 1e-9
    ]
    patterns = list(permutations([rim.id for rim in rims], 2))
    groups = [*holes, *((name,) for name in ways), *slots, *patterns]
    expected = set()
    for first in (*holes, *slots):
        for n in (0, 1, 2):
            for datums in permutations(groups, n):
                names = [*first, *(name for group in datums for name in group)]
                for pattern in ((), *holes) if len(first) == 1 else [()]:
                    every = [*names, *pattern]
                    if len(set(every)) < len(every) or not (datums or pattern):
                        continue
                    if position_defined(shapes, first, datums, pattern):
                        said = ",".join("+".join(group) for group in datums)
                        expected.add(f"{'+'.join(first)}|{said}|{'+'.join(pattern)}")
    assert set(offered) == expected
    assert len(expected) > 300


@needs_browser
def test_a_hole_and_its_datums_that_are_clicked_become_a_position(browser, part, tmp_path):
    path = tmp_path / "page.html"
    path.write_text(picker_html(part), encoding="utf-8")
    page = browser.page(path)
    rests = "state.codes !== null && !state.timer && !state.frame"
    page.wait(rests)
    page.run("document.getElementById('position').click()")
    rim = next(rim for rim in part.rims() if rim.centre[2] > 5)
    ends = {edge.id: part.edge_points(edge.id) for edge in part.straight_edges()}
    # of the top, in view: along x and along y
    along = next(k for k, at in ends.items() if (at[:, 1:] == [-10, 10]).all())
    across = next(k for k, at in ends.items() if (at[:, 0] == 20).all() and (at[:, 2] == 10).all())

    def click(name):
        k = f"items.findIndex((one) => one.id === '{name}')"
        page.wait(rests)
        spot = f"lines[{k}].length === 2 ? middles[{k}] : lines[{k}][0]"
        page.click(*page.run(f"scene.project([{spot}])[0]"))

    shown = "items.filter((_, k) => isShown(k)).map(({ kind }) => kind)"
    every = "items.map(({ id }) => id)"
    # a hole, or an edge of a slot or tab
    assert set(page.run(shown)) == {"rim", "edge"}
    click(rim.id)
    # an edge along the axis of the hole is no datum
    upright = {str(k) for k, at in ends.items() if at[0][2] != at[1][2]}
    names = "items.filter((_, k) => isShown(k)).map(({ id }) => id)"
    assert set(page.run(names)) == set(page.run(every)) - upright
    click(along)
    assert "one is needed" in page.run("document.getElementById('between').textContent")
    click(across)
    page.run("$('zone').value = '⌀0.2'; $('zone').dispatchEvent(new Event('input'))")
    page.run("document.getElementById('collect-position').click()")
    (name,) = read_wanted(saved_as(page, tmp_path), kinds())
    assert name == f"position_{rim.id}_e{along}_e{across}"
    expected = Dimension.position(rim.id, [along, across], 0.2)
    assert read_wanted(saved_as(page, tmp_path), kinds()) == {name: expected}
    record = page.run("choice.record()")
    assert dimension_files._picked(record["rows"]) == ({}, {name: expected}, "")
    page.run("choice.remove([...choice.names.keys()]); choice.items.pop()")
    page.run(f"choice.restore({json.dumps(record)})")
    assert page.run("choice.record()") == record
    page.run("$('by-ends').click()")
    (at_ends,) = read_wanted(saved_as(page, tmp_path), kinds()).values()
    targets = [resolve_wanted(part, {name: item}, 0.98)[1][0] for item in (expected, at_ends)]
    assert targets[0].measurand.datum_names(targets[0].entities) == [f"e{along}", f"e{across}"]
    assert targets[1].permitted_error == targets[0].permitted_error == 0.05
    # without a zone there is no file
    page.run(
        "[...choice.tolerances.keys()].forEach((k) => choice.tolerances.set(k, ' 0,3')); chosen()"
    )
    assert "numbers need a decimal point, so write 0.3" in page.run("$('fault').textContent")
    assert page.run("$('save').disabled")
    page.run("choice.tolerances.clear(); chosen()")
    assert "needs its zone" in page.run("$('fault').textContent")
    assert page.run("$('save').disabled")
    assert page.complaints == []
    page.close()


@needs_browser
def test_a_slot_to_a_pattern_with_its_width_is_clicked(browser, part, tmp_path):
    """A slot at maximum material against an edge and another slot, and a hole of a pattern without datums."""
    solid, rims, edges = plate_of_slots()
    path = tmp_path / "page.html"
    path.write_text(picker_html(solid, edges, [rim.id for rim in rims]), encoding="utf-8")
    page = browser.page(path)
    at = {k: solid.edge_points(k) for k in edges}
    walls = [k for k in edges if set(at[k][:, 0]) in ({12.0}, {4.0})]
    bottom = next(k for k in edges if (at[k][:, 1] == -20).all() and (at[k][:, 2] == 10).all())
    left = next(k for k in edges if (at[k][:, 0] == -30).all() and (at[k][:, 2] == 10).all())

    def click(*names):
        for name in names:
            page.run(
                f"$('item-' + items.findIndex(({{ id }}) => id === '{name}')).querySelector('input').click()"
            )

    def join(name):
        page.run("$('join').checked || $('join').click()")
        click(name)

    page.run("$('position').click()")
    click(*walls, bottom, rims[0].id)
    join(rims[1].id)
    told = page.run("$('between').textContent")
    first = "-".join(f"e{k}" for k in walls)
    assert told.startswith(f"Position of {first} to e{bottom}, {rims[0].id}-{rims[1].id}. ")
    # what is clicked again goes out, with its tick
    click(rims[1].id)
    join(rims[1].id)
    page.run("$('zone').value = '0.2'; $('zone').dispatchEvent(new Event('input'))")
    page.run("$('material').value = 'M'; $('material').dispatchEvent(new Event('change'))")
    page.run("$('collect-position').click()")
    # the width is collected with it, and needs limits of its own
    assert "needs a tolerance of distance" in page.run("$('fault').textContent")
    page.run("choice.tolerances.set([...choice.names.keys()][0], '0/0.1'); chosen()")
    # holes of one pattern, without a datum
    click(rims[2].id)
    join(rims[0].id)
    page.run("$('zone').value = '0.3'; $('zone').dispatchEvent(new Event('input'))")
    page.run("$('collect-position').click()")
    wanted = read_wanted(saved_as(page, tmp_path), kinds())
    width, slot, hole = wanted.values()
    assert (width.kind, set(width.entities)) == ("distance", set(walls))
    pattern = [rims[0].id, rims[1].id]
    assert slot == Dimension.position(walls, [bottom, pattern], 0.2, material="M", size=(0.0, 0.1))
    assert hole == Dimension.position(rims[2].id, [], 0.3, pattern=[rims[0].id])
    record = page.run("choice.record()")
    assert dimension_files._picked(record["rows"]) == ({}, wanted, "")
    page.run("choice.remove([...choice.names.keys()]); choice.materials.clear()")
    page.run(f"choice.restore({json.dumps(record)})")
    assert page.run("choice.record()") == record
    # an edge of a slot alone is no datum to click beside a slot that it belongs to
    page.run("placeFrom(emptyChain())")
    click(walls[0])
    shown = "items.filter((_, k) => isShown(k)).map(({ id }) => id)"
    assert set(page.run(shown)) == {str(k) for k in (*walls, left)}
    assert page.complaints == []
    page.close()


def row(name, entity, kind, **more):
    asked = {kind: entity, **more}
    return {"id": str(entity), "name": name, "key": name, "entity": entity, "asked": asked}


def test_a_plan_takes_what_is_picked(part):
    pytest.importorskip("anywidget")
    picker = pick(part)
    assert (picker.entities, picker.dimensions) == ({}, {})
    followed = []
    picker.observe(lambda change: followed.append(change["new"]), "entities")
    edge = part.straight_edges()[0].id
    rim = part.rims()[0].id
    rows = [
        {**row("2", rim, "diameter", tolerance=[-0.1, 0.2], share=0.5), "fault": ""},
        {**row("1", edge, "edge"), "fault": ""},
    ]
    picker.picked = {"rows": rows}
    assert list(picker.entities.items()) == [("2", rim), ("1", edge)]
    assert followed == [picker.entities]
    dimension = Dimension("diameter", (rim,), tolerance=(-0.1, 0.2), share=0.5)
    assert picker.dimensions == {"2": dimension, "1": Dimension("length", (edge,))}
    for items in (picker.entities, picker.dimensions):
        _, targets = resolve_wanted(part, items, 0.98)
        assert [target.name for target in targets] == ["2", "1"]
    assert repr(picker) == "<Picker of 'block </script>': 2 picked>"
    # what lies between two is no entity, and counts as the page counts it
    between = {"key": "3", "asked": {"distance": [edge, edge + 1]}, "fault": ""}
    picker.picked = {"rows": [*rows, between]}
    assert (len(picker.entities), len(picker.dimensions)) == (2, 3)
    assert repr(picker) == "<Picker of 'block </script>': 3 picked>"
    picker.picked = {"rows": [{**rows[0], "fault": "the two deviations must differ"}, rows[1]]}
    assert picker.dimensions == {}
    assert picker.fault == "2: the two deviations must differ"
    assert len(picker.entities) == 2


def test_a_notebook_shows_a_widget(part):
    pytest.importorskip("anywidget")
    views = pick(part)._repr_mimebundle_()
    views = views[0] if isinstance(views, tuple) else views
    assert "application/vnd.jupyter.widget-view+json" in views
    assert len(views["text/plain"]) < 120


def test_without_the_extra_one_line_says_what_to_install(part, monkeypatch):
    monkeypatch.setitem(sys.modules, "anywidget", None)
    dimension_files._picker_class.cache_clear()
    with pytest.raises(MissingExtraError, match=r"needs the package anywidget.*'\.\[notebook\]'"):
        pick(part)
    dimension_files._picker_class.cache_clear()
