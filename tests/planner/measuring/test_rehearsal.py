"""Rendered images of a plan: what they show is what they say, and `measure` reads it."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from holed_plate import HOLES
from measured_plate import TOP, dimensions_of, measured_plan, thick_plate
from PIL import Image
from plan_examples import changed, planned_dimension

from aspectgraph import Solid, read_solid
from errors.measurands import Line
from ground.convert import from_plain
from ground.faces import program_name
from planner import (
    Camera,
    Dimension,
    Lighting,
    PoseUncertainty,
    Registration,
    Rehearsal,
    RequestError,
    measure,
    plan_inspection,
)
from planner.camera.camera import tangents_of
from planner.exceptions import PlanFileError
from planner.inspection import with_light
from planner.measuring.measurer import Measurer
from planner.measuring.rehearsal import CHORD_MM, DeviatingPart, Truth
from planner.measuring.samples import PartModel
from planner.measuring.seen_breaks import pixel_mm
from planner.sensor_setting import Reason

TARGETS = ("left", "right", "apart", "width")


@pytest.fixture(scope="module")
def plate():
    return thick_plate()


@pytest.fixture(scope="module")
def plan(plate):
    return measured_plan(plate, TARGETS)


def grey_of(rehearsal):
    return {image.shot.setting + 1: image.grey for image in rehearsal.images()}


def test_a_rehearsal_is_one_line(plate, plan):
    text = repr(Rehearsal(plan, plate, surfaces_mm=0.01, seed=3))
    assert text == f"<Rehearsal of {plan.part!r}: 2 images, surfaces 0.01 mm, seed 3>"


def test_the_part_as_designed_has_its_nominal_values(plate, plan):
    rehearsal = Rehearsal(plan, plate, surfaces_mm=0.0, exact_poses=True)
    for values in rehearsal.truth.values.values():
        assert values == pytest.approx({name: plan.targets[name].nominal for name in TARGETS})
    planned = [np.asarray(setting.cam2world) for setting in plan.settings]
    assert np.array_equal(list(rehearsal.truth.poses.values()), planned)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_what_is_measured_is_what_is_shown(plate, plan, seed):
    rehearsal = Rehearsal(plan, plate, seed=seed)
    truth = rehearsal.truth.values["setting_01"]
    assert all(abs(truth[name] - plan.targets[name].nominal) > 1e-4 for name in TARGETS)
    results = measure(plan, plate, grey_of(rehearsal))
    for result in results:
        assert result.measured, result.reason
        assert abs(result.value - truth[result.name]) <= 3 * result.standard_uncertainty


@pytest.mark.parametrize(("response", "white_level"), [("srgb", None), (2.2, 4095)])
def test_images_have_the_response_and_the_white_of_the_camera(plate, plan, response, white_level):
    camera = replace(plan.camera, response=response, white_level=white_level)
    stated = replace(plan, request=replace(plan.request, camera=camera))
    rehearsal = Rehearsal(stated, plate, seed=1)
    images = grey_of(rehearsal)
    white = white_level or 255
    assert all(
        image.dtype == (np.uint8 if white == 255 else np.uint16) for image in images.values()
    )
    assert max(image.max() for image in images.values()) <= white
    assert (rehearsal.truth.response, rehearsal.truth.white_level) == (str(response), white)
    # the same light, by the formulas of IEC 61966-2-1 and of a power; noise is one of both images
    of_light = grey_of(Rehearsal(plan, plate, seed=1))
    for number, image in images.items():
        linear = of_light[number] / 255
        expected = linear ** (1 / 2.2)
        if response == "srgb":
            expected = 1.055 * linear ** (1 / 2.4) - 0.055
        bright = (linear > 0.2) & (linear < 0.95)
        assert np.median((image / white - expected)[bright]) == pytest.approx(0.0, abs=2e-3)
    truth = rehearsal.truth.values["setting_01"]
    for result in measure(stated, plate, images):
        assert result.measured, result.reason
        assert abs(result.value - truth[result.name]) <= 3 * result.standard_uncertainty


def test_values_that_several_images_give_have_a_truth(plate, plan):
    """A plan that does not inspect a target may show its entities; `measure` joins them."""
    full = Rehearsal(plan, plate, seed=4)
    left_out = measured_plan(plate, ["left", "right", "apart"])
    width = measured_plan(plate, ["width"]).targets["width"]
    left_out = changed(
        left_out,
        targets=(*left_out.request.targets, width),
        uninspectable={"width": Reason("no view")},
    )
    fewer = Rehearsal(left_out, plate, seed=4)
    assert full.truth.joined == {}
    assert fewer.truth.joined == {"width": full.truth.values["setting_01"]["width"]}


def test_progress_is_a_share_of_all_images(plate, plan):
    """Steps of rays mean nothing to who waits."""
    steps = []
    for _ in Rehearsal(plan, plate, seed=1).images(lambda *step: steps.append(step)):
        pass
    assert {step[1:] for step in steps} == {(100, "rendering 2 images, percent")}
    shares = [step[0] for step in steps]
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0, 100)


@pytest.fixture(scope="module")
def under_dome(plate, plan):
    """The plan of one setting under a dome, and what a rehearsal of it shows and tells."""
    lit = with_light(changed(plan, settings=plan.settings[:1]), plate, Lighting("diffuse-dome"))
    steps = []
    rehearsal = Rehearsal(lit, plate, surfaces_mm=0.0, exact_poses=True)
    (image,) = rehearsal.images(lambda *step: steps.append(step))
    return lit, image, [step[0] for step in steps]


def test_a_dome_is_drawn_from_few_pixels_as_from_all(plate, under_dome):
    """Each of 1,500 pixels, from rays to it alone: in the middle, and in 16 parts where faces meet."""
    plan, image, shares = under_dome
    assert (shares[0], shares[-1]) == (0, 100)
    assert shares == sorted(shares)
    rng = np.random.default_rng(7)
    width, height = plan.camera.resolution
    pixels = np.column_stack([rng.integers(5, width - 5, 1500), rng.integers(5, height - 5, 1500)])
    part = DeviatingPart(Measurer(plan, plate).model, 0.0, rng)
    area = plan.light.area.held(image.pose)

    def light_at(places):
        rays = np.column_stack([tangents_of(plan.camera, places), np.ones(len(places))])
        return area.brightness(part.scene, image.pose[:3, 3], rays @ image.pose[:3, :3].T)

    expected = np.mean(
        [light_at(pixels + step) for step in rng.uniform(-0.5, 0.5, (16, 2))], axis=0
    )
    grey = image.grey[pixels[:, 1], pixels[:, 0]].astype(float)
    on_part = expected > 0.1
    # exposure and the share of shadows are one scale and one offset
    scale = np.polyfit(expected, grey, 1)
    off = (grey - np.polyval(scale, expected)) / scale[0]
    assert on_part.sum() > 200
    assert np.median(np.abs(off[on_part])) < 0.02
    assert np.abs(off.mean()) < 0.005
    # of what is beside an edge, blur moves some to the other side
    assert (np.abs(off) < 0.06).mean() > 0.97


def test_images_of_another_plan_are_noted(plate, plan, tmp_path):
    """Nothing may be where it should be then; the digest of the plan tells why."""
    Rehearsal(plan, plate, seed=1).write(tmp_path)
    digest = plan.digest
    assert not [note for note in measure(plan, plate, tmp_path).notes if "rendered" in note]
    other = changed(plan, unfinished=True)
    assert other.digest != digest
    (note,) = [note for note in measure(other, plate, tmp_path).notes if "rendered" in note]
    assert note.startswith("the images were rendered for another plan: truth.json beside them")
    assert digest[:12] in note
    assert other.digest[:12] in note
    # what is missing is then no part of this plan's images, so nothing advises to leave it out
    (tmp_path / "setting_02.png").unlink()
    with pytest.raises(
        RequestError, match=r"Got no setting_02; the images were rendered"
    ) as caught:
        measure(other, plate, tmp_path)
    assert "partial" not in str(caught.value)
    with pytest.raises(RequestError, match=r"Got no setting_02; partial=True measures"):
        measure(plan, plate, tmp_path)
    (tmp_path / "setting_03.png").write_bytes((tmp_path / "setting_01.png").read_bytes())
    with pytest.raises(RequestError, match=r"does not take; they may be of another plan"):
        measure(plan, plate, tmp_path)
    (tmp_path / "setting_03.png").unlink()
    Rehearsal(plan, plate, seed=1).write(tmp_path)
    (tmp_path / "truth.json").write_text("no JSON")
    assert not [note for note in measure(other, plate, tmp_path).notes if "rendered" in note]


def test_faces_deviate_as_their_own_targets_state(plate):
    """The walls of one hole by 1 µm, the other faces by 50 µm: a plan promises each target for its own."""
    every = dimensions_of(plate)
    plan = measured_plan(
        plate,
        dimensions={
            "left": replace(every["left"], stated_surfaces_mm=0.001),
            "right": replace(every["right"], stated_surfaces_mm=0.05),
        },
        names=("left", "right"),
    )
    off = np.array(
        [
            [
                value - plan.targets[name].nominal
                for name, value in Rehearsal(plan, plate, seed=seed)
                .truth.values["setting_01"]
                .items()
            ]
            for seed in range(40)
        ]
    )
    # of a diameter, twice the deviation of the radius, half as large again as that of planes
    left, right = off.std(axis=0) / (2 * 1.5)
    assert left == pytest.approx(0.001, rel=0.4)
    assert right == pytest.approx(0.05, rel=0.4)
    uniform = Rehearsal(plan, plate, surfaces_mm=0.05, seed=1).truth
    assert abs(uniform.values["setting_01"]["left"] - plan.targets["left"].nominal) > 0.01


def test_flat_faces_stay_flat_around_holes(plate, plan):
    """Also inside the triangles whose sides are cut into short chords, so that shading shows no fans."""
    part = DeviatingPart(Measurer(plan, plate).model, 0.02, np.random.default_rng(3))
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(1, 79, 60), np.linspace(1, 49, 40)))
    start = np.stack([x, y, np.full(len(x), TOP + 50.0)], axis=1)
    height = TOP + 50.0 - part.scene.cast(start, np.tile([0.0, 0.0, -1.0], (len(x), 1)))["t_hit"]
    top = height > TOP - 1.0
    assert top.sum() > 1000
    columns = np.stack([x, y, np.ones(len(x))], axis=1)[top]
    fit, *_ = np.linalg.lstsq(columns, height[top], rcond=None)
    assert np.abs(columns @ fit - height[top]).max() < 1e-4
    assert np.abs(height[top] - TOP).max() > 0.005


def test_flat_faces_are_shaded_as_flat(plate, plan):
    """Slender triangles between holes lean, where both ends are moved by what else they are on."""
    part = DeviatingPart(Measurer(plan, plate).model, 0.05, np.random.default_rng(3))
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(1, 79, 90), np.linspace(1, 49, 60)))
    start = np.stack([x, y, np.full(len(x), TOP + 50.0)], axis=1)
    hit = part.scene.cast(start, np.tile([0.0, 0.0, -1.0], (len(x), 1)))
    top = np.isfinite(hit["t_hit"]) & (hit["t_hit"] < 51.0)
    assert top.sum() > 3000
    assert np.ptp(hit["primitive_normals"][top], axis=0).max() < 1e-6


def frustum(*more_rings):
    """A cone whose radius falls from 10 to 6 mm over 5 mm, and more points of it."""
    rings = []
    for radius, height, angle in (
        (10.0, 0.0, 2 * np.pi * np.arange(72) / 72),
        (6.0, 5.0, 2 * np.pi * np.arange(72) / 72),
        *more_rings,
    ):
        ring = [radius * np.cos(angle), radius * np.sin(angle), np.full(len(angle), height)]
        rings.append(np.stack(ring, axis=1))
    faces = [list(range(72))[::-1], list(range(72, 144))]
    for k in range(1 if more_rings else 0, 72):
        after = (k + 1) % 72
        faces += [[k, after, 72 + after], [k, 72 + after, 72 + k]]
    if more_rings:
        faces += [[0, 1, 144], [1, 73, 144], [73, 72, 144], [72, 0, 144]]
    return PartModel(Solid(np.concatenate(rings), faces, name="frustum"), {})


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_walls_end_where_their_rims_are_moved(seed):
    """Points of a wall between its rims slide with them: those that stayed stood out above a lower top."""
    model = frustum()
    flat = np.array([carrier.is_plane for carrier in model.carriers.surfaces])
    part = DeviatingPart(model, 1.0 * flat, np.random.default_rng(seed))
    angle = np.linspace(0.0, 2 * np.pi, 400, endpoint=False)
    out = np.stack([np.cos(angle), np.sin(angle), np.zeros(400)], axis=1)
    inside = 4.0 * out + np.array([0.0, 0.0, 20.0])
    down = np.tile([0.0, 0.0, -1.0], (400, 1))
    top = 20.0 - part.scene.cast(inside, down)["t_hit"]
    # a plane: its height above the rim from that within
    rise = np.linalg.lstsq(np.c_[4.0 * out[:, :2], np.ones(400)], top, rcond=None)[0]
    radius = (10.0 - 0.8 * rise[2]) / (1.0 + 0.8 * out[:, :2] @ rise[:2])
    rim = rise[2] + radius * (out[:, :2] @ rise[:2])
    assert np.abs(rim - 5.0).max() > 0.3
    above = part.scene.cast(20.0 * out + np.outer(rim + 0.1, [0, 0, 1]), -out)
    below = part.scene.cast(20.0 * out + np.outer(rim - 0.1, [0, 0, 1]), -out)
    assert np.min(above["t_hit"]) > 20.0 - 5.9
    np.testing.assert_allclose(20.0 - below["t_hit"], radius + 0.08, atol=0.1)


def test_a_cone_is_round_where_its_facets_meet_between_its_rims():
    """A mesh may have a vertex within a countersink. It is on no edge."""
    model = frustum((8.0, 2.5, np.array([np.pi / 72])))
    part = DeviatingPart(model, 0.0, np.random.default_rng(0))
    angle = np.linspace(0.0, 2 * np.pi, 500, endpoint=False)
    out = np.stack([np.cos(angle), np.sin(angle), np.zeros(500)], axis=1)
    for height in (0.3, 2.0, 2.6, 4.7):
        hit = part.scene.cast(20.0 * out + np.array([0.0, 0.0, height]), -out)
        radius = 10.0 - 0.8 * height
        np.testing.assert_allclose(20.0 - hit["t_hit"], radius, atol=1.1 * CHORD_MM)
        expected = (out + np.array([0.0, 0.0, 0.8])) / np.hypot(1.0, 0.8)
        np.testing.assert_allclose(hit["primitive_normals"], expected, atol=1e-5)


def test_the_ground_is_dark_also_under_a_ring_light(plate, plan):
    """Little of a ring's light reaches the camera, and the exposure allows for it."""
    lit = with_light(changed(plan, settings=plan.settings[:1]), plate, Lighting("ring-light"))
    (image,) = Rehearsal(lit, plate, exact_poses=True).images()
    grey = image.grey.astype(float)
    assert np.quantile(grey, 0.02) < 20
    assert grey.max() > 150


