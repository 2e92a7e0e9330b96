import base64
import csv
import datetime
import io
import math
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from grid_box import EDGES, BoxSpace
from PIL import Image
from plan_examples import CAMERA, plan, setting
from scipy.spatial.transform import Rotation

import planner
from aspectgraph import compute_regions
from planner import LightPlan, LitImage, look_at
from planner.identity import PartRecord
from planner.plan import InspectionPlan
from planner.report.figure import color_of, plan_figure
from planner.report.overview import facts, report_date
from planner.report.page import make_report, report_html
from planner.report.predicted_image import PictureMaker, png_data
from planner.report.tables import stance
from planner.report.wording import margin_texts, verdict

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
        r'download="measurements.csv" href="data:text/csv;charset=utf-8;base64,([^"]*)"', page
    )
    assert base64.b64decode(data).decode() == box_plan().simulated(500).to_csv()


def test_poses_for_the_robot_are_those_of_the_plan(page):
    table = page[page.index('<table class="stack poses">') :]
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
    assert "Worth a look" not in report_html(first, SPACE)


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
    assert report_date({"SOURCE_DATE_EPOCH": "86400"}) == "1970-01-02"
    today = datetime.datetime.now(datetime.UTC).date()
    for text in ("", "soon", "-5", "9" * 40):
        day = datetime.date.fromisoformat(report_date({"SOURCE_DATE_EPOCH": text}))
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
        part=nasty,
        entities=dict(zip((nasty, "b", f"{nasty}2"), ends, strict=True)),
        settings=(replace(view, passed_over={nasty: {nasty: nasty}}),),
        uninspectable={f"{nasty}2": nasty},
        request={"part": {"digest": nasty}},
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


def test_plotly_is_inlined_once(page):
    assert page.count("plotly.js v") == 1


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
    assert lines == []
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
        "that inspects them under this request has at least 1 setting. Not simulated. P is the probability that the "
        "error is at most 2 % of the edge's image length, given a registered image in which the edge is found."
    )
    assert "Proven minimal" in verdict(box_plan(lower_bound=2))


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
