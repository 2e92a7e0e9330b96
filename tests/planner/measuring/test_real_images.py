"""Images as cameras take them: a plate by closed forms, through bits and responses, with sharp and broken rims.

Rays are met with a box, cylinders and cones by formulas, so nothing is shared with what measures, nor with other
renderers.
"""

from dataclasses import dataclass

import holed_plate as plates
import numpy as np
import pytest
from measured_plate import CAMERA, POSES, TOP, measured_plan, thick_plate
from scipy.ndimage import binary_dilation, gaussian_filter, maximum_filter, minimum_filter

from planner import MeasureOptions, Measurer, Registration

SIZE = (80.0, 50.0)
BLUR_PX = 0.76
NOISE_SHARE = 0.004
AMBIENT = 0.12
GROUND = 0.05
LIGHT = np.array([0.25, 0.35, 0.9])
# along each side of a pixel where the picture changes
RAYS = 5


@dataclass(frozen=True)
class Plate:
    """A plate whose bores have other radii, and chamfers with legs of `break_mm` at their upper rims."""

    left_mm: float
    right_mm: float
    break_mm: float = 0.0

    @property
    def bores(self):
        more = (self.left_mm, self.right_mm)
        return [
            (np.array(centre), radius + extra)
            for (centre, radius), extra in zip(plates.HOLES.values(), more, strict=True)
        ]

    @property
    def values(self):
        (first, left), (last, right) = self.bores
        apart = float(np.linalg.norm(last - first))
        return {"left": 2 * left, "right": 2 * right, "apart": apart, "width": SIZE[1]}

    def light(self, pixels, pose):
        """The light (n,) at pixels (n, 2)."""
        rays = np.c_[pixels, np.ones(len(pixels))] @ np.linalg.inv(CAMERA.matrix).T
        rays = rays @ pose[:3, :3].T
        eye = pose[:3, 3]
        grey = np.full(len(rays), GROUND)
        top = at_height(eye, rays, TOP)
        on_top = np.all((top > 0) & (top < SIZE), axis=1)
        grey[on_top] = lambert(np.array([0.0, 0.0, 1.0]))
        self._sides(grey, eye, rays, ~on_top)
        for centre, radius in self.bores:
            self._bore(grey, eye, rays, top, centre, radius)
        return grey

    @staticmethod
    def _sides(grey, eye, rays, free):
        # from outside, the plane of a side is met between its other limits
        for axis, other, limit, sign in (
            (0, 1, 0, -1),
            (0, 1, SIZE[0], 1),
            (1, 0, 0, -1),
            (1, 0, SIZE[1], 1),
        ):
            if sign * (eye[axis] - limit) <= 0:
                continue
            way = (limit - eye[axis]) / rays[:, axis]
            height = eye[2] + way * rays[:, 2]
            across = eye[other] + way * rays[:, other]
            met = free & (way > 0) & (height > 0) & (height < TOP)
            met &= (across > 0) & (across < SIZE[other])
            normal = np.zeros(3)
            normal[axis] = sign
            grey[met] = lambert(normal)

    def _bore(self, grey, eye, rays, top, centre, radius):
        opening = np.linalg.norm(top - centre, axis=1) < radius + self.break_mm
        ways = rays[opening]
        deep = at_height(eye, ways, TOP - self.break_mm) - centre
        through = np.linalg.norm(at_height(eye, ways, 0.0) - centre, axis=1) < radius
        # |q + s w| = r, farther along the ray
        q = eye[:2] - centre
        w = ways[:, :2]
        square = (w**2).sum(axis=1)
        half = (w @ q) / square
        far = -half + np.sqrt(np.maximum(half**2 - (q @ q - radius**2) / square, 0.0))
        inward = -(q + far[:, None] * w) / radius
        wall = lambert(np.c_[inward, np.zeros(len(w))])
        size = np.linalg.norm(deep, axis=1)
        slope = np.c_[-deep / size[:, None], np.ones(len(w))] / np.sqrt(2.0)
        inside = np.where(through, GROUND, wall)
        grey[opening] = np.where(size > radius, lambert(slope), inside)

    def image(self, pose):
        """The blurred light (h, w), at most about one."""
        width, height = CAMERA.resolution
        v, u = np.mgrid[:height, :width]
        pixels = np.c_[u.ravel(), v.ravel()].astype(float)
        grey = self.light(pixels, pose).reshape(height, width)
        change = maximum_filter(grey, 3) - minimum_filter(grey, 3) > 1e-3
        again = binary_dilation(change).ravel()
        steps = (np.arange(RAYS) + 0.5) / RAYS - 0.5
        fine = [self.light(pixels[again] + (x, y), pose) for x in steps for y in steps]
        grey.ravel()[again] = np.mean(fine, axis=0)
        return gaussian_filter(grey, BLUR_PX, mode="nearest")


