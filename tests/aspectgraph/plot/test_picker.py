"""The picker page, in a real browser: what is pointed at, clicked, boxed and filtered, and the file it saves."""

from __future__ import annotations

import json
import re
import shutil
import time
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from browser import Browser, needs_browser
from solids import cube, hollow_box, plate, prism, ring, two_pocket_block

from aspectgraph import EntityError, read_entities
from aspectgraph.plot.picker import picker_html
from aspectgraph.solid.solid import Solid

NAME = 'lid "7" </script><b>'


def bored_block():
    """A block 40 × 20 × 10 about the origin's axis with a bore of radius 4: 12 edges, two rims."""
    solid = prism([(-20, -10), (20, -10), (20, 10), (-20, 10)], 10, [ring(4.0, 24, clockwise=True)])
    in_bore = {v for v, point in enumerate(solid.vertices) if np.hypot(*point[:2]) < 5}
    faces = [replace(face, curved=in_bore.issuperset(face.outer)) for face in solid.faces]
    curved = [edge.vertices for edge in solid.edges if in_bore.issuperset(edge.vertices)]
    return Solid(solid.vertices, faces, curved_edges=curved, name=NAME)


class Structure(HTMLParser):
    def __init__(self):
        super().__init__()
        self.references = []
        self.text = ""
        self.bold = 0

    def handle_starttag(self, tag, attributes):
        self.bold += tag == "b"
        self.references += [
            v for k, v in attributes if k in ("src", "href", "action", "data") and v
        ]


def test_the_page_refers_to_nothing_and_no_name_smuggles_markup():
    page = picker_html(bored_block())
    structure = Structure()
    structure.feed(page)
    assert structure.references == ["data:,"]
    assert structure.bold == 0
    assert "http" not in re.sub(r"[A-Za-z0-9+/]{80,}", "", page)
    assert picker_html(bored_block()) == page


def test_the_page_says_of_each_edge_what_the_solid_says():
    solid = bored_block()
    record = json.loads(
        re.search(
            r'<script type="application/json" id="part-data">(.*?)</script>', picker_html(solid)
        )[1]
    )
    assert record["part"] == NAME
    edges = [item for item in record["items"] if item["kind"] == "edge"]
    assert [int(item["id"]) for item in edges] == [edge.id for edge in solid.straight_edges()]
    for item in edges:
        edge = solid.edges[int(item["id"])]
        assert item["ends"] == solid.edge_points(edge.id).tolist()
        assert item["size"] == np.linalg.norm(np.subtract(*item["ends"]))
        assert item["faces"] == sorted(edge.faces)
        assert all(str(face) in item["rows"][3] for face in edge.faces)
    rims = [item for item in record["items"] if item["kind"] == "rim"]
    assert [item["size"] for item in rims] == pytest.approx([8.0, 8.0])
    # convex: the flat face turns into the bore by 90 degrees
    assert [item["turn"] for item in rims] == pytest.approx([90.0, 90.0], abs=8)
    with pytest.raises(EntityError, match=r"0\.\.\d+\. Got 999"):
        picker_html(solid, [999])


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    found = Browser(tmp_path_factory.mktemp("browser"))
    yield found
    found.close()


@pytest.fixture
def opened(browser, tmp_path):
    pages = []

    def open_page(solid, **size):
        path = tmp_path / "edges.html"
        path.write_text(picker_html(solid), encoding="utf-8")
        page = browser.page(path, **size)
        pages.append(page)
        page.wait(RESTS)
        return page

    yield open_page
    for page in pages:
        assert page.complaints == []
        assert page.requests == []
        page.close()


RESTS = "state.codes !== null && !state.timer && !state.frame"


def place(page, item_id):
    """Where the middle of an edge, or the first point of a rim, is in the window."""
    k = f"items.findIndex((one) => one.id === '{item_id}')"
    point = f"lines[{k}].length === 2 ? middles[{k}] : lines[{k}][0]"
    return page.run(f"scene.project([{point}])[0]")


def seen_from(solid, direction):
    """Edges of a convex solid that are seen: one of their faces looks to the viewer."""
    towards = solid.normals @ np.asarray(direction) > 0
    return {str(edge.id) for edge in solid.edges if towards[list(edge.faces)].any()}


def collected(page):
    return page.run("choice.ids()").split(",") if page.run("choice.names.size") else []


def towards(page):
    return page.run("scene.axes[2]")


@needs_browser
def test_what_is_seen_is_what_the_normals_say(opened):
    solid = cube()
    page = opened(solid)
    assert set(page.run("[...state.seen.keys()].map((k) => items[k].id)")) == seen_from(
        solid, towards(page)
    )
    before = towards(page)
    page.drag((500, 500), (300, 530))
    page.run("document.getElementById('fit').click()")
    page.wait(RESTS)
    direction = towards(page)
    # dragged down, more of the top is seen
    assert before[2] < direction[2] < 1
    assert set(page.run("[...state.seen.keys()].map((k) => items[k].id)")) == seen_from(
        solid, direction
    )


