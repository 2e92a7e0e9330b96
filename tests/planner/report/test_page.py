"""The report in a real browser: it loads alone, its buttons and circles move and show what they say, fits a phone."""

import base64
import csv
import datetime
import io
import math
import re
import shutil
import zlib
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import unquote

import numpy as np
import pytest
from browser import Browser, needs_browser
from grid_box import EDGES, BoxSpace
from PIL import Image
from plan_examples import CAMERA, changed, plan, planned_dimension, setting
from plotly.offline import get_plotlyjs
from rimmed_solids import PITCH, PlateBuilder
from scipy.spatial.transform import Rotation

import planner
from aspectgraph import Solid, build_aspect_graph, compute_regions, read_solid
from errors.measurands import Circle, Localisation
from planner import Lighting, LightPlan, LitImage, look_at, read_plan
from planner.files import timestamp
from planner.identity import PartRecord
from planner.plan import InspectionPlan
from planner.report.figure import color_of, figure_views, plan_figure
from planner.report.page import _unforeseen, facts, make_report, report_html
from planner.report.predicted_image import PictureMaker, png_data
from planner.report.tables import stance
from planner.report.terminal_tables import print_explanation
from planner.report.wording import margin_texts, verdict
from planner.request.reach import TargetSpace

SIZE = (80.0, 50.0, 60.0)
SPACE = BoxSpace(SIZE, [[-900.0] * 3, [900.0] * 3], EDGES)


def box_plan(**changes):
    entities = {name: SPACE.entities[name].endpoints for name in ("+z-y", "+z+x", "-z+y")}
    settings = (
        setting((40.0, -180.0, 620.0), ["+z-y", "+z+x"]),
        setting((250.0, 40.0, 600.0), ["+z+x"], probability=0.99),
    )
    return plan(
        entities=entities,
        settings=settings,
        uninspectable={"-z+y": "unobservable: <hidden> & gone"},
        **changes,
    )


class Structure(HTMLParser):
    """Checks that tags nest, and gathers what refers to something else."""

    def __init__(self):
        super().__init__()
        self.open = []
        self.references = []
        self.counts = {}

    def handle_starttag(self, tag, attributes):
        self.counts[tag] = self.counts.get(tag, 0) + 1
        self.references += [
            v for k, v in attributes if k in ("src", "href", "action", "data") and v
        ]
        if tag not in ("meta", "link", "br", "img"):
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def page():
    return report_html(box_plan().simulated(500), SPACE)


def test_page_is_well_formed_and_needs_nothing_from_outside(page):
    structure = Structure()
    structure.feed(page)
    assert structure.open == []
    assert structure.references
    assert all(ref.startswith(("#", "data:")) for ref in structure.references)
    # image and edge map of two settings, whole and enlarged; and the part for desktop and phone
    assert structure.counts["svg"] == 8 + 2
    assert page.count("<figcaption>Predicted image: the frame enlarged") == 2
    assert page.count('<rect class="frame"') == 2
    assert "url(http" not in page


def test_page_says_what_matters(page):
    text = re.sub(r"<script.*?</script>", "", page, flags=re.S)
    assert "2 of 3 edges are measured from 2 camera poses (settings 1 and 2)." in text
    assert "Every plan that inspects them under this request has at least 1 camera pose." in text
    assert "unobservable: &lt;hidden&gt; &amp; gone" in text
    assert '<span class="good">confirmed</span>' in text
    assert "0.9500" in text
    for name in ("+z-y", "+z+x"):
        assert f">{name}</text>" in text


@pytest.mark.parametrize(
    ("generations", "sentence"),
    [
        ((0, 0), "No pose of this plan comes from the genetic algorithm."),
        ((0, 12), "The poses of 1 setting come from the genetic algorithm and its refinement."),
    ],
)
def test_page_says_which_poses_the_genetic_algorithm_found(generations, sentence):
    given = box_plan()
    settings = [
        replace(pose, generations=n) for pose, n in zip(given.settings, generations, strict=True)
    ]
    text = report_html(replace(given, settings=tuple(settings)), SPACE)
    assert sentence in text
    assert text.count("the genetic algorithm") == 1


def test_page_says_what_rendered_images_gave_for_the_class_of_its_edges(page):
    """The numbers are those of docs/showing.md."""
    known = (Path(__file__).parents[3] / "docs/showing.md").read_text(encoding="utf-8")
    assert "Rendered images, not photographs" in page
    assert "137 measurements" in page
    assert "137 clean measurements" in known
    assert "none of 180 images" in page
    assert "0 of 180, all three" in known
    assert "in a third of the images" in page
    assert ".333 / .213 / .143" in known


