"""Whatever is done to a plan, state or camera file: one clear line refuses it, or what it promises makes sense."""

import json
import random

import numpy as np
import pytest
from file_mutants import damaged_json, damaged_toml
from plan_examples import ENTITIES, LIGHT, plan, setting

from planner import Camera, look_at
from planner.exceptions import CameraError, PlanFileError
from planner.files import encoded
from planner.plan import read_plan
from planner.resume import PlanningState
from planner.sensor_setting import Outcome

MUTANTS = 300
REQUEST = {"entities": ENTITIES}
CAMERA = """focal_length_mm = 25.0
pixel_pitch_mm = [0.00345, 0.00345]
resolution = [2448, 2048]
f_number = 8.0
focus_distance_mm = 600.0
largest_blur_mm = 0.005
name = "cell 7"
"""


def assert_one_line(error, path):
    assert str(error).startswith(str(path))
    assert str(error).endswith(".")
    assert str(error).isprintable()
    assert len(str(error)) < len(str(path)) + 400, str(error)


def test_damaged_plan_is_refused_or_makes_sense(tmp_path):
    good = encoded(plan(light=LIGHT).simulated(100).to_dict())
    rng = random.Random(1)
    path = tmp_path / "plan.json"
    refused = 0
    for _ in range(MUTANTS):
        path.write_bytes(damaged_json(good, rng))
        try:
            found = read_plan(path)
        except PlanFileError as error:
            assert_one_line(error, path)
            refused += 1
            continue
        assert_sensible(found)
    assert refused > 0.6 * MUTANTS


def assert_sensible(found):
    assert 0 < found.probability < 1
    assert min(1, len(found.settings)) <= found.lower_bound <= len(found.settings)
    assert set(found.inspected) | set(found.uninspectable) == set(found.entities)
    for one in found.settings:
        assert tuple(one.probability) == one.entities or set(one.probability) == set(one.entities)
        assert all(found.probability - 1e-6 <= p <= 1 for p in one.probability.values())
        turn = one.cam2world[:3, :3]
        assert turn @ turn.T == pytest.approx(np.eye(3), abs=1e-5)
        assert np.isfinite(one.cam2world).all()
    if found.light is not None:
        assert 0 <= found.light.lower_bound <= len(found.light.lamps)
        for one, images, unlit in zip(
            found.settings, found.light.images, found.light.unlit, strict=True
        ):
            assert sorted(
                [*unlit, *(name for image in images for name in image.contrast)]
            ) == sorted(one.entities)
    result = found.simulate(20)
    assert all(0 <= rate.low <= rate.high <= 1 for rates in result.rates for rate in rates.values())


def test_damaged_state_is_refused_and_left_alone_or_makes_sense(tmp_path):
    path = tmp_path / "state.json"
    good = json.loads(written_state(path).read_text())
    rng = random.Random(2)
    refused = 0
    for _ in range(MUTANTS):
        content = damaged_json(good, rng)
        path.write_bytes(content)
        try:
            state = PlanningState(REQUEST, path)
        except PlanFileError as error:
            assert_one_line(error, path)
            assert path.read_bytes() == content
            refused += 1
            continue
        # other spaces or another order of the fields, but nothing else
        assert json.loads(content) == good
        assert state.get(["bottom"]) == Outcome(reason="unobservable: no viewpoint sees it.")
    assert refused > 0.6 * MUTANTS


def written_state(path):
    state = PlanningState(REQUEST, path)
    state.put(["bottom"], Outcome(reason="unobservable: no viewpoint sees it."))
    state.put(
        ["top front", "top right"],
        Outcome(setting((40.0, -180.0, 620.0), ["top front", "top right"])),
    )
    poses = look_at([[0.0, 1.0, 200.0], [3.0, 4.0, 500.0]], (0.0, 0.0, 0.0), roll=0.3)
    pools = {"realised": {"poses": poses}, "near": {"poses": poses[:1]}}
    state.keep(
        {
            "stage": "lower bound",
            "pools": pools,
            "uninspectable": {"bottom": "hidden"},
            "entries": {"proven": [2, "boxes"]},
        },
    )
    state.save()
    return path


def test_damaged_camera_is_refused_or_exists(tmp_path):
    rng = random.Random(3)
    path = tmp_path / "camera.toml"
    refused = 0
    for _ in range(MUTANTS):
        path.write_bytes(damaged_toml(CAMERA, rng))
        try:
            camera = Camera.from_toml(path)
        except CameraError as error:
            assert_one_line(error, path)
            refused += 1
            continue
        near, far = camera.depth_of_field_mm
        assert 0 < near < far
        assert np.isfinite(
            [camera.image_distance_mm, *camera.sensor_size_mm, *camera.matrix.flat]
        ).all()
    assert refused > 0.6 * MUTANTS


def test_state_is_strict_json_and_keeps_margins_that_are_not_finite(tmp_path):
    path = written_state(tmp_path / "state.json")
    json.loads(path.read_text(), parse_constant=pytest.fail)
    found = PlanningState(REQUEST, path).get(["top right", "top front"]).setting
    assert found == setting((40.0, -180.0, 620.0), ["top front", "top right"])
    assert found.margins["reach"] == float("inf")
