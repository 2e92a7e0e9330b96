"""When a registration is believed: by how much is found, and by what a lamp makes of it."""

import re

import numpy as np
import pytest
import shapely
from measured_plate import (
    CAMERA,
    LAMP,
    POSES,
    UNCERTAINTY,
    fine_plate,
    measured_plan,
    photograph,
    thick_plate,
)

from errors.measurands import Circle
from planner import MeasureOptions, Measurer, Registration
from planner.measuring import register as registering
from planner.measuring import verdict as shadows
from planner.measuring.images import Picture
from planner.measuring.registered import Lamp, fitted, prior_covariance
from planner.measuring.samples import PartModel, State
from planner.measuring.task import ImageScan, Scan, registration_task
from planner.measuring.verdict import Attempt, Shown

LAMP_VERDICT = Lamp(np.zeros(3), 0.0, 1.0, 0.8, 0.1, 0.0)


@pytest.fixture(scope="module")
def task():
    model = PartModel(thick_plate(), {})
    prior = prior_covariance(model, UNCERTAINTY.covariance, 0.02, CAMERA)
    return registration_task(model, CAMERA, POSES[0], prior, 0.15)


def attempt_of(task, found, light=None, left_out=None, lead=1.0):
    """An attempt in one image that finds some samples (m,), right where they are."""
    count = len(task.samples.edge)
    nothing = np.zeros(count)
    one = ImageScan(nothing, found, np.where(found, 0, 1), nothing)
    x = np.zeros(len(task.prior))
    scan = Scan(x, *task.predicted(x), [one])
    out = np.zeros(count, dtype=bool) if left_out is None else left_out
    attempt = Attempt(task, [], scan, scan.centres, [], [out], lead, None)
    if light is not None:
        attempt.__dict__["light"] = [light]
    return attempt


def first(task, share):
    count = len(task.samples.edge)
    return np.arange(count) < share * count


def test_what_a_lamp_contradicts_is_not_found(task):
    """A stretch with another step than the lamp makes is a shadow: it speaks neither for the pose nor against it."""
    every = first(task, 1.0)
    shadow = task.stretch == np.bincount(task.stretch).argmax()
    light = Shown(LAMP_VERDICT, every, every, ~shadow, shadow)
    assert attempt_of(task, every, light).share == pytest.approx(1 - shadow.mean())
    out = attempt_of(task, ~shadow, Shown(LAMP_VERDICT, ~shadow, every, ~shadow, ~every), shadow)
    assert out.share == 1.0


@pytest.mark.parametrize(
    ("share", "lit", "convincing"),
    [(0.5, 0.5, True), (0.5, 0.8, False), (0.32, 0.32, True), (0.25, 0.25, False)],
)
def test_less_is_enough_if_the_rest_lies_in_the_dark(task, share, lit, convincing):
    """Where the lamp shows more than was found, the pose may be another one; too little convinces never."""
    found = first(task, share)
    light = Shown(LAMP_VERDICT, found, first(task, lit), found, first(task, 0.0))
    assert attempt_of(task, found, light).convincing == convincing


@pytest.mark.parametrize(
    ("share", "lead", "convincing"), [(0.65, 1.2, True), (0.65, 1.0, False), (0.75, 1.0, True)]
)
def test_another_shift_that_fits_as_well_asks_for_more(task, share, lead, convincing):
    """No lamp explains these: what was found has other steps than any makes."""
    found = first(task, share)
    light = Shown(LAMP_VERDICT, found, first(task, 1.0), first(task, 0.3), first(task, 0.0))
    assert attempt_of(task, found, light, lead=lead).convincing == convincing