def test_the_rows_can_be_saved_from_the_page(page):
    (data,) = re.findall(
        r'download="measurements.csv" href="data:text/csv;charset=utf-8,([^"]*)"', page
    )
    assert unquote(data) == box_plan().simulated(500).to_csv()


def test_poses_for_the_robot_are_those_of_the_plan(page):
    table = page[page.index('<table class="stack poses"') :]
    cells = re.findall(r'<td class="n"[^>]*>([^<]*)</td>', table[: table.index("</table>")])
    values = np.array(cells, dtype=float).reshape(2, 10)
    for row, one in zip(values, box_plan().settings, strict=True):
        assert row[:3] == pytest.approx(one.position, abs=5e-4)
        assert Rotation.from_quat(row[3:7]).as_matrix() == pytest.approx(
            one.cam2world[:3, :3], abs=1e-5
        )
        turn = Rotation.from_euler("xyz", row[7:], degrees=True)
        assert turn.as_matrix() == pytest.approx(one.cam2world[:3, :3], abs=1e-4)


def test_what_deserves_a_look_comes_first():
    page = report_html(box_plan(accuracy=0.9995), SPACE)
    text = re.sub(r"<script.*?</script>", "", page, flags=re.S)
    assert text.index("Worth a look") < text.index('id="results"')
    assert "<b>+z+x</b> (setting <a" in text
    assert "under two pixels" in text
    # all that its first setting measures is well in focus
    first = replace(box_plan(), settings=box_plan().settings[:1])
    notices = re.findall(r"<li><b>([^<]*)</b>", report_html(first, SPACE))
    assert notices == ["Light"]


def test_the_head_has_three_sentences_at_most(page):
    (lead,) = re.findall(r'<p class="lead">(.*?)</p>', page)
    assert 1 <= len(re.findall(r"[.:](?: |$)", lead)) <= 4
    assert len(re.findall(r"\.(?: |$)", lead)) <= 3
    # simulation and light stand behind the fold
    (more,) = re.findall(r"<details>(.*?)</details>", page, re.S)
    assert "simulation" in more
    assert "simulation" not in lead


def test_the_head_says_where_the_plan_comes_from():
    made = box_plan(part=PartRecord("block", "0123456789abcdef" * 4))
    assert facts(made, "2026-03-01") == {
        "Part": "block",
        "Digest of the part": "0123456789ab",
        "Camera": "test camera, f = 25 mm, f/8, focused at 600 mm",
        "Camera pose": "σ = 0.05 mm and 0.001 rad",
        "Program": f"aspectgraph {planner.__version__}",
        "Date": "2026-03-01",
    }
    assert "Date" not in facts(made)


def test_the_date_is_that_of_the_environment_or_today():
    # one day after the first second of 1970
    assert timestamp({"SOURCE_DATE_EPOCH": "86400"}) == "1970-01-02T00:00:00Z"
    today = datetime.datetime.now(datetime.UTC).date()
    for text in ("", "soon", "-5", "9" * 40):
        day = datetime.date.fromisoformat(timestamp({"SOURCE_DATE_EPOCH": text})[:10])
        assert 0 <= (day - today).days <= 1


def test_a_probability_near_one_is_said_once_and_u_is_shown(page):
    # one of two settings is less sure
    assert '<th class="n">P</th>' in page
    sure = replace(
        box_plan(),
        settings=tuple(
            replace(one, probability=dict.fromkeys(one.entities, 1.0))
            for one in box_plan().settings
        ),
    )
    page = report_html(sure, SPACE)
    assert '<th class="n">P</th>' not in page
    assert "P is &gt; 0.9999 for each target." in page
    assert "U / permitted" in page
    assert "Smallest P" not in page


def test_no_file_says_that_a_probability_is_one():
    sure = replace(
        box_plan(),
        settings=tuple(
            replace(one, probability=dict.fromkeys(one.entities, 1.0))
            for one in box_plan().settings
        ),
    )
    rows = csv.DictReader(io.StringIO(sure.to_csv()))
    stated = [float(row["probability"]) for row in rows if row["probability"]]
    stated += [p for one in sure.to_dict()["settings"] for p in one["probability"].values()]
    simulated = sure.simulated(200).to_dict()["simulation"]["rates"]
    stated += [rate["predicted"] for rates in simulated for rate in rates.values()]
    assert len(stated) == 9
    assert all(0.999 < p < 1 for p in stated)
    assert InspectionPlan.from_dict(sure.to_dict()) == sure


