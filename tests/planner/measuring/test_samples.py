"""Which edges and surfaces of a part a target is about."""

import dataclasses

import numpy as np
import pytest
from measured_plate import measured_plan, thick_plate
from plan_examples import witness
from solids import prism

from aspectgraph import Solid
from errors.measurands import Circle, Line
from planner import Backlight, Camera, RequestError, look_at
from planner.measuring.samples import PartEdges, PartModel, _holds, median_shift, pixels_of

CAMERA = Camera.named("basler-acA2440-20gm-8mm")


class HalfCircle:
    """An arc from 90 to 270 degrees about z."""

    axis = np.array([0.0, 0.0, 1.0])
    reference = np.array([1.0, 0.0, 0.0])
    start_rad = np.pi / 2
    end_rad = 3 * np.pi / 2


@pytest.mark.parametrize(
    ("start", "span", "held"),
    [
        ([0.0, 1.0, 0.0], np.pi, True),
        ([-1.0, 0.0, 0.0], 1.0, True),
        ([0.0, -1.0, 0.0], np.pi, False),
        ([0.0, 1.0, 0.0], 4.0, False),
    ],
    ids=["the same", "a part of it", "the other half", "more"],
)
def test_one_circle_may_carry_several_arcs(start, span, held):
    geometry = Circle([5.0, 5, 0], [0, 0, 1], 2.0, np.array(start), span)
    assert _holds(HalfCircle(), geometry) is held


def test_surfaces_that_a_target_measures_are_free():
    solid = thick_plate()
    model = PartModel(solid, measured_plan(solid, ["left", "width"]).targets)
    free = [model.carriers.surfaces[k] for k in model.free]
    (cylinder,) = [one for one in free if not one.is_plane]
    assert cylinder.radius_mm == pytest.approx(8.0)
    normals = {tuple(one.axis.round(9).tolist()) for one in free if one.is_plane}
    # the faces in front and at the back, and not the top
    assert normals == {(0.0, -1.0, 0.0), (0.0, 1.0, 0.0)}


def test_facets_of_a_hole_are_no_edges():
    solid = thick_plate()
    model = PartModel(solid, measured_plan(solid).targets)
    kinds = [edge.name[0] for edge in model.edges.edges]
    assert (kinds.count("e"), kinds.count("r")) == (12, 4)


def test_a_part_without_the_rim_is_refused():
    solid = thick_plate()
    plan = measured_plan(solid, ["left"])
    other = thick_plate({"left": ((20.0, 25.0), 7.0), "right": ((60.0, 25.0), 6.0)})
    with pytest.raises(RequestError, match="Got one without the rim or arc of 'left'"):
        PartModel(other, plan.targets)


def test_a_target_may_be_on_a_part_of_an_edge():
    """Plans measure on the part of an edge that is seen: it lies on the edge, and is not its whole."""
    solid = thick_plate()
    target = measured_plan(solid, ["width"]).targets["width"]
    first, second = target.geometry
    part = Line(first.p + 0.25 * (first.q - first.p), first.middle)

    def along(first):
        ways = (witness("distance", target.entities, (first, second)),)
        return {"width": dataclasses.replace(target, witnesses=ways)}

    model = PartModel(solid, along(part))
    found, _ = model.measured["width"]
    whole, _ = PartModel(solid, {"width": target}).measured["width"]
    assert found.edge_ids == whole.edge_ids
    assert found.geometry is part
    down = np.array([0.0, 0.0, -1.0])
    beside = Line(part.p + down, part.q + down)
    with pytest.raises(RequestError, match="must be the one that was planned"):
        PartModel(solid, along(beside))


RADIUS_MM = 12.0
HEIGHT_MM = 10.0


@pytest.fixture(scope="module")
def round_ended():
    """A bar along x whose right end is half a cylinder about x = 30 mm."""
    angles = np.pi * (np.arange(61) / 60 - 0.5)
    arc = [(30 + RADIUS_MM * np.cos(a), RADIUS_MM * np.sin(a)) for a in angles]
    return prism([(0, -RADIUS_MM), *arc, (0, RADIUS_MM)], HEIGHT_MM)


@pytest.mark.parametrize(
    ("eye", "n_lines"), [((250, 3, 160), 2), ((250, 40, 160), 1), ((25, 2, 300), 0)]
)
def test_contours_are_where_a_round_wall_turns_away(round_ended, eye, n_lines):
    """From an eye at distance d of the axis, in direction b: at the angles b ± arccos(r / d)."""
    pose = look_at([eye], [25.0, 0, 0])[0]
    pixels = PartEdges(round_ended).contours(pose, CAMERA)
    away = np.array(eye[:2]) - (30, 0)
    turn = np.arccos(min(RADIUS_MM / np.linalg.norm(away), 1.0))
    angles = np.arctan2(away[1], away[0]) + np.array([-turn, turn])
    angles = angles[np.cos(angles) > 0]
    assert len(angles) == n_lines
    lines = [
        [(30 + RADIUS_MM * np.cos(a), RADIUS_MM * np.sin(a), z) for z in (0, HEIGHT_MM)]
        for a in angles
    ]
    assert bool(len(pixels)) == bool(lines)
    nearest = np.full(len(pixels), np.inf)
    for line in lines:
        first, last = pixels_of(np.array(line, dtype=float), pose, CAMERA)
        along = (last - first) / np.linalg.norm(last - first)
        off = np.abs((pixels - first) @ [-along[1], along[0]])
        # both ends are there
        for end in (first, last):
            assert np.linalg.norm(pixels - end, axis=1).min() < 8
        nearest = np.minimum(nearest, off)
    # a facet's edge leaves the cylinder's contour by less than the sagitta of a chord, 0.004 mm
    assert (nearest < 0.2).all()


