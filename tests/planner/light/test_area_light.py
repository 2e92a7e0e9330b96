"""A backlight behind a part: closed forms of a bore, known answers by hand, plans, files, bad input, and measuring."""

import pickle
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from holed_plate import BACK, CAMERA, HEIGHT, HOLES, QUICK, SIZE, UNCERTAINTY, holed_plate
from measured_plate import CAMERA as COARSE
from measured_plate import thick_plate
from scipy.spatial.transform import Rotation

from aspectgraph import Solid, compute_regions
from ground.convert import from_plain, to_plain
from planner import (
    Backlight,
    Dimension,
    InfeasibleError,
    Registration,
    Rehearsal,
    RequestError,
    measure,
    plan_inspection,
    plan_light,
    read_plan,
)
from planner.app.job import read_lighting
from planner.app.options import Light
from planner.light.area_light import AreaSpace, EdgePoints, Sight, entity_shown
from planner.light.lighting import Lighting
from planner.light.reflection import Material
from planner.search.plan_setting import check_observable
from planner.sensor_setting import ReasonKind

PLATE = holed_plate()
(CENTRE, RADIUS) = HOLES["left"]
UNDER = Backlight.under(PLATE)
SIGHT = Sight.of(PLATE, CAMERA)
# walls are many pixels wide
FINE = SIGHT._replace(pixel_rad=SIGHT.pixel_rad / 20)
DISTANCE = 300.0


def rim_at(height, hole="left", solid=PLATE):
    place = [*HOLES[hole][0], height]
    (rim,) = (rim for rim in solid.rims() if np.allclose(rim.centre, place))
    return rim


def eye_beside(offset):
    """A camera above the plate, so far beside the axis of the bore."""
    return np.array([[CENTRE[0] + offset, CENTRE[1], DISTANCE]])


@pytest.mark.parametrize("offset", [0.0, 4.0, 7.5, 40.0, 90.0, 150.0])
def test_the_outline_of_a_bore_is_that_of_two_discs(offset):
    """What a camera sees through a bore is where the images of its two rims overlap.

    On the lower plane, the bore's lower rim is a circle of radius r about 0. Seen from the camera at height d and
    distance a from the axis, the upper rim in height h lies on the circle of radius r / (1 - s) about
    -a s / (1 - s), with s = h / d. Of each circle, that part bounds the bright region which is inside the other one.
    """
    share = HEIGHT / DISTANCE
    shift = -offset * share / (1 - share)
    upper = RADIUS / (1 - share)
    for height in (0.0, HEIGHT):
        edges = EdgePoints.of(PLATE, rim_at(height).edge_ids)
        angle = np.arctan2(*(edges.points[:, 1::-1] - CENTRE[::-1]).T)
        x = RADIUS * np.cos(angle)
        y = RADIUS * np.sin(angle)
        if height:
            inside = RADIUS - np.hypot(shift + x / (1 - share), y / (1 - share))
        else:
            inside = upper - np.hypot(x - shift, y)
        contrast, step = UNDER.contrasts(FINE, edges, eye_beside(offset))
        assert np.array_equal(contrast > 0, step > 0)
        # 24 chords are up to .07 mm from the circle
        clear = np.abs(inside) > 0.1
        assert clear.mean() > 0.5
        assert np.array_equal(contrast[0, clear] > 0, inside[clear] > 0)


def test_a_rim_shows_if_all_of_it_bounds_the_bright_region():
    eyes = np.vstack([eye_beside(a) for a in (0.0, 6.0, 40.0)])
    # a matt wall that the camera sees is a quarter as bright as the rectangle
    for height, expected in ((0.0, [0.6, 0.6, 0]), (HEIGHT, [0, 0, 0])):
        contrast, _ = entity_shown(UNDER, FINE, rim_at(height).edge_ids, eyes)
        assert contrast.tolist() == pytest.approx(expected)