def test_rendered_edges_are_sharp_whatever_is_stated(plate, plan, tmp_path):
    Rehearsal(plan, plate, seed=1).write(tmp_path)
    stated = measure(plan, plate, tmp_path, edge_break_mm=(0.05, 0.1))
    (note,) = [note for note in stated.notes if "with sharp edges" in note]
    assert "edges are stated as broken by 0.05 to 0.1 mm" in note
    for sharp in ({}, {"edge_break_mm": (0.0, 0.0)}):
        assert not [
            note for note in measure(plan, plate, tmp_path, **sharp).notes if "sharp edges" in note
        ]
    (tmp_path / "truth.json").unlink()
    photographs = measure(plan, plate, tmp_path, edge_break_mm=(0.05, 0.1))
    assert not [note for note in photographs.notes if "with sharp edges" in note]


def plane_of_hits(scene, places):
    """Normal of the plane that rays from above meet at places (n, 2)."""
    start = np.column_stack([places, np.full(len(places), 500.0)])
    depth = scene.cast(start, np.tile([0.0, 0.0, -1.0], (len(places), 1)))["t_hit"]
    columns = np.column_stack([places, np.ones(len(places))])
    (x, y, _), residual, *_ = np.linalg.lstsq(columns, 500.0 - depth, rcond=None)
    assert residual < 1e-6
    return np.array([-x, -y, 1.0])


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_four_planes_of_a_corner_still_meet_there(seed):
    """They have no common point once each deviates on its own: an edge then ends elsewhere than its planes do."""
    base = [[0, 0, 0], [80, 0, 0], [80, 50, 0], [0, 50, 0]]
    sides = [(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)]
    corners = np.array([*base, [40, 25, 30]], dtype=float)
    pyramid = Solid(corners, [(3, 2, 1, 0), *sides], name="pyramid")
    slants = [Line(corners[k], corners[4]) for k in (0, 2)]
    angle = planned_dimension("angle", ("first", "second"), tuple(slants), 0.1)
    plan = measured_plan(pyramid, ("angle",), dimensions={"angle": angle})
    part = DeviatingPart(Measurer(plan, pyramid).model, 0.5, np.random.default_rng(seed))
    inside = [[[0.2, 0.6, 0.2], [0.6, 0.2, 0.2], [0.3, 0.3, 0.4], [0.2, 0.2, 0.6]] for _ in sides]
    front, right, back, left = (
        plane_of_hits(part.scene, np.array(shares) @ corners[list(side), :2])
        for shares, side in zip(inside, sides, strict=True)
    )
    ways = [np.cross(front, left), np.cross(right, back)]
    cosine = np.abs(ways[0] @ ways[1]) / np.prod(np.linalg.norm(ways, axis=1))
    value = part.value("angle", plan.targets["angle"])
    assert abs(value - plan.targets["angle"].nominal) > 0.01
    # what is left is of the second order in the deviations
    assert value == pytest.approx(np.degrees(np.arccos(cosine)), abs=0.03)


