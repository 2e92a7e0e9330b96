"""The predicted image: what is highlighted is where a pinhole camera sees it."""

import re

import cv2
import numpy as np
import pytest
from plan_examples import CAMERA

from aspectgraph import read_solid
from planner import Camera, look_at, predicted_image

RIM = [[60.0, 20.0, 10.0], [60.0, 40.0, 10.0]]


def test_a_named_entity_is_drawn_where_a_pinhole_camera_sees_it():
    """From straight above its middle the rim's image has the length d/z times its own, centred on the sensor."""
    pose = look_at([[60.0, 30.0, 610.0]], [60.0, 30.0, 10.0])[0]
    image = predicted_image(read_solid("examples/two_pocket_block.off"), CAMERA, pose, {"a <rim>": RIM}, "#123456")
    assert "a &lt;rim&gt;" in image
    (path,) = re.findall(r'class="entity" stroke="#123456" d="([^"]*)"', image)
    x1, y1, x2, y2 = (float(number) for number in re.findall(r"-?\d+\.?\d*", path))
    pitch = CAMERA.pixel_pitch_mm[1]
    assert abs(y2 - y1) == pytest.approx(20.0 * CAMERA.image_distance_mm / 600.0 / pitch, abs=0.2)
    assert x1 == pytest.approx(x2, abs=0.2)
    assert (x1, (y1 + y2) / 2) == pytest.approx(tuple(CAMERA.matrix[:2, 2]), abs=0.2)


def test_without_entities_nothing_is_highlighted():
    pose = look_at([[60.0, 30.0, 610.0]], [60.0, 30.0, 10.0])[0]
    image = predicted_image(read_solid("examples/two_pocket_block.off"), CAMERA, pose)
    assert image.startswith("<svg")
    assert 'class="edge"' in image
    assert 'class="entity"' not in image


def test_a_distorted_edge_is_drawn_as_the_curve_opencv_sees():
    k, lens = np.array([[2320.0, 0, 1240.0], [0, 2320.0, 1010.0], [0, 0, 1]]), np.array([-0.2, 0.05, 1e-3, 2e-3, 0])
    made = {"pixel_pitch_mm": 0.00345, "f_number": 8.0, "focus_distance_mm": 300.0}
    camera = Camera.from_opencv(k, lens, (2448, 2048), **made)
    pose = look_at([[-20.0, 130.0, 310.0]], [-20.0, 130.0, 10.0])[0]
    rim = np.array([[0.0, 20.0, 10.0], [100.0, 20.0, 10.0]])
    image = predicted_image(read_solid("examples/two_pocket_block.off"), camera, pose, {"rim": rim}, "#123456")
    (path,) = re.findall(r'class="entity" stroke="#123456" d="([^"]*)"', image)
    drawn = np.array([float(number) for number in re.findall(r"-?\d+\.?\d*", path)]).reshape(-1, 2)
    local = np.linspace(*((rim - pose[:3, 3]) @ pose[:3, :3]), 33)
    seen = cv2.projectPoints(local, np.zeros(3), np.zeros(3), k, lens)[0][:, 0]
    assert drawn[::2] == pytest.approx(seen[:-1], abs=0.06)
    assert drawn[1::2] == pytest.approx(seen[1:], abs=0.06)
    # it is bent by pixels
    chord = np.linspace(seen[0], seen[-1], 33)
    assert np.abs(seen - chord).max() > 5
    assert 'class="edge"' in image