def test_edges_disagree_of_which_more_than_a_tenth_is_found_somewhere_else(task):
    every = first(task, 1.0)
    attempt = attempt_of(task, every)
    counts = np.bincount(task.samples.edge)
    off, nearly = np.argsort(counts)[-2:]
    offset = attempt.scan.scans[0].offset
    offset[np.flatnonzero(task.samples.edge == off)[: counts[off] // 5]] = 1.0
    offset[np.flatnonzero(task.samples.edge == nearly)[: counts[nearly] // 20]] = 1.0
    assert (attempt.disagreeing[0] == (task.samples.edge == off)).all()


def test_a_pose_that_a_shadow_turned_is_searched_without_its_edge(monkeypatch, picture):
    """A first result that is 9 standard deviations off, and an edge of which a fifth was found somewhere else."""
    model = PartModel(thick_plate(), {})
    prior = prior_covariance(model, UNCERTAINTY.covariance, 0.02, CAMERA)
    best = registering._best
    turned = []

    def turn(task, pictures, start):
        attempt, lamps = best(task, pictures, start)
        attempt.scan.x[3] = 9 * np.sqrt(prior[3, 3])
        edge = np.bincount(task.samples.edge).argmax()
        on_it = np.flatnonzero(task.samples.edge == edge)
        attempt.scan.scans[0].offset[on_it[: len(on_it) // 5]] += 2.0
        attempt.__dict__.pop("agreeing", None)
        turned.append(attempt)
        return attempt, lamps

    monkeypatch.setattr(registering, "_best", turn)
    registered = registering.register(model, [picture], POSES[0], prior)
    assert not turned[0].accepted
    assert turned[0].disagreeing[0].any()
    assert registered.chi2 < 30
    assert registered.misfit_px < 0.1


# The lamp that explains an image: found where it was, and refuted by edges that it shows and that
# are not there.


# the renderer's, see `part_images`: of a lamp at right angles, and everywhere
GAIN = 0.78
AMBIENT = 0.12
AT_LAMP = Lamp(LAMP.place, 0.0, 1.0, GAIN, AMBIENT, 0.0, 0.04)


def sampled(task):
    return shadows.Sampled(task.model.edges.scene, CAMERA, POSES[0], task.edges, task.samples)


@pytest.fixture(scope="module")
def where(task):
    return task.predicted(np.zeros(len(task.prior)))


@pytest.fixture(scope="module")
def picture():
    return Picture.of("one", photograph(fine_plate(), POSES[:1])[1], CAMERA)


@pytest.fixture(scope="module")
def agree(picture, where):
    return picture.find(*where, 3.0).state == State.FOUND


def test_a_lamp_is_found_where_it_was(task, where, picture, agree):
    faces, on_part = sampled(task).beside(where[1], shadows.BESIDE_PX)
    known = on_part & agree
    grey = shadows._grey(picture, *where, shadows.BESIDE_PX)
    found = fitted(faces.chosen(known), grey[known])
    ways = [place - faces.middle for place in (LAMP.place, found.place)]
    cosine = ways[0] @ ways[1] / np.prod([np.linalg.norm(way) for way in ways])
    assert np.degrees(np.arccos(cosine)) < 10
    shaded = faces.chosen(known).shaded(found)
    true, _ = faces.chosen(known).light(LAMP.place)
    assert np.quantile(np.abs(shaded - GAIN * true - AMBIENT), 0.9) < 0.02


def test_faces_beside_round_edges_are_those_of_the_real_part(task, where):
    """The mesh has chords: above the upper rims, the face beside them is the top; no ray may meet a wall instead."""
    faces, on_part = sampled(task).beside(where[1], shadows.BESIDE_PX)
    for k, edge in enumerate(task.edges):
        if isinstance(edge.geometry, Circle) and edge.geometry.centre[2] > 39:
            own = task.own[k]
            level = np.abs(faces.normals[:, own, 2]) > 0.99
            high = level & (np.abs(faces.points[:, own, 2] - 40) < 0.1) & on_part[:, own]
            assert np.all(high.sum(axis=0) == 1)


def test_a_lamp_explains_what_is_found(task, where, picture, agree):
    assert shadows.shown(task, POSES[0], picture, where, agree).explains


@pytest.mark.parametrize("lost", [0.4, 0.6])
def test_what_a_lamp_shows_must_be_found(task, where, picture, agree, lost):
    """Some edges are not found although the light shows them: so it is at a pose that is off by a pitch."""
    rng = np.random.default_rng(3)
    order = rng.permutation(len(task.edges))
    missing = agree.copy()
    for k in order:
        if missing.sum() > (1 - lost) * agree.sum():
            missing[task.own[k]] = False
    assert not shadows.shown(task, POSES[0], picture, where, missing).explains


def test_no_lamp_explains_half_a_negative(task, where, picture, agree):
    """All edges are where they should be, and the same face is bright on the one half and dark on the other."""
    grey = picture.grey.astype(np.uint8)
    middle = grey.shape[1] // 2
    grey[:, middle:] = 255 - grey[:, middle:]
    half = Picture.of("one", grey, CAMERA)
    assert not shadows.shown(task, POSES[0], half, where, agree).explains


@pytest.fixture
def shadow(task, agree, monkeypatch):
    """Number of an edge of which the step is turned round, as that of a shadow that ends beside it."""
    lines = [k for k, edge in enumerate(task.edges) if edge.chord_mm == 0]
    k = max(lines, key=lambda k: agree[task.own[k]].sum())
    real = shadows._grey

    def swapped(*given):
        grey = real(*given)
        grey[:, task.own[k]] = grey[::-1, task.own[k]]
        return grey

    monkeypatch.setattr(shadows, "_grey", swapped)
    return k


def test_what_a_lamp_shows_contradicts_nothing(task, where, picture, agree):
    light = shadows.shown(task, POSES[0], picture, where, agree)
    assert not light.contradicted(task.stretch).any()


def test_a_shadow_beside_an_edge_is_no_edge(task, where, picture, agree, shadow):
    light = shadows.shown(task, POSES[0], picture, where, agree)
    np.testing.assert_array_equal(light.contradicted(task.stretch), task.samples.edge == shadow)


@pytest.mark.parametrize(("others", "fits"), [(0.25, True), (0.39, True), (0.41, False)])
def test_one_long_shadow_does_not_hide_that_the_lamp_fits(others, fits):
    """A shadow along a long edge of D2MI had a quarter of all samples; where two fifths differ, no lamp fits."""
    stretch = (np.arange(1000) < 1000 * others).astype(np.int64)
    every = np.ones(1000, dtype=bool)
    light = shadows.Shown(AT_LAMP, every, every, stretch == 0, stretch == 1)
    np.testing.assert_array_equal(light.contradicted(stretch), (stretch == 1) & fits)


@pytest.mark.parametrize(
    ("alike", "shown", "dark", "surely"),
    [
        (1.0, 1.0, 0.0, True),
        (0.93, 1.0, 0.0, False),
        (1.0, 0.75, 0.0, False),
        (1.0, 1.0, 0.15, False),
    ],
)
def test_a_part_in_the_dark_is_there_if_all_that_shows_is_found(alike, shown, dark, surely):
    """Half of the samples lie in the dark. Images from wrong poses have fewer steps alike, and some in the dark."""
    lit = np.arange(2000) < 1000
    agree = np.where(lit, np.arange(2000) < 1000 * shown, np.arange(2000) < 1000 + 1000 * dark)
    same = agree & (np.cumsum(agree) <= alike * agree.sum())
    light = shadows.Shown(AT_LAMP, agree, lit, same, np.zeros(2000, dtype=bool))
    assert light.surely == surely
    assert light.explains


def test_a_shadow_says_nothing_of_the_pose(task, picture, shadow):
    """Its edge is left out, and the others give the pose that the image was taken from."""
    found = registering.register(task.model, [picture], POSES[0], task.prior)
    own = found.samples["edge"] == shadow
    assert own.any()
    assert not np.any(found.samples["state"][own] == State.FOUND)
    assert np.mean(found.samples["state"][~own] == State.FOUND) > 0.9
    step = np.linalg.inv(POSES[0]) @ found.cam2world
    turn = np.array([step[2, 1], step[0, 2], step[1, 0]])
    off = np.concatenate([step[:3, 3], turn])
    # six degrees of freedom: 1 in 10,000 beyond
    assert off @ np.linalg.solve(found.covariance[:6, :6], off) < 27.9


def test_few_found_samples_say_nothing_of_the_light(task, where, picture, agree):
    few = agree & (np.cumsum(agree) <= 100)
    assert shadows.shown(task, POSES[0], picture, where, few) is None


def test_a_wall_may_be_brighter_and_darker_than_the_face_around_it(task, where):
    """Light from one side: the left half of a bore is darker than the face, the right half brighter."""
    centres, across = where
    rims = [k for k, edge in enumerate(task.edges) if isinstance(edge.geometry, Circle)]
    k = max(rims, key=lambda k: task.edges[k].geometry.centre[2])
    own = task.own[k]
    width, height = CAMERA.resolution
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    inside = shapely.contains_xy(shapely.Polygon(centres[own]), u, v)
    middle = centres[own].mean(axis=0)
    right = u > middle[0]
    grey = np.full((height, width), 120, np.uint8)
    grey[inside & right] = 200
    grey[inside & ~right] = 60
    picture = Picture.of("bore", grey, CAMERA)
    signs = registering.signs_of(picture, centres, across, 3.0, task.stretch)[own]
    inward = np.sign(((middle - centres[own]) * across[own]).sum(axis=1))
    off = centres[own, 0] - middle[0]
    # a stretch of 30 degrees has one sign, so those next to the change have either
    clear = np.abs(off) > 0.6 * np.abs(off).max()
    assert clear.sum() > 20
    np.testing.assert_array_equal((signs * inward)[clear], np.sign(off)[clear])


@pytest.fixture
def shaded_rim(monkeypatch):
    """Make the steps of points from 60 to 150 degrees of a rim those of a shadow: both sides are exchanged."""
    real = shadows._grey

    def swapped(picture, edges, across, beside_px):
        grey = real(picture, edges, across, beside_px)
        if len(edges) < 200:
            angle = 360 * np.arange(len(edges)) / len(edges)
            grey[:, (angle >= 60) & (angle < 150)] *= -1
        return grey

    monkeypatch.setattr(shadows, "_grey", swapped)


def test_a_shadow_beside_a_rim_is_not_measured(picture, shaded_rim):
    """Of a rim, three of twelve stretches are found with another step, so less of it is found than must be."""
    solid = thick_plate()
    plan = measured_plan(solid, ["left"])
    setting = {1: picture.grey.astype(np.uint8)}
    options = MeasureOptions(Registration.own_edges(0.02))
    results = Measurer(plan, solid).measure(setting, options, partial=True)
    (reading,) = results["left"].readings
    states = reading.points[0]["state"]
    stretch = (reading.points[0]["share"] * 12).astype(int)
    beside = (stretch >= 2) & (stretch < 5)
    assert np.all(states[beside] != State.FOUND)
    assert np.mean(states[beside] == State.SHADOW) > 0.9
    assert not np.any(states[~beside] == State.SHADOW)
    assert re.match(
        r"only 6\d % of rim r\d+ was found; 2[45] % is next to a shadow$", reading.reason
    )