def test_a_wall_next_to_an_edge_must_be_wide_or_hardly_there():
    """The image of the wall is r h / (d - h) wide on the lower plane, as seen from the axis: 0.276 mm."""
    rim = rim_at(0.0).edge_ids
    width = RADIUS * HEIGHT / (DISTANCE - HEIGHT)
    metal = replace(UNDER, material=Material("metal"))
    # half of the rectangle's light, as the search takes it
    third = (1 - 0.5) / (1 + 0.5)
    for pixels, on_matt, on_metal in ((3.3, 0.6, third), (2.7, 0, 0), (0.5, 0, 0)):
        sight = SIGHT._replace(pixel_rad=width / pixels / DISTANCE)
        for light, expected in ((UNDER, on_matt), (metal, on_metal)):
            contrast, step = entity_shown(light, sight, rim, eye_beside(0.0))
            assert contrast.tolist() == pytest.approx([expected])
            assert step.tolist() == pytest.approx([expected * (1.5 if light.on_metal else 1.25)])
    # of sheet of 0.1 mm, the wall is a fiftieth of a pixel wide
    sheet = Solid(PLATE.vertices * [1, 1, 0.01], PLATE.faces, name="sheet")
    for light in (UNDER, metal):
        shown = entity_shown(light, Sight.of(sheet, CAMERA), rim, eye_beside(0.0))
        assert np.ravel(shown).tolist() == [1, 1]
    upper = rim_at(HEIGHT).edge_ids
    shown = entity_shown(metal, Sight.of(sheet, CAMERA), upper, eye_beside(0.0))
    assert np.ravel(shown).tolist() == [0, 0]


def test_the_upper_rim_shows_on_metal_where_the_wall_is_bright():
    """The top is dark. Next to its rim is the wall, or the rectangle itself where an oblique camera sees no wall."""
    metal = replace(UNDER, material=Material("metal"))
    rim = rim_at(HEIGHT).edge_ids
    for offset in (0.0, 150.0):
        contrast, step = entity_shown(metal.held(np.eye(4)), FINE, rim, eye_beside(offset))
        assert contrast[0] == pytest.approx(1, abs=0.05)
        # GGX of roughness 0.3 at a grazing angle
        assert 0.3 < step[0] < 0.9
    narrow, _ = entity_shown(metal.held(np.eye(4)), SIGHT, rim, eye_beside(0.0))
    assert narrow == [0]


def test_the_smoother_metal_is_the_brighter_is_the_wall():
    """A mirror shows the rectangle in the wall, with the reflectance of metal; rough metal scatters it elsewhere."""
    rim = rim_at(HEIGHT).edge_ids
    steps = []
    for roughness in (0.02, 0.3, 1.0):
        metal = replace(UNDER, material=Material("metal", roughness)).held(np.eye(4))
        steps.append(entity_shown(metal, FINE, rim, eye_beside(0.0))[1][0])
    assert steps[0] == pytest.approx(1.0, abs=0.15)
    assert steps[0] > 1.3 * steps[1]
    assert steps[1] > 1.3 * steps[2]


