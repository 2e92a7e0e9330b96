"""Part, graph, plan, results and picker in JupyterLab with a real browser: shown, clicked and read back in Python."""

import json
import os
import re
import time
from pathlib import Path

import pytest
from browser import Browser, needs_browser
from jupyterlab import ROOT, JupyterLab, needs_jupyterlab

from aspectgraph import read_solid
from aspectgraph.plot.picker import picker_html

BLOCK = ROOT / "examples/two_pocket_block.off"
HELPERS = [str(ROOT / "tests" / name / "helpers") for name in ("aspectgraph", "errors", "planner")]
WIDTH_PX = 1200
HEIGHT_PX = 4200
WAIT_S = 120.0
# a cell that is executed before the kernel is there asks for one in a dialogue
READY = """(() => {
    document.querySelector('.jp-Dialog .jp-mod-accept')?.click();
    const context = globalThis.jupyterapp?.shell.currentWidget?.context?.sessionContext;
    return Boolean(context?.isReady && context.session?.kernel) && context.kernelDisplayStatus === 'idle';
})()"""
FRAME = """(() => {
    const frame = document.querySelector('iframe[title*="edges"]');
    const { x, y } = frame.getBoundingClientRect();
    return { x: x + 1, y: y + 1, width: frame.clientWidth, height: frame.clientHeight };
})()"""
CELLS = {
    "solid": f"""
from aspectgraph import build_aspect_graph, read_solid
from planner import Camera, Effort, PoseUncertainty, measure, pick, plan_inspection

solid = read_solid({str(BLOCK)!r})
solid
""",
    "graph": """
build_aspect_graph(solid, {"e1": 1, "e2": 2})
""",
    "results": f"""
import sys

sys.path += {HELPERS}
from measured_plate import POSES, fine_plate, measured_plan, photograph, thick_plate

plate = thick_plate()
measure(measured_plan(plate, ["left"]), plate, photograph(fine_plate(left=0.2), POSES))
""",
    "picker": """
picker = pick(solid)
picker
""",
    "opened": """
bool(picker.picked)
""",
    "picked": """
import json

print(json.dumps([picker.entities, {k: v.kind for k, v in picker.dimensions.items()}]))
""",
    "plan": """
camera = Camera(25.0, (0.0138, 0.0138), (640, 512), 8.0, 300.0)
uncertainty = PoseUncertainty.isotropic(translation_mm=0.1, rotation_rad=0.002)
effort = Effort.named("quick")
plan_inspection(solid, picker.entities, camera, uncertainty, accuracy=0.9, effort=effort)
""",
}


class Notebook:
    """A notebook that is open in JupyterLab."""

    def __init__(self, page):
        self.page = page
        page.wait(READY, timeout_s=WAIT_S)

    def execute(self, name):
        """Select a cell, execute it, and return what it shows as text."""
        number = list(CELLS).index(name)
        cell = f"document.querySelectorAll('.jp-CodeCell')[{number}]"
        self.page.run(f"jupyterapp.shell.currentWidget.content.activeCellIndex = {number}")
        prompt = f"{cell}.querySelector('.jp-InputPrompt').textContent"
        before = json.dumps(self.page.run(prompt))
        self.page.run("void jupyterapp.commands.execute('notebook:run-cell')")
        self.page.wait(f"/[0-9]/.test({prompt}) && {prompt} !== {before}", timeout_s=WAIT_S)
        output = f"{cell}.querySelector('.jp-Cell-outputArea')"
        self.page.wait(f"{output}.textContent !== '' || {output}.querySelector('iframe') !== null")
        text = self.page.run(f"{output}.innerText")
        assert "Traceback" not in text, text
        return text

    def repeat(self, name, is_enough):
        """Execute a cell until its text is enough; return that."""
        end = time.monotonic() + WAIT_S
        while not is_enough(text := self.execute(name)):
            assert time.monotonic() < end, text
            time.sleep(0.5)
        return text


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    process = Browser(tmp_path_factory.mktemp("browser"))
    yield process
    process.close()


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    process = JupyterLab(tmp_path_factory.mktemp("lab"))
    yield process
    process.close()


@pytest.fixture
def page(browser, server):
    """The notebook in JupyterLab; a picture of it is stored if a folder is named, also of one that fails."""
    address = server.notebook("walk", list(CELLS.values()))
    shown = browser.open(address, width=WIDTH_PX, height=HEIGHT_PX)
    yield shown
    if folder := os.environ.get("ASPECTGRAPH_PICTURES"):
        shown.screenshot(Path(folder) / "jupyterlab.png")
    shown.close()


def places_in(browser, frame, folder):
    """Where edges are in a frame of this size, by the page of the picker alone."""
    path = folder / "picker.html"
    path.write_text(picker_html(read_solid(BLOCK)), encoding="utf-8")
    page = browser.page(path, width=frame["width"], height=frame["height"])
    page.wait("state.codes !== null && !state.timer && !state.frame")
    seen = page.run("[...state.seen].map(([k, { x, y }]) => [items[k].id, x, y])")
    page.close()
    return {int(name): (x + frame["x"], y + frame["y"]) for name, x, y in seen}


@needs_browser
@needs_jupyterlab
def test_values_and_the_picker_in_jupyterlab(browser, page, tmp_path):
    """The picker's clicks arrive in Python, and the next cell plans them."""
    notebook = Notebook(page)
    notebook.execute("solid")
    assert "2 entities, " in notebook.execute("graph")
    assert "does not conform" in notebook.execute("results")
    # the part in 3-D, by plotly
    page.wait("document.querySelector('.js-plotly-plot canvas') !== null")
    notebook.execute("picker")
    # the page says what is picked, which is nothing yet, once it has drawn the part
    notebook.repeat("opened", lambda text: "True" in text)
    frame = page.run(FRAME)
    places = places_in(browser, frame, tmp_path)
    edges = sorted(places)[:2]
    for n, edge in enumerate(edges, 1):
        page.click(*places[edge])
        # messages of the page arrive a moment later
        text = notebook.repeat("picked", lambda text, n=n: len(json.loads(text)[0]) == n)
    entities, kinds = json.loads(text)
    assert sorted(entities.values()) == edges
    assert kinds == dict.fromkeys(entities, "length")
    text = notebook.execute("plan")
    assert re.search("Every target is inspected|targets? not inspected", text), text
    assert page.complaints == []
    assert page.requests == []
