"""When a registration is believed: by how much is found, and by what a lamp makes of it."""

import numpy as np
import pytest
from measured_plate import CAMERA, POSES, UNCERTAINTY, thick_plate

from planner.measuring.registered import Lamp, prior_covariance
from planner.measuring.samples import PartModel
from planner.measuring.task import Found, Scan, registration_task
from planner.measuring.verdict import Attempt, Shown

LAMP = Lamp(np.zeros(3), 0.0, 1.0, 0.8, 0.1, 0.0)


@pytest.fixture(scope="module")
def task():
    model = PartModel(thick_plate(), {})
    prior = prior_covariance(model, UNCERTAINTY.covariance, 0.02, CAMERA)
    return registration_task(model, CAMERA, POSES[0], prior, 0.15)


def attempt_of(task, found, light=None, left_out=None, lead=1.0):
    """An attempt in one image that finds some samples (m,), right where they are."""
    count = len(task.samples.edge)
    nothing = np.zeros(count)
    one = Found(nothing, found, np.where(found, 0, 1), nothing)
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
    light = Shown(LAMP, every, every, ~shadow, shadow)
    assert attempt_of(task, every, light).share == pytest.approx(1 - shadow.mean())
    out = attempt_of(task, ~shadow, Shown(LAMP, ~shadow, every, ~shadow, ~every), shadow)
    assert out.share == 1.0


@pytest.mark.parametrize(
    ("share", "lit", "convincing"),
    [(0.5, 0.5, True), (0.5, 0.8, False), (0.32, 0.32, True), (0.25, 0.25, False)],
)
def test_less_is_enough_if_the_rest_lies_in_the_dark(task, share, lit, convincing):
    """Where the lamp shows more than was found, the pose may be another one; too little convinces never."""
    found = first(task, share)
    light = Shown(LAMP, found, first(task, lit), found, first(task, 0.0))
    assert attempt_of(task, found, light).convincing == convincing


@pytest.mark.parametrize(
    ("share", "lead", "convincing"), [(0.65, 1.2, True), (0.65, 1.0, False), (0.75, 1.0, True)]
)
def test_another_shift_that_fits_as_well_asks_for_more(task, share, lead, convincing):
    """No lamp explains these: what was found has other steps than any makes."""
    found = first(task, share)
    light = Shown(LAMP, found, first(task, 1.0), first(task, 0.3), first(task, 0.0))
    assert attempt_of(task, found, light, lead=lead).convincing == convincing
