"""Scans of images that are known as formulas."""

import numpy as np
import pytest
from scipy.special import erf

from planner.measuring.samples import State, find_edges, noise_of

SIZE = 60
V, U = np.mgrid[:SIZE, :SIZE].astype(float)
SIGMA = 0.8


def step(distance, low=60.0, high=180.0, sigma=SIGMA):
    """Grey values of a blurred step at distances across it, px."""
    return low + (high - low) * 0.5 * (1 + erf(distance / (np.sqrt(2) * sigma)))


def scan(image, centre=(30.0, 30.0), across=(1.0, 0.0), half=4.0, **given):
    known = {"white": 255.0, "noise": 0.5, **given}
    return find_edges(
        image.astype(np.float32), np.array([centre]), np.array([across]), half, **known
    )


@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 4])
def test_a_blurred_step_is_found_at_any_phase(angle):
    """An analytic step, 100 phases: within .005 px."""
    across = np.array([np.cos(angle), np.sin(angle)])
    off = []
    for phase in np.linspace(-0.5, 0.5, 100):
        distance = (U - 30) * across[0] + (V - 30) * across[1] - phase
        found = scan(step(distance), across=across)
        assert found.state[0] == State.FOUND
        off.append(found.offset[0] - phase)
    assert np.abs(off).max() < 0.005


def test_the_blur_is_that_of_the_step():
    assert scan(step(U - 30.2)).blur_px[0] == pytest.approx(SIGMA, abs=0.15)


@pytest.mark.parametrize("sigma", [1.5, 2.5, 3.5])
def test_the_blur_of_a_defocused_step_is_that_of_its_formula(sigma):
    """Beyond 2 px, an image has a note."""
    assert scan(step(U - 30.2, sigma=sigma)).blur_px[0] == pytest.approx(sigma, rel=0.1)


def test_a_circle_is_found_nearer_to_its_centre_by_its_curvature():
    """A disc of radius R blurred by s: its steepest place is s²/(2R) inside (first order)."""
    from scipy.ndimage import gaussian_filter

    fine = 8
    n = 120
    v, u = np.mgrid[: n * fine, : n * fine] / fine - (n - 1 / fine) / 2
    disc = gaussian_filter((np.hypot(u, v) < 25.0).astype(float) * 200, 2.0 * fine)
    image = disc.reshape(n, fine, n, fine).mean(axis=(1, 3))
    centre = (n - 1) / 2
    angle = np.arange(0, 6.2, 0.1)
    way = np.c_[np.cos(angle), np.sin(angle)]
    found = find_edges(
        image.astype(np.float32), centre + 25.0 * way, way, 4.0, white=255.0, noise=0.1
    )
    # the scan averages over .75 px² along the edge
    assert found.offset.mean() == pytest.approx(-(4.0 + 0.75) / 50, abs=0.01)


@pytest.mark.parametrize(
    ("image", "state"),
    [
        (step(U - 30, 60, 62), State.WEAK),
        (step(U - 30, 60, 255), State.CLIPPED),
        (step(U - 33.8), State.AT_END),
        (step(U - 30) + step(U - 33, 0, 110), State.TWO_STEPS),
        (step(U - 30) - step(U - 33, 0, 110), State.TWO_STEPS),
        (np.full((SIZE, SIZE), 90.0), State.WEAK),
    ],
    ids=["weak", "overexposed", "at the end", "two steps", "a dark line", "nothing"],
)
def test_what_is_no_edge_has_a_state(image, state):
    assert scan(image).state[0] == state


def test_a_scan_off_the_image():
    assert scan(step(U - 3), centre=(3.0, 30.0)).state[0] == State.OUTSIDE


def test_the_sign_of_the_step_is_respected():
    image = step(U - 28) - step(U - 32, 0, 100)
    found = scan(image, sign=np.array([-1]), half=5.0)
    assert found.offset[0] == pytest.approx(2.0, abs=0.2)
    assert found.step[0] < 0


def test_noise_is_what_was_added():
    rng = np.random.default_rng(0)
    image = step(U - 30) + rng.normal(0, 3.0, U.shape)
    assert noise_of(image) == pytest.approx(3.0, rel=0.15)