def test_a_setting_says_how_its_camera_stands():
    """600 mm straight above a horizontal edge, one pixel is 3.5 um times 600 by the image distance."""
    above = replace(
        box_plan().settings[1], cam2world=look_at([(80.0, 25.0, 660.0)], (80.0, 25.0, 60.0))[0]
    )
    made = replace(box_plan(), settings=(above,), uninspectable={"-z+y": "so", "+z-y": "so"})
    stands = stance(made, above)
    assert stands.distance_mm == pytest.approx(600)
    assert stands.tilt_deg == pytest.approx(0, abs=1e-5)
    assert stands.um_per_px == pytest.approx(3.5 * 600 / CAMERA.image_distance_mm)
    tilted = stance(box_plan(), box_plan().settings[1])
    assert tilted.tilt_deg == pytest.approx(
        math.degrees(math.acos(-box_plan().settings[1].cam2world[2, 2]))
    )


def test_page_is_the_same_for_the_same_plan(page):
    assert report_html(box_plan().simulated(500), SPACE) == page


def test_no_name_can_smuggle_markup():
    nasty = "</script><script>alert(1)</script>\"'&"
    ends = [SPACE.entities[name].endpoints for name in ("+z-y", "+z+x", "-z+y")]
    view = setting((40.0, -180.0, 620.0), [nasty, "b"])
    made = plan(
        entities=dict(zip((nasty, "b", f"{nasty}2"), ends, strict=True)),
        settings=(replace(view, passed_over={nasty: {nasty: nasty}}),),
        uninspectable={f"{nasty}2": nasty},
        part=PartRecord(nasty, nasty),
        camera=replace(CAMERA, name=nasty),
    )
    regions = compute_regions(SPACE.solid, made.entities, workspace=SPACE.workspace)
    page = report_html(made.simulated(200), regions, notes=[nasty], date=nasty)
    assert "<script>alert(1)" not in page
    assert "</script>&#34;" not in page
    structure = Structure()
    structure.feed(page)
    assert structure.open == []
    assert structure.counts["script"] == report_html(box_plan(), SPACE).count("<script")


def test_report_without_settings_or_simulation():
    nothing = plan(
        entities={"-z+y": SPACE.entities["-z+y"].endpoints},
        settings=(),
        uninspectable={"-z+y": "unobservable"},
        lower_bound=0,
    )
    page = report_html(nothing, SPACE)
    assert "0 of 1 edge inspected: the plan has no camera poses." in page
    assert "there is nothing to prove" in page
    assert "proven minimum" not in page
    assert ">nan<" not in page


def unpacked(page, attribute):
    (packed,) = re.findall(attribute + r">([A-Za-z0-9+/=]+)<", page)
    return zlib.decompress(base64.b64decode(packed)).decode()


def test_plotly_is_inlined_once(page):
    assert unpacked(page, 'id="plotly"') == get_plotlyjs()
    # a report is to be sent by mail
    assert len(page) < 2_300_000


