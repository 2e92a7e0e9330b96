"""The predicted image: what is highlighted is where a pinhole camera sees it."""

import re
from xml.etree import ElementTree

import pytest
from plan_examples import CAMERA

from aspectgraph import read_solid
from planner import look_at, predicted_image

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


def test_it_is_a_picture_by_itself():
    """As a file of its own it has the namespace that viewers ask for, and tells how lines are drawn."""
    pose = look_at([[60.0, 30.0, 610.0]], [60.0, 30.0, 10.0])[0]
    image = predicted_image(read_solid("examples/two_pocket_block.off"), CAMERA, pose, {"rim": RIM})
    root = ElementTree.fromstring(image)
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    drawn = {one.get("class") for one in root.iter("{http://www.w3.org/2000/svg}path")}
    (style,) = root.iter("{http://www.w3.org/2000/svg}style")
    assert drawn == {"edge", "entity"}
    assert all(f".{kind}{{" in style.text for kind in drawn)
