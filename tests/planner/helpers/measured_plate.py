"""A thick plate with two holes, a plan of four of its dimensions made by hand, and images of plates that deviate."""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import holed_plate as plates
import numpy as np
from plan_examples import plan_with, planned_dimension

from aspectgraph import Solid
from errors.measurands import Circle, Line, Localisation
from planner import Camera, PoseUncertainty, SensorSetting, look_at
from planner.identity import PartRecord

sys.path.insert(0, str(Path(__file__).parents[3] / "benchmarks" / "images"))
from part_images import Optics, PartImages
from rendered_images import Lamp

# 0.17 mm are a pixel
CAMERA = Camera(25.0, (0.0138, 0.0138), (640, 512), 8.0, 300.0)
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.1, rotation_rad=0.002)
TOP = 40.0
POSES = look_at([[60.0, -70.0, 325.0], [10.0, 110.0, 325.0]], [40.0, 25.0, TOP], roll=0.1)
LAMP = Lamp(np.array([150.0, 260.0, 340.0]))
UP = np.array([0.0, 0.0, 1.0])


def thick_plate(holes=plates.HOLES):
    """The plate of 40 mm: from above, the lower rims are far from the upper ones in the image."""
    thin = plates.holed_plate(holes)
    return Solid(thin.vertices * [1.0, 1.0, TOP / plates.HEIGHT], thin.faces, name="plate")


def upper_rims(solid):
    """Ids of the upper rims of the left and the right hole."""
    rims = [rim for rim in solid.rims() if abs(rim.centre[2] - TOP) < 1e-6]
    return tuple(rim.id for rim in sorted(rims, key=lambda rim: rim.centre[0]))


def crowded_plate():
    """A plate whose left hole nearly touches three others: of its rim, much is next to another line."""
    around = {"right": (41.2, 25.0), "further left": (14.8, 25.0), "behind": (28.0, 38.2)}
    return thick_plate(
        {"left": ((28.0, 25.0), 8.0), **{name: (middle, 5.0) for name, middle in around.items()}}
    )


def crowded_bore(solid):
    """The diameter of its left hole."""
    circle = Circle([28.0, 25.0, TOP], UP, 8.0)
    return dimension("diameter", upper_rims(solid)[:1], (circle,), (-0.1, 0.1))


def fine_plate(left=0.0, right=0.0, height=0.0, width=0.0):
    """Vertices and triangles of a plate whose holes have other radii, whose top is higher and which is wider, mm."""
    holes = {
        name: (centre, radius + more)
        for (name, (centre, radius)), more in zip(plates.HOLES.items(), (left, right), strict=True)
    }
    chords = plates.N
    plates.N = 240
    try:
        solid = thick_plate(holes)
    finally:
        plates.N = chords
    vertices = solid.vertices.copy()
    vertices[vertices[:, 2] > 5, 2] += height
    vertices[vertices[:, 1] > 49, 1] += width
    return vertices, solid.triangles


def broken_plate(profile, **deviations):
    """Vertices and triangles of such a plate whose upper edges are broken.

    The profile (k, 2) leads from the top to the sides: how far from the edge its points are along the top, and along
    the sides, mm. A chamfer of c is [(c, 0), (0, c)].
    """
    vertices, triangles = fine_plate(**deviations)
    top = vertices[:, 2].max()
    upper = np.flatnonzero(vertices[:, 2] > top - 1e-9)
    inward = np.zeros_like(vertices)
    for centre, radius in plates.HOLES.values():
        off = vertices[upper, :2] - centre
        near = np.linalg.norm(off, axis=1) < 1.2 * radius
        inward[upper[near], :2] = off[near] / np.linalg.norm(off[near], axis=1)[:, None]
    middle = vertices[:, :2].mean(axis=0)
    corners = upper[~inward[upper].any(axis=1)]
    inward[corners, :2] = -np.sign(vertices[corners, :2] - middle)
    # each upper vertex becomes one for each point of the profile
    rings = np.full((len(profile), len(vertices)), -1)
    parts = [vertices]
    for k, (along, down) in enumerate(profile):
        rings[k, upper] = len(vertices) + k * len(upper) + np.arange(len(upper))
        parts.append(vertices[upper] + along * inward[upper] - [0.0, 0.0, down])
    is_top = np.isin(triangles, upper).all(axis=1)
    last = np.where(rings[-1] >= 0, rings[-1], np.arange(len(vertices)))
    found = [rings[0][triangles[is_top]], last[triangles[~is_top]]]
    count = np.isin(triangles, upper).sum(axis=1)
    for triangle in triangles[count == 2]:
        # the edge of a side that lies on top
        k = next(k for k in range(3) if triangle[k - 1] in upper and triangle[k] in upper)
        a = triangle[k - 1]
        b = triangle[k]
        for above, below in pairwise(rings):
            found.append([[below[b], below[a], above[a]], [below[b], above[a], above[b]]])
    return np.concatenate(parts), np.concatenate([np.asarray(part) for part in found])


def dimension(kind, entities, geometry, tolerance, direction=None):
    return planned_dimension(kind, entities, geometry, 0.05, None, tolerance, direction=direction)


def dimensions_of(solid):
    """The dimensions of a plate, by name."""
    circles = {
        name: Circle([*centre, TOP], UP, radius) for name, (centre, radius) in plates.HOLES.items()
    }
    rims = dict(zip(plates.HOLES, upper_rims(solid), strict=True))
    sides = [Line([0.0, y, TOP], [80.0, y, TOP]) for y in (0.0, 50.0)]
    return {
        "left": dimension("diameter", (rims["left"],), (circles["left"],), (-0.1, 0.1)),
        "right": dimension("diameter", (rims["right"],), (circles["right"],), (-0.1, 0.1)),
        "apart": dimension(
            "centre_distance", tuple(rims.values()), tuple(circles.values()), (-0.1, 0.1)
        ),
        "width": dimension("distance", ("front", "back"), tuple(sides), (-0.2, 0.2)),
        "long": dimension("length", ("front",), (sides[0],), (-0.5, 0.5)),
    }


def measured_plan(solid, names=("left", "right", "apart", "width"), settings=2, **changes):
    """A plan whose settings all measure the given dimensions."""
    dimensions = changes.pop("dimensions", None)
    if not dimensions:
        every = dimensions_of(solid)
        dimensions = {name: every[name] for name in names}
    planned = [
        SensorSetting(
            pose, tuple(names), dict.fromkeys(names, 0.95), {"focus_mm": 1.0}, 1.0, 1, 1, "by hand"
        )
        for pose in POSES[:settings]
    ]
    known = {
        "settings": planned,
        "lower_bound": 1,
        "uninspectable": {},
        "camera": CAMERA,
        "pose_uncertainty": UNCERTAINTY,
        "accuracy": 0.99,
        "workspace": np.array([[-500.0] * 3, [500.0] * 3]),
        "localisation": Localisation.gaussian(0.1),
        "surfaces_mm": 0.02,
        "part": PartRecord("plate", PartRecord.of(solid).digest),
        "targets": tuple(replace(one, name=name) for name, one in dimensions.items()),
    }
    return plan_with(**(known | changes))


def photograph(mesh, poses, seed=1, **optics):
    """Images by number of the setting, from 1, of a mesh from poses."""
    given = {"matrix": CAMERA.matrix, "size": CAMERA.resolution, "noise": 0.005, **optics}
    images = PartImages(*mesh, Optics(**given))
    rng = np.random.default_rng(seed)
    return {k + 1: images.image(pose, [LAMP], rng) for k, pose in enumerate(poses)}