def plate_report(n_columns):
    """The report of a plate with two rows of holes: a setting measures eight rims, from above or from below."""
    builder = PlateBuilder(n_columns, 2, 6)
    for i in range(n_columns):
        for j in range(2):
            builder.add((PITCH * i + PITCH // 2, PITCH * j + PITCH // 2), 25, 0)
    part = builder.part("plate")
    solid = Solid(part.vertices, part.faces)
    groups = {}
    dimensions = {}
    for rim in solid.rims():
        x, _, z = rim.centre
        groups.setdefault((z, x // (4 * PITCH)), []).append(rim)
        circle = Circle(rim.centre, rim.axis, rim.radius_mm)
        fields = {"localisation": Localisation.fit(), "tolerance": (-1.2, 1.2)}
        dimensions[f"bore {rim.id}"] = planned_dimension(
            "diameter", [rim.id], [circle], 0.3, **fields
        )
    settings = []
    for (z, column), rims in groups.items():
        x = 4 * PITCH * (column + 0.5)
        height = 640.0 if z else -640.0
        names = [f"bore {rim.id}" for rim in rims]
        settings.append(setting((x + 50.0, 90.0, height), names, (x, PITCH, z)))
    space = compute_regions(
        solid, [rim.id for rim in solid.rims()], workspace=[[-900] * 3, [900] * 3]
    )
    planned = plan(
        part=PartRecord.of(solid),
        entities={},
        dimensions=dimensions,
        settings=tuple(settings),
        uninspectable={},
    )
    targets = TargetSpace.of(space, planned.targets.values())
    return report_html(planned, targets), len(dimensions)


def test_a_plan_of_dimensions_is_reported_from_its_part_and_from_its_regions():
    """The part suffices. Regions under the ids of the entities give the same page."""
    solid = read_solid("examples/nist_ctc_01_ap242.stp")
    made = read_plan("examples/measured/plan.json")
    page = report_html(made, solid)
    assert "4 of 4 dimensions are measured from 2 camera poses" in page
    ids = [name for target in made.targets.values() for name in target.entities]
    regions = compute_regions(solid, ids, workspace=made.workspace)
    assert regions.entity_names == tuple(ids)
    assert report_html(made, regions) == page
    names = [trace.name for trace in made.plot(solid, regions).data]
    assert {"domains of setting 1", "domains of setting 2"} <= set(names)


def test_a_report_grows_by_at_most_10_kb_a_target():
    few, n = plate_report(4)
    many, n_many = plate_report(8)
    assert (n, n_many) == (16, 32)
    assert many.count('class="shot map"') >= 4
    assert len(many.encode()) - len(few.encode()) < 10_000 * (n_many - n)


def test_a_narrow_page_has_a_rule_for_every_heading(page):
    """The headings of a table stand once, as variables; a rule for each column repeats them."""
    used = {int(k) for k in re.findall(r"--h(\d+):", page)}
    assert used
    assert used <= {int(k) for k in re.findall(r"content: var\(--h(\d+)\)", page)}
    (labels,) = re.findall(r'<table class="stack poses" style="([^"]*)"', page)
    assert "--h2:&quot;" in labels
    assert "--h1:" not in labels


def test_pictures_of_a_setting_share_their_lines(page):
    held = re.findall(r'<path id="(edges-\d+)"', page)
    assert held == ["edges-1", "edges-2"]
    for name in held:
        assert page.count(f'href="#{name}"') >= 2
    assert set(re.findall(r'<use class="measured" href="#([^"]*)"', page)) == {"lines-1", "lines-2"}


def lines_from(position, target=(40.0, 25.0, 30.0)):
    pose = look_at([position], target)[0]
    return PictureMaker(SPACE.solid, CAMERA).edge_lines(pose), pose


def total_length(lines):
    return sum(np.linalg.norm(b - a) for a, b in lines)


def test_straight_on_one_sees_the_outline_of_one_face():
    lines, _ = lines_from((40.0, 25.0, 660.0))
    d = CAMERA.image_distance_mm
    # the top at depth 600; nothing of the box behind it shows
    expected = 2 * 80 * d / 600 / 0.00345 + 2 * 50 * d / 600 / 0.0035
    assert total_length(lines) == pytest.approx(expected, rel=1e-3)


def test_from_a_corner_nine_edges_show_and_three_are_hidden():
    lines, pose = lines_from((400.0, 350.0, 400.0))
    drawn = 0
    for name in EDGES:
        middle = SPACE.entities[name].endpoints.mean(axis=0)
        x, y, z = pose[:3, :3].T @ (middle - pose[:3, 3])
        uv = CAMERA.matrix @ [x / z, y / z, 1.0]
        drawn += any(_distance(uv[:2], a, b) < 1.0 for a, b in lines)
        assert (
            any(_distance(uv[:2], a, b) < 1.0 for a, b in lines)
            == SPACE.observable(pose[None, :3, 3], [name])[0, 0]
        )
    assert drawn == 9


def _distance(p, a, b):
    t = np.clip(np.dot(p - a, b - a) / np.dot(b - a, b - a), 0, 1)
    return np.linalg.norm(a + t * (b - a) - p)


def test_lines_are_cut_off_at_the_image_and_at_the_camera():
    lines, _ = lines_from((40.0, 25.0, 75.0))
    assert len(lines) == 0
    lines, _ = lines_from((-20.0, 25.0, 90.0), target=(80.0, 25.0, 60.0))
    pixels = np.array(lines)
    assert len(pixels)
    assert pixels.min() >= -0.5
    assert pixels[..., 0].max() <= 2447.5 + 1e-6


def test_shading_is_white_where_there_is_no_part():
    pose = look_at([(40.0, 25.0, 660.0)], (40.0, 25.0, 30.0))[0]
    image = PictureMaker(SPACE.solid, CAMERA).shaded(pose)
    assert image[0, 0] == 250
    assert image[image.shape[0] // 2, image.shape[1] // 2] < 240


def test_png_is_what_was_encoded():
    image = np.random.default_rng(0).integers(0, 256, (5, 7)).astype(np.uint8)
    head, _, data = png_data(image).partition(",")
    assert head == "data:image/png;base64"
    png = Image.open(io.BytesIO(base64.b64decode(data)))
    assert (png.format, png.mode) == ("PNG", "L")
    assert np.array_equal(np.asarray(png), image)


def test_lamps_are_drawn_and_told():
    names = {"+z-y": 0.3, "+z+x": 1.0}
    images = ((LitImage((0,), names, ("+z+x",)),), (LitImage((1,), {"+z+x": 0.76}),))
    light = LightPlan(
        "placed",
        0.1,
        0.05,
        "dark",
        np.array([[40.0, -300, 500], [300, 25, 90]]),
        images,
        ({}, {}),
        1,
        "so",
    )
    lit = box_plan(light=light)
    lamps = next(trace for trace in plan_figure(lit, SPACE.solid).data if trace.name == "lamps")
    assert np.column_stack([lamps.x, lamps.y, lamps.z]).tolist() == light.lamps.tolist()
    assert lamps.hovertext[0].endswith("mm<br>setting 1: +z-y, +z+x")
    page = report_html(lit, SPACE)
    assert "under lamp 2</figcaption>" in page
    assert (
        "Lamp 1 at (40.0, -300.0, 500.0) mm: contrast of +z-y 0.30, +z+x 1.00 (silhouette)" in page
    )
    assert "2 lamp positions give every measurement a contrast of at least" in page
    assert "(proven lower bound: 1)" in page


def test_figure_holds_part_settings_and_domains():
    figure = plan_figure(box_plan(), SPACE.solid, SPACE)
    names = [trace.name for trace in figure.data]
    for expected in (
        "part",
        "setting 1",
        "camera 2",
        "not inspected",
        "order of travel",
        "domains of setting 2",
    ):
        assert expected in names
    domains = next(trace for trace in figure.data if trace.name == "domains of setting 1")
    assert domains.visible == "legendonly"
    assert domains.color == color_of(0)
    assert len(domains.i) > 0


def test_margins_are_told_with_their_units():
    margins = {"resolution_mm": 0.25, "field_of_view_px": 12.0, "visibility": 1.0, "reach": -1.0}
    assert margin_texts(margins) == [
        "resolution +0.25 mm on the sensor",
        "field of view +12 px",
        "visibility met",
        "reach missed",
    ]


def test_verdict_names_bound_and_simulation():
    assert verdict(box_plan()) == (
        "2 of 3 entities inspected from 2 settings. Proven lower bound for the 2 inspected entities: 1. Every plan "
        "that inspects them under this request has at least 1 setting. Not simulated. Light is not planned, so "
        "nothing is promised of contrast: an edge that your lamps do not show is not measured. --light plans lamps."
    )


def test_light_that_is_asked_for_is_not_advised():
    """As where the time limit ended before lamps were found."""
    said = verdict(changed(box_plan(), lighting=Lighting("ring")))
    assert "Light is not planned yet, so nothing is promised of contrast" in said
    assert "--light" not in said


def test_what_probabilities_mean_is_printed_on_demand(capsys):
    print_explanation(box_plan())
    text = " ".join(capsys.readouterr().out.split())
    assert text.startswith(
        "P is the probability that the error is at most 2 % of the edge's image length, "
    )


def test_pictures_that_had_no_time_are_replaced_by_a_sentence(page):
    """All else is there, and the option that brings them is named."""
    brief = report_html(box_plan(), SPACE, until=0.0)
    edge_map = 'aria-label="edge map"'
    assert brief.count(edge_map) == 0 < page.count(edge_map)
    assert brief.count("A longer --time-limit draws them.") == 2
    assert brief.count("Margins:") == page.count("Margins:")
    (sentence,) = make_report(box_plan(), SPACE, until=0.0).left_out
    assert "2 settings" in sentence
    assert "--time-limit" in sentence
    assert make_report(box_plan(), SPACE).left_out == []
    names = {one.name for one in plan_figure(box_plan(), SPACE.solid, SPACE, until=0.0).data}
    every = {one.name for one in plan_figure(box_plan(), SPACE.solid, SPACE).data}
    assert every - names == {"domains of setting 1", "domains of setting 2"}


# The report in a real browser: it loads alone, its buttons and circles move and show what they
# say, fits a phone.


NAMES = ("+z-y", "+z+x", "-z+y")
SPACE_REPORT_PAGE = BoxSpace((80.0, 50.0, 60.0), [[-900.0] * 3, [900.0] * 3], EDGES)
EYE = "(({x, y, z}) => [x, y, z])(plan3d.layout.scene.camera.eye)"


def box_plan_report_page():
    entities = {name: SPACE_REPORT_PAGE.entities[name].endpoints for name in NAMES}
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
        SPACE_REPORT_PAGE.solid,
        {name: SPACE_REPORT_PAGE.entities[name].endpoints for name in NAMES},
        workspace=SPACE_REPORT_PAGE.workspace,
    )
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(
        report_html(box_plan_report_page().simulated(500), SPACE_REPORT_PAGE, graph=graph),
        encoding="utf-8",
    )
    return path


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    folder = tmp_path_factory.mktemp("profile")
    program = Browser(folder)
    yield program
    program.close()
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="module")
def page_report_page(browser, file):
    shown = browser.page(file, 1400, 900)
    shown.wait("document.body.dataset.ready === 'yes'")
    yield shown
    shown.close()


def click(page_report_page, selector):
    """Click the middle of an element with the mouse."""
    x, y = page_report_page.run(
        f"(() => {{ const one = document.querySelector({selector!r}); one.scrollIntoView({{block: 'center'}});"
        "const r = one.getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2]; })()"
    )
    page_report_page.click(x, y)


@needs_browser
def test_it_asks_for_nothing_and_complains_of_nothing(page_report_page):
    assert page_report_page.requests == []
    assert page_report_page.complaints == []


@needs_browser
def test_a_lost_context_comes_back(browser, file):
    """As when a computer sleeps: the canvas shows what it showed."""
    shown = browser.page(file, 1000, 800)
    shown.wait("document.body.dataset.ready === 'yes'")
    plot = "plan3d._fullLayout.scene._scene.glplot"
    drawn = f"""(() => {{
      {plot}.redraw();
      const gl = {plot}.gl, [w, h] = [gl.drawingBufferWidth, gl.drawingBufferHeight], all = new Uint8Array(4 * w * h);
      gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, all);
      return all.filter((value, i) => i % 4 === 3 && value > 0).length;
    }})()"""
    before = shown.run(drawn)
    shown.run(
        f"window.old = {plot}; window.away = old.gl.getExtension('WEBGL_lose_context'); away.loseContext()"
    )
    shown.wait("old.gl.isContextLost()")
    shown.run("away.restoreContext()")
    shown.wait(f"{plot} !== old && !{plot}.gl.isContextLost()")
    assert shown.run(drawn) == pytest.approx(before, rel=0.01)
    assert before > 10_000
    shown.close()


@needs_browser
def test_long_words_of_a_setting_wrap_and_its_table_fits(page_report_page):
    words = "by e5 from 0 to 50 percent, e3, one of 3 ways " * 3
    assert page_report_page.run(
        f"""(() => {{
          const frame = document.querySelector('.setting .scroll'), cell = frame.querySelector('tbody td:nth-child(2)');
          const before = cell.innerHTML;
          cell.textContent = '{words}';
          const fits = frame.scrollWidth <= frame.clientWidth;
          cell.innerHTML = before;
          return fits;
        }})()"""
    )


@needs_browser
def test_a_shadow_shows_that_a_table_scrolls(page_report_page):
    style = "getComputedStyle(document.querySelector('.scroll')).backgroundAttachment"
    assert page_report_page.run(style) == "local, local, scroll, scroll"


@needs_browser
def test_the_picture_in_space_is_as_wide_as_its_frame(page_report_page):
    """On a desktop the graph stands beside it, which comes after the picture was drawn."""
    widths = page_report_page.run(
        "[plan3d.querySelector('svg.main-svg'), plan3d, plan3d.closest('.scene')]"
        ".map((one) => one.getBoundingClientRect().width)"
    )
    assert widths[2] < 900
    # the frame has a border of 1 px
    assert widths[:2] == pytest.approx([widths[2] - 2] * 2, abs=1)


@needs_browser
def test_the_first_view_is_that_of_everything(page_report_page):
    wanted = figure_views(box_plan_report_page(), SPACE_REPORT_PAGE.solid)["everything"]["eye"]
    # a wide picture is filled to its height, so the eye is where it was computed
    assert page_report_page.run(EYE) == pytest.approx([wanted[i] for i in "xyz"])


@needs_browser
@pytest.mark.parametrize("name", ["part", "setting-2", "everything"])
def test_a_click_moves_the_camera(page_report_page, name):
    click(page_report_page, f'.views [data-view="{name}"]')
    wanted = figure_views(box_plan_report_page(), SPACE_REPORT_PAGE.solid)[name]["eye"]
    page_report_page.wait(f"Math.abs(plan3d.layout.scene.camera.eye.x - {wanted['x']}) < 1e-9")
    assert page_report_page.run(EYE) == pytest.approx([wanted[i] for i in "xyz"])


@needs_browser
def test_the_view_of_a_setting_has_the_field_of_its_camera(page_report_page):
    fovy = "plan3d._fullLayout.scene._scene.glplot.fovy"
    click(page_report_page, '.views [data-view="setting-1"]')
    width, height = page_report_page.run("(({w, h}) => [w, h])(plan3d._fullLayout._size)")
    # half the sensor over the image distance; the picture is wider than the sensor
    half_height = 2048 / 2 * 0.0035 / CAMERA.image_distance_mm
    assert width / height > 2448 / 2048
    wanted = 2 * np.arctan(1.04 * half_height)
    page_report_page.wait(f"Math.abs({fovy} - {wanted}) < 1e-9")
    click(page_report_page, '.views [data-view="everything"]')
    page_report_page.wait(f"{fovy} === Math.PI / 4")


@needs_browser
def test_a_setting_leads_to_its_view_in_space(page_report_page):
    click(page_report_page, '#setting-1 [data-view="setting-1"]')
    wanted = figure_views(box_plan_report_page(), SPACE_REPORT_PAGE.solid)["setting-1"]["eye"]
    page_report_page.wait(f"Math.abs(plan3d.layout.scene.camera.eye.x - {wanted['x']}) < 1e-9")
    top = page_report_page.run("document.getElementById('space').getBoundingClientRect().top")
    assert 0 <= top < 200


@needs_browser
def test_a_chosen_target_stands_out_and_all_of_them_come_back(page_report_page):
    def choose(value):
        page_report_page.run(
            f"(() => {{ target.value = {value!r}; target.dispatchEvent(new Event('change')); }})()"
        )

    def faint(group):
        shown = (
            f"plan3d.data.filter((one) => one.legendgroup === '{group}').map((one) => one.opacity)"
        )
        return set(page_report_page.run(shown))

    count = "plan3d.data.filter((one) => one.name === 'chosen target').length"
    # the second target of the first setting is the only one of the second
    choose("1:1")
    page_report_page.wait(f"{count} === 1")
    xs = page_report_page.run(
        "Array.from(plan3d.data.find((one) => one.name === 'chosen target').x)"
    )
    assert xs == [*SPACE_REPORT_PAGE.entities["+z+x"].endpoints[:, 0], None]
    told = page_report_page.run("ways.textContent")
    assert told.startswith("Setting 1 measures +z+x. Measured in setting 2, too.")
    assert (faint("setting 1"), faint("setting 2")) == ({0.5}, {0.12})
    choose("none:0")
    page_report_page.wait(
        "ways.textContent.startsWith('-z+y is not inspected: unobservable: <hidden> & gone')"
    )
    page_report_page.wait(
        f"{count} === 1 && plan3d.data.at(-1).x[0] === {SPACE_REPORT_PAGE.entities['-z+y'].endpoints[0][0]}"
    )
    choose("")
    page_report_page.wait(f"{count} === 0")
    assert page_report_page.run("ways.textContent") == ""
    assert faint("setting 1") == faint("setting 2") == {1}


@needs_browser
def test_domains_of_a_setting_are_switched_in_the_legend(page_report_page):
    index = page_report_page.run(
        "plan3d.data.findIndex((one) => one.name === 'domains of setting 1')"
    )
    shown = f"plan3d.data[{index}].visible"
    assert page_report_page.run(shown) == "legendonly"
    x, y = page_report_page.run(
        "(() => { plan3d.scrollIntoView({block: 'center'});"
        "const name = 'domains of setting 1';"
        "const one = [...plan3d.querySelectorAll('.traces')].find((t) => t.textContent.includes(name));"
        "const r = one.querySelector('.legendtoggle').getBoundingClientRect();"
        "return [r.x + r.width / 2, r.y + r.height / 2]; })()"
    )
    page_report_page.click(x, y)
    page_report_page.wait(f"{shown} === true")


@needs_browser
def test_a_click_on_a_domain_shows_it_and_the_next_hides_it(page_report_page):
    node = page_report_page.run(
        "Object.keys(JSON.parse(document.getElementById('domains').textContent))[0]"
    )
    count = "plan3d.data.filter((one) => one.name === 'chosen domain').length"
    assert page_report_page.run(count) == 0
    click(page_report_page, f'[data-domain="{node}"] circle')
    page_report_page.wait(f"{count} === 1")
    found = page_report_page.run(
        "(({x, y, z}) => [x, y, z].map((c) => Array.from(c)))(plan3d.data.find((one) => one.name === 'chosen domain'))"
    )
    low = np.min(found, axis=1)
    high = np.max(found, axis=1)
    assert (high > low).all()
    assert page_report_page.run("document.getElementById('domain').textContent").startswith(
        f"Domain {node} sees"
    )
    # another one takes its place
    other = page_report_page.run(
        f"[...document.querySelectorAll('[data-domain]')].find((g) => g.dataset.domain !== '{node}').dataset.domain"
    )
    click(page_report_page, f'[data-domain="{other}"] circle')
    page_report_page.wait(
        f"{count} === 1 && document.getElementById('domain').textContent.startsWith('Domain {other} ')"
    )
    assert page_report_page.run("document.querySelectorAll('.graph .chosen').length") == 1
    click(page_report_page, f'[data-domain="{other}"] circle')
    page_report_page.wait(f"{count} === 0")
    assert page_report_page.run("document.getElementById('domain').textContent") == ""
    assert page_report_page.complaints == []


# A4 less 10 mm at each side
@needs_browser
def test_on_paper_nothing_is_wider_than_the_page(page_report_page):
    page_report_page.run("dispatchEvent(new Event('beforeprint'))")
    page_report_page.call("Emulation.setEmulatedMedia", media="print")
    page_report_page.call(
        "Emulation.setDeviceMetricsOverride",
        width=718,
        height=1047,
        deviceScaleFactor=1,
        mobile=False,
    )
    wide = page_report_page.run(
        "[...document.querySelectorAll('main *')].filter((one) => !one.closest('#plan3d') && !one.closest('svg')"
        " && one.getBoundingClientRect().right > innerWidth + 1).map((one) => one.tagName + '.' + one.className)"
    )
    assert wide == []
    assert page_report_page.run("getComputedStyle(document.querySelector('nav')).display") == "none"
    # the picture in 3-D as it was drawn for the screen, legend and all
    inside = "((a, b) => a.right <= b.right + 1 && a.bottom <= b.bottom + 1)"
    svg, frame = (
        f"plan3d.{part}.getBoundingClientRect()"
        for part in ("querySelector('svg')", "closest('.scene')")
    )
    assert page_report_page.run(f"{inside}({svg}, {frame})")
    # beside it is room for the graph
    assert page_report_page.run(f"{frame}.width") < 450
    page_report_page.run("dispatchEvent(new Event('afterprint'))")
    page_report_page.call("Emulation.setEmulatedMedia", media="")
    page_report_page.call(
        "Emulation.setDeviceMetricsOverride",
        width=1400,
        height=900,
        deviceScaleFactor=1,
        mobile=False,
    )


@needs_browser
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
    centre = figure_views(box_plan_report_page(), SPACE_REPORT_PAGE.solid)["everything"]
    middle, near = (np.array([centre[key][i] for i in "xyz"]) for key in ("center", "eye"))
    assert np.linalg.norm(eye - middle) > np.linalg.norm(near - middle)
    assert phone.requests == []
    assert phone.complaints == []
    phone.close()


@needs_browser
def test_a_plan_of_nothing_is_shown_too(browser, tmp_path):
    name = "-z+y"
    nothing = plan(
        settings=(),
        entities={name: SPACE_REPORT_PAGE.entities[name].endpoints},
        uninspectable={name: "unobservable"},
        lower_bound=0,
    )
    path = tmp_path / "report.html"
    path.write_text(report_html(nothing, SPACE_REPORT_PAGE), encoding="utf-8")
    shown = browser.page(path, 1400, 900)
    shown.wait("document.body.dataset.ready === 'yes'")
    assert shown.complaints == []
    # part and what is not inspected
    assert "not inspected" in shown.run("plan3d.data.map((one) => one.name)")
    shown.close()


def pages_of_headings(page):
    """Return the page of paper of each heading, by its text, as the outline of a printed PDF names them."""
    printed = page.call("Page.printToPDF", generateDocumentOutline=True, generateTaggedPDF=True)
    entry = rb"/Title \(([^)]*)\)\s*/Dest \[(\d+) 0 R"
    return dict(re.findall(entry, base64.b64decode(printed["data"])))


@needs_browser
def test_on_paper_headings_stay_with_what_they_are_of(browser, file):
    """Whatever is above them: the 3-D view does not go on to the next page alone, nor do pictures of a setting."""
    shown = browser.page(file, 1400, 900)
    shown.wait("document.body.dataset.ready === 'yes'")
    # headings of their own show in the outline where a figure and pictures begin
    for place, mark in ((".space", "the view"), (".shots", "pictures")):
        shown.run(
            f"document.querySelector('{place}').insertAdjacentHTML('afterbegin', '<h6>{mark}</h6>')"
        )
    shown.run(
        "for (const one of document.querySelectorAll('#space, #setting-1'))"
        " one.insertAdjacentHTML('beforebegin', '<div class=above></div>')"
    )
    pages = []
    for height in range(0, 1000, 20):
        shown.run(
            f"document.querySelectorAll('.above').forEach((one) => one.style.height = '{height}px')"
        )
        found = pages_of_headings(shown)
        assert found[b"3-D view"] == found[b"the view"], height
        assert found[b"Setting 1"] == found[b"pictures"], height
        pages.append((found[b"3-D view"], found[b"Setting 1"]))
    # heights of about a page move each of them to the next one
    assert all(len(set(places)) > 1 for places in zip(*pages, strict=True))
    shown.close()


def test_lengths_are_named_whose_uncertainty_is_not_foreseen():
    """The same in two settings counts once; an edge that is not a dimension has no U."""
    stated = {"bore": 1, "nose": None, "e3": None}
    rows = [
        [SimpleNamespace(name=name, foreseen=stated[name]) for name in names]
        for names in (("bore", "nose"), ("nose", "e3"))
    ]
    made = SimpleNamespace(dimensions={"bore": 1, "nose": 1})
    assert _unforeseen(made, rows) == ["nose"]