def test_walls_of_bores_do_not_stand_out_of_their_rims(plate, plan):
    """Rays along the axis, inside of the rim by no more than chords may be off, meet nothing."""
    part = DeviatingPart(Measurer(plan, plate).model, 0.0, np.random.default_rng(0))
    angle = np.arange(0.0, 2 * np.pi, 0.01)
    off = 1.01 * CHORD_MM
    for (x, y), radius in HOLES.values():
        way = np.stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))], axis=1)
        start = [x, y, 2 * TOP] + (radius - off) * way
        for one in start:
            hit = part.scene.cast(one, np.array([[0.0, 0.0, -1.0]]))
            assert np.isinf(hit["t_hit"]).all()


def test_walls_of_bores_are_round_from_rim_to_rim(plate, plan):
    """A wall that bulges between its rims would hide the lower one from a camera above."""
    part = DeviatingPart(Measurer(plan, plate).model, 0.0, np.random.default_rng(0))
    angle = np.linspace(0.0, 2 * np.pi, 500, endpoint=False)
    ways = np.stack([np.cos(angle), np.sin(angle), np.zeros(500)], axis=1)
    for (x, y), radius in HOLES.values():
        for height in np.linspace(0.02, 0.98, 25) * TOP:
            hit = part.scene.cast(np.array([x, y, height]), ways)["t_hit"]
            assert hit.max() < radius + 1e-6
            assert hit.min() > radius - 1.01 * CHORD_MM