@needs_browser
def test_nothing_in_a_closed_void_is_seen_unless_asked(opened):
    solid = hollow_box()
    page = opened(solid)
    inner = {str(e.id) for e in solid.edges if solid.face_shell[e.faces[0]] == 1}
    seen = "new Set([...state.seen.keys()].map((k) => items[k].id))"
    assert not inner & set(page.run(f"[...{seen}]"))
    page.run("document.getElementById('through').click()")
    assert inner <= set(page.run(f"[...{seen}]"))


@needs_browser
def test_pointing_tells_and_clicking_collects(opened):
    solid = bored_block()
    page = opened(solid)
    top = next(
        e for e in solid.straight_edges() if (solid.edge_points(e.id) @ [0, 1, 1] == 0).all()
    )
    x, y = place(page, top.id)
    page.mouse("mouseMoved", round(x) + 3, round(y) + 3)
    told = page.run("document.getElementById('tip').textContent").split("\n")
    assert told[:3] == [f"edge {top.id}", "length 40 mm", "angle 90°, convex"]
    assert all(str(face) in told[3] for face in top.faces)
    page.click(x, y)
    assert collected(page) == [str(top.id)]
    rim = next(rim for rim in solid.rims() if rim.centre[2] == 10)
    page.mouse("mouseMoved", *place(page, rim.id))
    assert page.run("document.getElementById('tip').textContent").startswith(
        f"rim {rim.id}\ndiameter 8 mm"
    )
    page.click(*place(page, rim.id))
    assert collected(page) == [str(top.id), rim.id]
    page.click(x, y)
    assert collected(page) == [rim.id]
    page.run("document.getElementById('undo').click()")
    assert collected(page) == [str(top.id), rim.id]


