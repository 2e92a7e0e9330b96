"""Brightness of places under lights of some extent, against closed forms."""

import math

import numpy as np
import pytest
from lit_parts import block, bore

from aspectgraph.solid.solid import RayScene
from planner.exceptions import RequestError
from planner.light.reflection import (
    Annulus,
    Cap,
    Material,
    Places,
    Rectangle,
    Window,
    brightness,
)

UP = np.array([0.0, 0.0, 1.0])
MATT = Material()
MIRROR = Material("metal", 0.02)


def scene_of(solid):
    return RayScene(solid.vertices, solid.triangles, n_threads=1)


# far below everything: nothing blocks light
EMPTY = RayScene(
    np.array([[0.0, 0, -500], [1, 0, -500], [0, 1, -500]]), np.array([[0, 1, 2]]), n_threads=1
)


def place(point, normal=UP, view=UP):
    unit = np.asarray(view, float) / np.linalg.norm(view)
    return Places(
        np.array([point], float), np.array([normal], float) / np.linalg.norm(normal), unit[None]
    )


def of(light, *args, scene=EMPTY, material=MATT, **options):
    return float(brightness(scene, light, place(*args), material, **options)[0])


def cap(lowest_deg=0.0, hole=0.0):
    return Cap(np.zeros(3), UP, 100.0, math.sin(math.radians(lowest_deg)), hole)


def test_a_matt_face_under_a_whole_dome_is_as_bright_as_the_dome():
    assert of(cap(), (0, 0, 0)) == pytest.approx(1.0, abs=0.002)
    assert of(cap(), (40, 30, 0)) == pytest.approx(1.0, abs=0.005)


@pytest.mark.parametrize("lowest_deg", [15.0, 30.0, 60.0])
def test_lambert_under_a_cap(lowest_deg):
    # the cosine over the cone above the elevation: 1 - sin²
    share = 1 - math.sin(math.radians(lowest_deg)) ** 2
    assert of(cap(lowest_deg), (0, 0, 0)) == pytest.approx(share, abs=0.003)


def test_an_upright_wall_sees_half_of_a_dome():
    wall = np.array([1.0, 0, 0])
    assert of(cap(), (0, 0, 0.001), wall, wall + UP) == pytest.approx(0.5, abs=0.005)


def test_the_hole_is_dark():
    assert of(cap(hole=50.0), (0, 0, 0), rays=1024) == pytest.approx(0.75, abs=0.005)


@pytest.mark.parametrize("depth", [5.0, 10.0, 30.0])
def test_the_floor_of_a_bore_sees_the_dome_through_its_mouth(depth):
    # the view factor of the middle of a disc to a coaxial disc, without light from the wall
    scene = scene_of(bore(10.0, depth))
    share = 10.0**2 / (10.0**2 + depth**2)
    got = of(cap(), (0, 0, -depth), scene=scene, rays=1024, bounces=0)
    assert got == pytest.approx(share, abs=0.01)


def test_light_between_faces_of_a_deep_bore():
    """A cavity of reflectance r whose mouth is all of the share F of its inside lets in light: an integrating sphere.

    For a cylinder it holds about; the floor gets more than directly, and less than without loss.
    """
    scene = scene_of(bore(10.0, 20.0))
    direct = of(cap(), (0, 0, -20.0), scene=scene, rays=1024, bounces=0)
    more = of(cap(), (0, 0, -20.0), scene=scene, rays=1024, bounces=2)
    most = of(cap(), (0, 0, -20.0), scene=scene, rays=1024, bounces=6)
    assert direct < more < most < 1
    assert most - more < 0.03


def test_a_square_in_front_of_a_face():
    light = Window(200 * UP, np.diag([1.0, -1.0, -1.0]), 50.0, 1e-6)
    # view factor of a small face to a coaxial square
    a = 25 / 200
    root = math.sqrt(1 + a * a)
    share = 4 / math.pi * (a / root) * math.atan(a / root)
    assert of(light, (0, 0, 0)) == pytest.approx(share, rel=0.01)


def test_a_rectangle_in_front_of_a_face():
    """The view factor of a small face to a rectangle whose corner is above it; the face is above the middle."""
    light = Rectangle(-200 * UP, np.eye(3), np.array([150.0, 60.0]))
    a = 150 / 200
    b = 60 / 200
    over_a = a / math.hypot(1, a) * math.atan(b / math.hypot(1, a))
    over_b = b / math.hypot(1, b) * math.atan(a / math.hypot(1, b))
    share = 4 / (2 * math.pi) * (over_a + over_b)
    assert of(light, (0, 0, 0), -UP, -UP) == pytest.approx(share, rel=0.01)
    # it is dark behind
    assert of(light, (0, 0, -400), UP, UP) == 0


def test_a_ring_in_front_of_a_face():
    light = Annulus(200 * UP, -UP, 30.0, 50.0)
    share = 50**2 / (50**2 + 200**2) - 30**2 / (30**2 + 200**2)
    assert of(light, (0, 0, 0)) == pytest.approx(share, rel=0.01)