def test_an_outline_shows_as_far_as_the_rectangle_reaches_beside_it():
    """The upper back edge: seen from above the plate's middle, the ray beside it meets the plane just outside."""
    (edge,) = (
        edge
        for edge in PLATE.straight_edges()
        if np.allclose(sorted(PLATE.edge_points(edge.id).tolist()), BACK)
    )
    low = [[0, SIZE[1], 0], (*SIZE, 0)]
    (lower,) = (
        edge
        for edge in PLATE.straight_edges()
        if np.allclose(sorted(PLATE.edge_points(edge.id).tolist()), low)
    )
    above = np.array([[40.0, 25.0, DISTANCE]])
    assert entity_shown(UNDER, SIGHT, [edge.id], above)[0] == [1]
    # the lower edge is behind the plate there, and the outline for a camera that sees the back
    assert entity_shown(UNDER, SIGHT, [lower.id], above)[0] == [0]
    behind = np.array([[40.0, 150.0, DISTANCE]])
    assert entity_shown(UNDER, SIGHT, [edge.id], behind)[0] == [0]
    assert entity_shown(UNDER, SIGHT, [lower.id], behind)[0] == pytest.approx([0.6])
    # a metal wall is nearly as bright as the rectangle: exactly, it hardly shows
    metal = replace(UNDER, material=Material("metal")).held(np.eye(4))
    assert 0 < entity_shown(metal, SIGHT, [lower.id], behind)[0] < 0.3
    # the ray three pixels beside the upper edge meets the plane at y = 25 + (25 + 3 px) d / (d - h) = 51.25 mm
    pixel = SIGHT.pixel_rad * (DISTANCE - HEIGHT)
    reach = (25 + 3 * pixel) * DISTANCE / (DISTANCE - HEIGHT) - 25
    for beyond, shows in ((reach + 0.1, 1), (reach - 0.1, 0)):
        narrow = Backlight.horizontal((40, 25, 0), 200, 50 + 2 * beyond)
        assert entity_shown(narrow, SIGHT, [edge.id], above)[0] == [shows]


def test_nothing_shows_from_behind_or_off_the_rectangle():
    edges = EdgePoints.of(PLATE, rim_at(0.0).edge_ids)
    below = np.array([[*CENTRE, -300.0]])
    assert not UNDER.contrasts(SIGHT, edges, below)[0].any()
    beside = Backlight.horizontal((CENTRE[0] + 50, CENTRE[1], 0), 60, 60)
    assert not beside.contrasts(SIGHT, edges, eye_beside(0.0))[0].any()


def test_plate_light_and_camera_turned_together_show_the_same():
    turn = Rotation.from_euler("xyz", [1.0, 0.4, 2.0]).as_matrix()
    turned = Solid(PLATE.vertices @ turn.T, PLATE.faces, name="turned")
    light = Backlight(*(turn @ x for x in (UNDER.centre, UNDER.half_width, UNDER.half_height)))
    edge_ids = [edge.id for edge in PLATE.edges]
    eyes = np.array([[20.0, 25, 300], [90, 10, 250], [40, 25, 400], [-60, 100, 90]])
    shown = UNDER.contrasts(SIGHT, EdgePoints.of(PLATE, edge_ids), eyes)[0]
    again = light.contrasts(
        Sight.of(turned, CAMERA), EdgePoints.of(turned, edge_ids), eyes @ turn.T
    )[0]
    assert 0.1 < shown.mean() < 0.6
    assert (shown == again).mean() > 0.99


def test_it_lies_under_the_part_and_reaches_beyond_it_by_its_height():
    assert Backlight.horizontal((40, 25, 0), 80 + 2 * (10 + 10), 50 + 2 * (10 + 10)) == UNDER
    assert str(UNDER) == "a backlight of 120 x 90 mm at (40, 25, 0) mm"
    assert UNDER.normal.tolist() == [0, 0, 1]