def test_walls_of_bores_are_shaded_as_round(plate, plan):
    """Deviations tilt the slender triangles of a wall by degrees, which would look like edges."""
    part = DeviatingPart(Measurer(plan, plate).model, 0.05, np.random.default_rng(2))
    angle = np.linspace(0.0, 2 * np.pi, 400, endpoint=False)
    ways = np.stack([np.cos(angle), np.sin(angle), np.zeros(400)], axis=1)
    for (x, y), _ in HOLES.values():
        hit = part.scene.cast(np.array([x, y, TOP / 2]), ways)
        np.testing.assert_allclose(hit["primitive_normals"], -ways, atol=1e-5)
    # a plane as it is, and nothing where nothing is met
    down = np.tile([0.0, 0.0, -1.0], (1, 1))
    assert part.scene.cast(np.array([1.0, 1.0, 2 * TOP]), down)["primitive_normals"][0, 2] > 0.999
    assert np.isinf(part.scene.cast(np.array([-9.0, 1.0, 2 * TOP]), down)["t_hit"][0])


def test_true_values_are_those_of_the_part_that_rays_meet(plate, plan):
    model = Measurer(plan, plate).model
    part = DeviatingPart(model, 0.1, np.random.default_rng(5))
    # the planes of both sides, where rays at right angles meet them just below the upper edges
    x = np.linspace(1.0, 79.0, 40)
    start = np.stack([x, np.full(40, -50.0), np.full(40, TOP - 0.5)], axis=1)
    front = part.scene.cast(start, np.tile([0.0, 1.0, 0.0], (40, 1)))["t_hit"] - 50.0
    behind = start + np.array([0.0, 200.0, 0.0])
    back = 150.0 - part.scene.cast(behind, np.tile([0.0, -1.0, 0.0], (40, 1)))["t_hit"]
    assert np.mean(back - front) == pytest.approx(
        part.value("width", plan.targets["width"]), abs=0.01
    )
    # the wall of a hole just below its rim, where chords of the wall are not yet seen
    circle = plan.targets["left"].geometry[0]
    angle = np.linspace(0.0, 2 * np.pi, 400, endpoint=False)
    ways = np.stack([np.cos(angle), np.sin(angle), np.zeros(400)], axis=1)
    radii = part.scene.cast(circle.centre - [0, 0, 0.1], ways)["t_hit"]
    assert 2 * radii.mean() == pytest.approx(part.value("left", plan.targets["left"]), abs=0.004)