@needs_browser
def test_the_saved_file_is_what_entities_reads(opened, browser, tmp_path):
    solid = bored_block()
    page = opened(solid)
    page.call("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
    page.run("document.getElementById('collect-shown').click()")
    names = page.run("[...choice.names.keys()].length")
    assert names == 14
    for which, name in enumerate(["front", 'a "b" \\ ü', "", "front"]):
        page.run(
            f"(() => {{ const field = document.querySelectorAll('#chosen input')[{which}]; "
            f"field.value = {json.dumps(name)}; field.dispatchEvent(new Event('change')); }})()"
        )
    assert "keeps the id" in page.run("document.getElementById('fault').textContent")
    for by_ends in (False, True):
        if by_ends:
            page.run("document.getElementById('by-ends').click()")
        page.run("document.getElementById('save').click()")
        saved = tmp_path / page.run("data.stem + '_entities.toml'")
        for _ in range(200):
            if saved.exists():
                break
            time.sleep(0.05)
        shutil.move(saved, tmp_path / "picked.toml")
        read = read_entities(tmp_path / "picked.toml", solid)
        ids = [edge.id for edge in solid.straight_edges()]
        assert [entity.edge_ids for entity in read.values()][:12] == [(i,) for i in ids]
        assert list(read)[:5] == [
            f"e{ids[0]}",
            'a "b" \\ ü',
            f"e{ids[2]}",
            f"e{ids[3]}",
            f"e{ids[4]}",
        ]
        assert list(read)[12:] == ["r0", "r1"]


@needs_browser
def test_a_box_takes_what_is_inside_or_what_it_touches(opened):
    solid = cube()
    page = opened(solid)
    page.run("document.querySelector('[data-view=\"0 90\"]').click()")
    page.wait(RESTS)
    corners = np.array(page.run("scene.project([[-1,-1,1],[1,-1,1],[1,1,1],[-1,1,1]])"))
    (left, top) = corners.min(axis=0).tolist()
    (right, bottom) = corners.max(axis=0).tolist()
    upper = {str(e.id) for e in solid.edges if (solid.edge_points(e.id)[:, 2] == 2).all()}
    around = (left - 20, top - 20), (right + 20, bottom + 20)
    page.drag(*around, modifiers=8)
    assert set(collected(page)) == upper
    # with Alt too: out again, all it touches, and that is the left edge and the two it meets
    page.drag((left + 40, bottom + 20), (left - 20, top - 20), modifiers=9)
    assert len(collected(page)) == 1
    page.run("document.getElementById('clear').click()")
    page.drag((left + 40, bottom + 20), (left - 20, top - 20), modifiers=8)
    assert len(collected(page)) == 3
    page.run("document.getElementById('clear').click()")
    page.drag((left - 20, top - 20), (left + 40, bottom + 20), modifiers=8)
    assert len(collected(page)) == 1
    page.run("document.getElementById('through').click(); document.getElementById('clear').click()")
    page.drag(*around, modifiers=8)
    assert len(collected(page)) == 12


@needs_browser
def test_filters_hide_what_they_say(opened):
    solid = bored_block()
    page = opened(solid)

    def shown():
        return page.run("items.map((_, k) => k).filter(isShown).map((k) => items[k].id)")

    def set_field(name, value):
        page.run(f"document.getElementById('{name}').value = '{value}'")
        page.run(f"document.getElementById('{name}').dispatchEvent(new Event('input'))")

    longer = [str(e.id) for e in solid.straight_edges() if solid.edge_length_mm(e.id) >= 15]
    set_field("least", 15)
    assert shown() == longer
    set_field("most", 25)
    assert shown() == [i for i in longer if solid.edge_length_mm(int(i)) <= 25]
    set_field("least", "")
    set_field("most", "")
    page.run("document.getElementById('kind-edge').click()")
    assert shown() == ["r0", "r1"]
    page.run("document.getElementById('collect-shown').click()")
    assert collected(page) == ["r0", "r1"]
    page.run(
        "document.getElementById('kind-edge').click(); document.getElementById('convex').click()"
    )
    assert shown() == []
    page.run("document.getElementById('convex').click()")
    set_field("find", f"e{longer[0]} r1")
    assert shown() == [longer[0], "r1"]


@needs_browser
def test_a_double_click_takes_the_edges_of_a_face(opened):
    solid = two_pocket_block()
    page = opened(solid)
    page.run("document.querySelector('[data-view=\"0 0\"]').click()")
    page.wait(RESTS)
    width, height = page.run("scene.size")
    page.click(width / 2, height / 2, count=2)
    foremost = solid.bounds[0][1]
    front = next(
        f
        for f, face in enumerate(solid.faces)
        if (solid.vertices[list(face.outer), 1] == foremost).all()
    )
    assert set(collected(page)) == {str(e.id) for e in solid.straight_edges() if front in e.faces}


@needs_browser
def test_labels_cover_no_other_and_are_more_when_nearer(opened):
    page = opened(plate(6))
    labelled = []
    for turns in (-400, 300, 500):
        page.mouse("mouseWheel", 420, 400, deltaX=0, deltaY=-turns)
        page.wait(RESTS)
        boxes = page.run("state.boxes")
        for n, one in enumerate(boxes):
            assert not any(overlap(one, other) for other in boxes[:n])
        labelled.append({box["k"] for box in boxes})
    assert len(labelled[0]) < len(labelled[1])
    assert labelled[2] - labelled[1]


def overlap(a, b):
    return (
        a["x"] < b["x"] + b["w"]
        and b["x"] < a["x"] + a["w"]
        and a["y"] < b["y"] + b["h"]
        and b["y"] < a["y"] + a["h"]
    )


# the lit pixels of the part, and whether a line is found where its middle is
DRAWN = """(() => {
  const gl = scene.gl, [w, h] = [scene.canvas.width, scene.canvas.height], bytes = new Uint8Array(4 * w * h);
  scene.draw(false);
  gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
  let n = 0;
  for (let i = 0; i < bytes.length; i += 4) n += bytes[i] < 250;
  return n;
})()"""
LOST = "WebGL: CONTEXT_LOST_WEBGL"


@needs_browser
def test_a_lost_context_comes_back(browser, tmp_path):
    path = tmp_path / "edges.html"
    path.write_text(picker_html(cube()), encoding="utf-8")
    page = browser.page(path)
    page.wait(RESTS)
    before = page.run(DRAWN)
    edge = page.run("items[[...state.seen.keys()][0]].id")
    page.run("window.away = scene.gl.getExtension('WEBGL_lose_context'); away.loseContext()")
    page.wait("scene.gl.isContextLost() && state.codes === null")
    # whoever clicks meanwhile picks nothing
    page.click(*place(page, edge))
    assert collected(page) == []
    page.run("away.restoreContext()")
    page.wait(f"!scene.gl.isContextLost() && {RESTS}")
    assert page.run(DRAWN) == before > 10_000
    page.click(*place(page, edge))
    assert collected(page) == [edge]
    assert [text for text in page.complaints if LOST not in text] == []
    page.close()


@needs_browser
def test_on_a_phone_all_is_below_each_other(opened):
    page = opened(cube(), width=400, height=800)
    assert page.run("document.documentElement.scrollWidth") <= 400
    assert page.run("document.querySelector('aside').getBoundingClientRect().top >= scene.size[1]")
    assert page.run("state.seen.size") == 9