def test_files_hold_it():
    leaning = Backlight((1, 2, 3), (0, 30, 0), (0, 0, 20), "mine")
    assert from_plain(Backlight, to_plain(leaning, defaults=True), RequestError) == leaning
    lighting = Lighting(leaning)
    assert lighting.area == leaning
    assert pickle.loads(pickle.dumps(lighting)).area == leaning


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (
            lambda: Backlight((0, 0, np.nan), (1, 0, 0), (0, 1, 0)),
            r"centre must be three finite numbers in mm\. Got \(0, 0, nan\)\.",
        ),
        (
            lambda: Backlight((0, 0, 0), (1, 0, 0), (1, 1, 0)),
            r"half_width must be at right angles to half_height\. Got 45 degrees\.",
        ),
        (
            lambda: Backlight((0, 0, 0), (0, 0, 0), (1, 1, 0)),
            r"half_width and half_height must have a length\. Got 0 mm\.",
        ),
        (
            lambda: Backlight.horizontal((0, 0, 0), -5, 10),
            r"width_mm must be positive\. Got -5\.",
        ),
        (
            lambda: Lighting(Backlight.horizontal((40, 25, 5), 200, 200)).check_part(PLATE),
            r"lamps must be outside the part\. Got a backlight of 200 x 200 mm at \(40, 25, 5\) mm, inside it\.",
        ),
        (
            lambda: Lighting(Backlight.horizontal((40, 25, 5), 4, 4)).check_part(PLATE),
            r"lamps must be outside the part\. Got a backlight of 4 x 4 mm",
        ),
        (
            lambda: Lighting(Backlight.horizontal((40, 25, 20), 200, 200)).check_part(PLATE),
            r"lamps must shine at the part\. Got a backlight .*, which shines away from it\.",
        ),
        (
            lambda: Lighting(UNDER, together=True),
            r"together must be False for a light that has an area, which is one lamp\. Got True\.",
        ),
    ],
)
def test_bad_input_is_refused_in_one_line(wrong, message):
    with pytest.raises(RequestError, match=f"^{message}"):
        wrong()


@pytest.mark.parametrize(
    ("text", "lamps"),
    [
        ("backlight", "backlight"),
        ("backlight:40,25,0,120,90", UNDER),
    ],
)
def test_the_command_line_takes_it(text, lamps):
    assert read_lighting(Light(light=text)).lamps == lamps


@pytest.mark.parametrize("text", ["backlight:1,2,3", "backlight:1,2,3,4,x", "backlight:"])
def test_the_command_line_refuses_other_numbers(text):
    with pytest.raises(RequestError, match=r"^--light "):
        read_lighting(Light(light=text))


# Plans.

# so thick that walls are at least three pixels wide, from above the middles of the bores
THICK = thick_plate()


def dimensions():
    return {
        name: Dimension("diameter", (rim_at(0.0, name, THICK).id,), tolerance=(-0.3, 0.3))
        for name in HOLES
    }


@pytest.fixture(scope="module")
def lit():
    return plan_inspection(
        THICK,
        dimensions(),
        COARSE,
        UNCERTAINTY,
        lamps="backlight",
        effort=QUICK,
        registration=Registration.own_edges(0.02),
    )


def test_a_plan_measures_bores_through_which_its_light_shows(lit):
    assert lit.light.kind == "backlight"
    assert lit.light.area == Backlight.under(THICK)
    assert len(lit.light.lamps) == lit.light.lower_bound == 0
    assert lit.light.complete
    assert not lit.uninspectable
    measured = set()
    for seen, (image,) in zip(lit.settings, lit.light.images, strict=True):
        assert image.lamps == ()
        assert list(image.contrast.values()) == pytest.approx([0.6] * len(image.contrast))
        assert image.silhouettes == tuple(image.contrast)
        for name in seen.entities:
            # all of a lower rim is seen by cameras above the bore alone
            centre, radius = HOLES[name]
            assert np.hypot(*(seen.position[:2] - centre)) < radius
            measured.add(name)
    assert measured == {"left", "right"}


def test_its_file_holds_the_light(lit, tmp_path):
    lit.write(tmp_path / "plan.json")
    again = read_plan(tmp_path / "plan.json")
    assert again.light == lit.light
    assert again.request.lighting.area == Backlight.under(THICK)


def test_its_images_are_measured(lit):
    rehearsal = Rehearsal(lit, THICK, surfaces_mm=0.02, seed=4)
    images = list(rehearsal.images())
    for image in images:
        # dark part, bright rectangle
        assert np.quantile(image.grey, 0.02) < 20
        assert 190 < np.quantile(image.grey, 0.98) < 220
    greys = {image.shot.setting + 1: image.grey for image in images}
    truth = {
        name: value for values in rehearsal.truth.values.values() for name, value in values.items()
    }
    results = list(measure(lit, THICK, greys))
    assert {result.name for result in results} == set(HOLES)
    for result in results:
        assert result.measured, result.reason
        assert abs(result.value - truth[result.name]) <= 3 * result.standard_uncertainty