def test_true_values_state_date_program_and_digests(plate, plan, tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    Rehearsal(plan, plate).write(tmp_path)
    data = json.loads((tmp_path / "truth.json").read_text())
    assert data["date"] == "1970-01-02T00:00:00Z"
    assert data["program"] == program_name()
    assert data["part"] == plan.request.part.name
    assert data["part_digest"] == plan.request.part.digest
    assert data["plan_digest"] == plan.digest
    # files of older releases lack them
    older = {k: v for k, v in data.items() if k not in ("date", "program", "part", "part_digest")}
    assert from_plain(Truth, older, PlanFileError).date == ""


def test_the_same_seed_gives_the_same_files(plate, plan, tmp_path):
    for name in ("first", "again", "other"):
        Rehearsal(plan, plate, seed=int(name == "other")).write(tmp_path / name)
    read = {
        name: [(tmp_path / name / f"setting_{k:02d}.png").read_bytes() for k in (1, 2)]
        for name in ("first", "again", "other")
    }
    assert read["first"] == read["again"]
    assert read["first"] != read["other"]
    data = json.loads((tmp_path / "first" / "truth.json").read_text())
    assert from_plain(Truth, data, PlanFileError).seed == 0
    image = np.asarray(Image.open(tmp_path / "first" / "setting_01.png"))
    # nothing beside what is measured is overexposed, and the part is bright
    assert 0.5 * 255 < np.quantile(image, 0.9) < 250


def test_images_of_an_earlier_plan_leave_and_files_of_the_user_stay(plate, plan, tmp_path):
    """A plan of fewer settings could not be measured in a folder that an earlier plan was rendered into."""
    fewer = measured_plan(plate, ["width"], settings=1)
    folder = tmp_path / "images"
    Rehearsal(plan, plate, seed=1).write(folder)
    truth = json.loads((folder / "truth.json").read_text())
    pictures = {path.name: path.read_bytes() for path in folder.glob("*.png")}
    assert truth["images"] == {k: hashlib.sha256(v).hexdigest() for k, v in pictures.items()}
    mine = {"notes.txt": b"mine", "setting_07.png": pictures["setting_02.png"]}
    for name, content in mine.items():
        (folder / name).write_bytes(content)
    files = Rehearsal(fewer, plate, seed=1).write(folder)
    assert files == [str(folder / name) for name in ("truth.json", "setting_01.png")]
    assert {path.name for path in folder.iterdir()} == {"truth.json", "setting_01.png", *mine}
    assert {name: (folder / name).read_bytes() for name in mine} == mine
    (folder / "setting_07.png").unlink()
    assert measure(fewer, plate, folder).measured


@pytest.mark.parametrize("kind", ["photograph", "older", "elsewhere", "not a truth"])
def test_what_a_rehearsal_did_not_surely_write_stays(plate, plan, tmp_path, kind):
    fewer = measured_plan(plate, ["width"], settings=1)
    folder = tmp_path / "images"
    Rehearsal(plan, plate, seed=1).write(folder)
    stays = folder / "setting_02.png"
    path = folder / "truth.json"
    truth = json.loads(path.read_text())
    if kind == "photograph":
        # by the name of a rendered one
        stays.write_bytes(b"of a camera")
    elif kind == "older":
        # files of older releases state no digests
        del truth["images"]
    elif kind == "elsewhere":
        stays = tmp_path / "other.png"
        stays.write_bytes(b"of a camera")
        truth["images"]["../other.png"] = hashlib.sha256(b"of a camera").hexdigest()
    else:
        truth["format"] = "of another program"
    path.write_text(json.dumps(truth))
    before = stays.read_bytes()
    Rehearsal(fewer, plate, seed=1).write(folder)
    assert stays.read_bytes() == before
    assert json.loads(path.read_text())["plan_digest"] == fewer.digest


def test_images_of_an_earlier_plan_stay_if_rendering_fails(plate, plan, tmp_path, monkeypatch):
    Rehearsal(plan, plate, seed=1).write(tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    rehearsal = Rehearsal(measured_plan(plate, ["width"], settings=1), plate, seed=1)

    def interrupted(progress):
        raise KeyboardInterrupt

    monkeypatch.setattr(rehearsal, "images", interrupted)
    with pytest.raises(KeyboardInterrupt):
        rehearsal.write(tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"surfaces_mm": -0.1}, "surfaces_mm must be finite and not negative"),
        # the diagonal of 80 × 50 × 40 mm is 102.5 mm
        ({"surfaces_mm": 10.3}, "surfaces_mm must be at most 10.2 mm, a tenth of the part's size"),
        ({"seed": -1}, "seed must be an integer of at least 0"),
    ],
)
def test_numbers_out_of_their_range_are_refused(plate, plan, wrong, told):
    with pytest.raises(RequestError, match=f"^{told}"):
        Rehearsal(plan, plate, **wrong)