def test_an_arc_is_not_alone_where_the_contour_of_its_wall_touches_it(round_ended):
    pose = look_at([(250, 40, 160)], [25.0, 0, 0])[0]
    edges = PartEdges(round_ended)
    upper = next(
        edge
        for edge in edges.edges
        if isinstance(edge.geometry, Circle) and edge.geometry.centre[2] == HEIGHT_MM
    )
    samples = edges.samples(pose, CAMERA, [upper], 0.0)
    pixels = pixels_of(samples.points, pose, CAMERA)
    apart = edges.shown(pose, CAMERA).apart([upper], samples.edge, pixels)
    angle = np.arctan2(samples.points[:, 1], samples.points[:, 0] - 30)
    away = np.array([220.0, 40.0])
    touching = np.arctan2(40, 220) + np.arccos(RADIUS_MM / np.linalg.norm(away)) * np.array([-1, 1])
    px_per_mm = np.linalg.norm(pixels[1] - pixels[0]) / np.linalg.norm(
        np.diff(samples.points[:2], axis=0)
    )
    distance = RADIUS_MM * px_per_mm * np.abs(angle[:, None] - touching).min(axis=1)
    assert not apart[distance < 4].any()
    assert (distance < 4).sum() >= 2
    # a contour leaves an arc of radius R px by s² / (2 R) after s px
    assert apart[distance > 2 * np.sqrt(2 * 5 * RADIUS_MM * px_per_mm)].all()


def test_what_left_the_field_of_the_lens_does_not_count_as_moved():
    before = np.array([[0.0, 0], [1, 1], [2, 2], [9, 9]])
    after = before + np.array([[3.0, 4], [3, 4], [6, 8], [np.nan, np.nan]])
    assert median_shift(before, after) == 5.0


def test_an_edge_that_is_hidden_is_looked_at_under_no_light():
    """The lower edges of a plate, from above: nothing of them is left that a light with an area may show."""
    solid = thick_plate()
    edges = PartEdges(solid, Backlight.under(solid))
    lines = [edge for edge in edges.edges if isinstance(edge.geometry, Line)]
    lower = [edge for edge in lines if edge.geometry.middle[2] == 0]
    pose = look_at([[40.0, 25.0, 400.0]], [40.0, 25.0, 0.0])[0]
    for edge in lower:
        samples = edges.samples(pose, CAMERA, [edge], 4.0)
        assert len(samples.share) > 0
        assert not samples.visible.any()
    assert len(lower) == 4


@pytest.mark.parametrize("seed", range(4))
def test_rims_of_a_bore_share_its_wall_however_faces_are_numbered(seed):
    """Facets of the wall may come before and after the face that they end at, as in files of some programs."""
    plate = thick_plate()
    order = np.random.default_rng(seed).permutation(len(plate.faces))
    solid = Solid(plate.vertices, [plate.faces[k] for k in order], name="plate")
    model = PartModel(solid, {})
    rims = [edge for edge in model.edges.edges if isinstance(edge.geometry, Circle)]
    assert len(rims) == 4
    walls = {}
    for rim in rims:
        level, wall = model.carried_by[rim.name]
        assert model.carriers.surfaces[level].is_plane
        assert model.carriers.surfaces[wall].lean == 0
        walls.setdefault(tuple(rim.geometry.centre[:2].round(6)), set()).add(wall)
        # of the two faces of each chord, the level one comes first
        assert np.allclose(np.abs(rim.normals[:, 0] @ rim.geometry.axis), 1)
    assert sorted(map(len, walls.values())) == [1, 1]


def frustum(lower, upper):
    """A frustum of 10 and 6 mm radius and 5 mm height, whose rims have so many chords."""
    rings = []
    for count, radius, height in ((lower, 10.0, 0.0), (upper, 6.0, 5.0)):
        angle = 2 * np.pi * np.arange(count) / count
        rings.append(np.c_[radius * np.cos(angle), radius * np.sin(angle), np.full(count, height)])
    faces = [list(range(lower))[::-1], list(range(lower, lower + upper))]
    low = 0
    high = 0
    while low < lower or high < upper:
        corners = [low % lower, lower + high % upper]
        if high == upper or (low < lower and (low + 1) / lower <= (high + 1) / upper):
            low += 1
            faces.append([corners[0], low % lower, corners[1]])
        else:
            high += 1
            faces.append([corners[0], lower + high % upper, corners[1]])
    return Solid(np.concatenate(rings), faces, name="frustum")


@pytest.mark.parametrize("counts", [(72, 72), (48, 96)])
def test_both_rims_of_a_cone_are_on_it(counts):
    """Facets lean less than the cone where the rims have other numbers of chords. Its circles tell how it leans."""
    model = PartModel(frustum(*counts), {})
    pairs = [model.carried_by[edge.name] for edge in model.edges.edges]
    assert len(pairs) == 2
    ((_, cone), (_, other)) = pairs
    assert cone == other
    assert model.carriers.surfaces[cone].lean == pytest.approx(-4 / np.hypot(4, 5), abs=1e-9)
    assert len(model.carriers.surfaces) == 3