def test_plan_light_says_what_a_backlight_does_not_show(lit):
    small = Backlight.horizontal((CENTRE[0], CENTRE[1], 0), 10, 10)
    light = plan_light(lit, THICK, small)
    assert not any(light.images)
    for unlit, seen in zip(light.unlit, lit.settings, strict=True):
        assert unlit == dict.fromkeys(seen.entities, f"it {small.reason}.")


def test_the_space_is_in_front_and_passes_to_other_processes():
    names = {"rim": rim_at(0.0).id}
    fine = replace(CAMERA, pixel_pitch_mm=(2e-4, 2e-4))
    regions = compute_regions(PLATE, names, ((-200, -200, -300), (300, 300, 400)))
    space = pickle.loads(pickle.dumps(AreaSpace(regions, fine, UNDER, (0.1, 0.1))))
    eyes = np.vstack([eye_beside(0.0), eye_beside(40.0), [[*CENTRE, -200.0]]])
    assert regions.observable(eyes)[:, 0].tolist()[::2] == [True, True]
    assert space.observable(eyes)[:, 0].tolist() == [True, False, False]
    assert regions.covering_cells(["rim"]).contains(eyes).tolist()[::2] == [True, True]
    assert space.covering_cells(["rim"]).contains(eyes).tolist()[::2] == [True, False]


class Below(SimpleNamespace):
    """Viewpoints below the plate only."""

    def subset(self, names):
        return self

    def covering_cells(self, names):
        return self.regions.covering_cells(names).in_front_of(np.zeros(3), np.array([0, 0, -1.0]))


def test_what_is_seen_only_from_behind_is_said_to_be_so():
    names = {"rim": rim_at(0.0).id}
    regions = compute_regions(PLATE, names, ((-200, -200, -300), (300, 300, 400)))
    below = Below(regions=regions)
    assert len(check_observable(below, ["rim"]))
    with pytest.raises(InfeasibleError, match="in front of the backlight sees all of entity 'rim'"):
        check_observable(AreaSpace(below, CAMERA, UNDER, (0.1, 0.1)), ["rim"])


@pytest.mark.parametrize("material", [Material(), Material("metal", 0.3)])
def test_a_plan_says_that_its_camera_is_behind_the_backlight(material):
    """The backlight shines upwards; the camera looks up from 200 mm below it."""
    rim = rim_at(0.0)
    made = plan_inspection(PLATE, {"rim": rim.id}, CAMERA, UNCERTAINTY, effort=QUICK)
    (setting,) = made.settings
    below = np.eye(4)
    below[:3, 3] = [*CENTRE, -200.0]
    turned = replace(made, settings=(replace(setting, cam2world=below),))
    backlight = replace(Backlight.horizontal((*CENTRE, 0.0), 300, 300), material=material)
    light = plan_light(turned, PLATE, backlight)
    (reason,) = light.unlit[0].values()
    assert reason == (
        "the camera is behind the backlight, which shines away from it (200 mm behind)."
    )


def test_what_is_in_view_but_not_its_outline_is_said_to_be_not_shown():
    """From near above, the lower rim bounds the light in a bore, so that the upper one is no outline."""
    upper = {"upper": Dimension.diameter(rim_at(HEIGHT).id, tolerance_mm=(-0.5, 0.5))}
    made = plan_inspection(PLATE, upper, CAMERA, UNCERTAINTY, effort=QUICK, lamps=UNDER)
    reason = made.uninspectable["upper"]
    assert reason.kind is ReasonKind.NOT_SHOWN
    assert reason.startswith("not readable in the light: poses see it, but under")
    assert str(UNDER) in reason
    assert re.search(
        r"it is not the outline of the part in front of the backlight, with [^,]+\.$", reason
    )
    # the same without light is inspected
    assert not plan_inspection(PLATE, upper, CAMERA, UNCERTAINTY, effort=QUICK).uninspectable