def test_a_sheet_that_deviates_by_pixels_is_registered():
    """Both edges of its thickness are 6 px apart, one is dark, and the sheet is up to 4 px off: each takes the step."""
    solid = read_solid(Path(__file__).parents[3] / "examples" / "nist_ctc_03_ap242.stp.gz")
    pose = np.eye(4)
    pose[:3] = [
        [0.973943853, -0.195875172, 0.114307869, -172.01],
        [-0.102479077, -0.829739300, -0.548662676, 557.59],
        [0.202315127, 0.522652476, -0.828192598, 257.20],
    ]
    plan = plan_inspection(
        solid,
        {"size": Dimension.diameter("r18", max_error_mm=0.762)},
        Camera(8.0, (0.00345, 0.00345), (2448, 2048), 8.0, 300.0),
        PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001),
        poses=[pose],
        lamps=[(46.9, 448.6, 936.8)],
    )
    rehearsal = Rehearsal(plan, solid, seed=1, surfaces_mm=0.22)
    by_edges = Registration.own_edges(0.22)
    size = measure(plan, solid, grey_of(rehearsal), registration=by_edges)["size"]
    assert size.measured, size.reason
    truth = rehearsal.truth.values["setting_01"]["size"]
    assert abs(size.value - truth) <= 2 * size.standard_uncertainty


def test_faces_that_deviate_by_more_than_images_tell(plate, plan, tmp_path):
    """Beyond the widest search it is refused; beyond what is taken for no knowledge, a note says what it does to U."""
    Rehearsal(plan, plate, seed=1).write(tmp_path)
    poses = [setting.cam2world for setting in plan.settings]
    pixel = pixel_mm(plan.camera, plate, poses)
    usual = measure(plan, plate, tmp_path, registration=Registration.own_edges(0.05))
    wide = measure(plan, plate, tmp_path, registration=Registration.own_edges(20 * pixel))
    (note,) = [note for note in wide.notes if note.startswith("faces are stated to deviate by")]
    assert "20 px of these images" in note
    assert not [note for note in usual.notes if "stated to deviate" in note]
    for result in usual:
        assert wide[result.name].standard_uncertainty > 1.25 * result.standard_uncertainty
    with pytest.raises(RequestError, match=r"^surfaces_mm must be at most .* which are 60 px"):
        measure(plan, plate, tmp_path, registration=Registration.own_edges(61 * pixel))