def test_a_mirror_shows_what_lies_in_its_direction():
    dome = cap(hole=20.0)
    aside = np.array([1.0, 0, 1])
    assert of(dome, (0, 0, 0), UP, aside, material=MIRROR) == pytest.approx(1.0, abs=0.02)
    # the camera's hole: the share of facets of GGX that are tilted by more than half of its angle
    half = math.tan(math.asin(0.2) / 2)
    beside = 0.02**2 / (0.02**2 + half**2)
    assert of(dome, (0, 0, 0), material=MIRROR) == pytest.approx(beside, abs=0.01)
    # below the dome's rim
    steep = np.array([math.sin(1.0), 0, math.cos(1.0)])
    assert of(dome, (0, 0, 0), steep, UP, material=MIRROR) < 0.05


@pytest.mark.parametrize("roughness", [0.1, 0.3, 0.6])
@pytest.mark.parametrize("view_deg", [0.0, 45.0, 70.0])
def test_metal_under_the_whole_sky_loses_what_its_facets_cover(roughness, view_deg):
    """∫ f cos over all directions by a plain sum over a grid, another way than by drawn directions."""
    view = np.array([math.sin(math.radians(view_deg)), 0, math.cos(math.radians(view_deg))])
    height = (np.arange(800) + 0.5) / 800
    turn = 2 * np.pi * (np.arange(1600) + 0.5) / 1600
    h, t = (grid.ravel() for grid in np.meshgrid(height, turn))
    flat = np.sqrt(1 - h**2)
    ways = np.column_stack([flat * np.cos(t), flat * np.sin(t), h])
    metal = Material("metal", roughness)
    value, _ = metal.scattered(
        np.broadcast_to(UP, ways.shape), np.broadcast_to(view, ways.shape), ways
    )
    expected = 2 * np.pi * value.mean()
    assert of(cap(), (0, 0, 0), UP, view, material=metal) == pytest.approx(expected, abs=0.01)


def test_the_density_of_drawn_directions_is_the_stated_one():
    """Drawn directions and their stated density give the same mean of any function: that of l_x²."""
    metal = Material("metal", 0.4)
    view = np.array([0.6, 0, 0.8])
    numbers = np.stack(np.meshgrid(*2 * [(np.arange(300) + 0.5) / 300]), axis=-1).reshape(-1, 2)
    n = len(numbers)
    ways, _ = metal.drawn(np.broadcast_to(UP, (n, 3)), np.broadcast_to(view, (n, 3)), numbers)
    drawn = np.where(ways[:, 2] > 0, ways[:, 0] ** 2, 0.0).mean()
    height = (np.arange(600) + 0.5) / 600
    h, t = (g.ravel() for g in np.meshgrid(height, 2 * np.pi * (np.arange(1200) + 0.5) / 1200))
    flat = np.sqrt(1 - h**2)
    grid = np.column_stack([flat * np.cos(t), flat * np.sin(t), h])
    density = metal.scattered(
        np.broadcast_to(UP, grid.shape), np.broadcast_to(view, grid.shape), grid
    )[1]
    assert drawn == pytest.approx(2 * np.pi * (density * grid[:, 0] ** 2).mean(), rel=0.01)


def test_the_same_light_wherever_and_however_the_part_lies():
    turn = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    shift = np.array([300.0, -200, 100])
    metal = Material("metal", 0.25)
    points = np.array([[5.0, 3, 0], [40, -20, 0]])
    views = np.array([[0.3, 0, 0.9], [0, 0.4, 0.9]])
    views /= np.linalg.norm(views, axis=1, keepdims=True)
    ways = np.tile(UP, (2, 1))
    here = brightness(EMPTY, cap(30, 20), Places(points, ways, views), metal, 1024)
    moved = Cap(shift, turn @ UP, 100.0, 0.5, 20.0)
    far = RayScene(
        np.array([[0.0, 0, 5000], [1, 0, 5000], [0, 1, 5000]]), np.array([[0, 1, 2]]), n_threads=1
    )
    there = brightness(
        far, moved, Places(points @ turn.T + shift, ways @ turn.T, views @ turn.T), metal, 1024
    )
    assert there == pytest.approx(here, abs=0.01)


def test_a_shadow_of_the_part():
    """A wall of 60 mm, 1 mm away, hides the part of a far round light that is more than 60 times as far aside."""
    light = Annulus(np.array([80.0, 25, 1e4]), -UP, 1e-3, 500.0)
    ground = place((81.0, 25, 0.0))
    free = brightness(EMPTY, light, ground, MATT, 1024)[0]
    got = brightness(scene_of(block()), light, ground, MATT, 1024, bounces=0)[0]
    aside = 1e4 / 60 - 1
    hidden = (500**2 * math.acos(aside / 500) - aside * math.sqrt(500**2 - aside**2)) / (
        math.pi * 500**2
    )
    assert got / free == pytest.approx(1 - hidden, abs=0.01)


@pytest.mark.parametrize(
    ("kind", "roughness", "text"),
    [("wood", 0.3, "material must be matt or metal"), ("metal", 0.0, r"roughness must be in")],
)
def test_refusals(kind, roughness, text):
    with pytest.raises(RequestError, match=text):
        Material(kind, roughness)