def at_height(eye, rays, height):
    """Where rays (n, 3) meet a horizontal plane; (n, 2)."""
    way = (height - eye[2]) / rays[:, 2]
    return eye[:2] + way[:, None] * rays[:, :2]


def lambert(normals):
    return AMBIENT + 0.75 * np.maximum(normals @ (LIGHT / np.linalg.norm(LIGHT)), 0.0)


def encoded(light, response):
    if response == "linear":
        return light
    if response == "srgb":
        # IEC 61966-2-1
        return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return light ** (1 / float(response))


def taken(images, response="linear", bits=8, seed=1):
    """Grey values of a camera by number of the setting, from 1."""
    rng = np.random.default_rng(seed)
    kind = np.uint8 if bits == 8 else np.uint16
    levels = {}
    for k, light in enumerate(images):
        noisy = np.clip(light + NOISE_SHARE * rng.normal(size=light.shape), 0.0, 1.0)
        levels[k + 1] = np.rint((2**bits - 1) * encoded(noisy, response)).astype(kind)
    return levels


SHARP = Plate(0.03, -0.02)
BROKEN = Plate(-0.02, 0.025, break_mm=0.2)


@pytest.fixture(scope="module")
def measurer():
    solid = thick_plate()
    return Measurer(measured_plan(solid), solid)


@pytest.fixture(scope="module")
def sharp():
    return [SHARP.image(pose) for pose in POSES]


@pytest.fixture(scope="module")
def broken():
    return [BROKEN.image(pose) for pose in POSES]


def wrong_in_silence(results, truth):
    """Names of the values that are off by more than U, and of which nothing is said."""
    return [
        result.name
        for result in results
        if result.measured
        and abs(result.value - truth[result.name]) > result.expanded_uncertainty
        and not (result.notes or results.notes)
    ]


@pytest.mark.parametrize("bits", [8, 12])
def test_linear_images_of_sharp_edges_are_read_within_u(measurer, sharp, bits):
    options = MeasureOptions(Registration.own_edges(), white_level=2**bits - 1)
    results = measurer.measure(taken(sharp, bits=bits), options)
    for result in results:
        assert result.measured, result.reason
        assert abs(result.value - SHARP.values[result.name]) <= result.expanded_uncertainty


@pytest.mark.parametrize("response", ["1.8", "2.2"])
def test_a_curved_response_is_estimated_or_said(measurer, sharp, response):
    results = measurer.measure(taken(sharp, response), MeasureOptions(Registration.own_edges()))
    assert not wrong_in_silence(results, SHARP.values)
    # steps of many levels tell the response well enough
    assert all(result.measured for result in results)
    for result in results:
        assert abs(result.value - SHARP.values[result.name]) <= result.expanded_uncertainty
    assert any("not proportional to light" in note for note in results.notes)


@pytest.mark.parametrize("response", ["srgb"])
def test_a_stated_response_is_undone(measurer, sharp, response):
    options = MeasureOptions(Registration.own_edges(), response=response)
    results = measurer.measure(taken(sharp, response), options)
    for result in results:
        assert result.measured, result.reason
        assert abs(result.value - SHARP.values[result.name]) <= result.expanded_uncertainty
    assert not results.notes


def test_rims_whose_breaks_are_stated_are_read_within_u(measurer, broken):
    options = MeasureOptions(Registration.own_edges(), edge_break_mm=(0.1, 0.3))
    results = measurer.measure(taken(broken), options)
    read = [result for result in results if result.measured]
    assert {"left", "right", "apart"} <= {result.name for result in read}
    for result in read:
        # all breaks are alike, and the step is at one end of them or the other
        error = abs(result.value - BROKEN.values[result.name])
        assert error <= 3 * result.standard_uncertainty
