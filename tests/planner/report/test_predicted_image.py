"""The predicted image: what is highlighted is where a pinhole camera sees it."""

import re
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
import shapely
from holed_plate import HOLES, holed_plate
from plan_examples import CAMERA

from aspectgraph import read_solid
from planner import Camera, RequestError, look_at, predicted_image
from planner.report.predicted_image import _AMBIENT, _GROUND, PictureMaker, path_data

RIM = [[60.0, 20.0, 10.0], [60.0, 40.0, 10.0]]


def drawn_points(path):
    """The points (n, 2) of a path of one line: its first, and steps from each to the next."""
    assert re.findall("[a-zA-Z]", path) == ["M", "l"]
    numbers = [float(number) for number in re.findall(r"-?\d+\.?\d*", path)]
    return np.cumsum(np.reshape(numbers, (-1, 2)), axis=0)


def test_lines_keep_their_shape_without_the_points_they_need_not():
    angles = np.linspace(0.0, 2 * np.pi, 721)
    circle = 300.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    drawn = drawn_points(path_data([circle], 0.3))
    # a bisection needs at most twice the 71 points of the best polygon: 2 pi / (2 acos(1 - 0.3 / 300))
    assert len(drawn) < 2 * 71
    assert drawn[0] == pytest.approx(drawn[-1], abs=1e-9)
    line = shapely.LineString(drawn)
    assert max(line.distance(shapely.Point(point)) for point in circle) < 0.3 + 0.1
    assert path_data([np.array([[1.04, 2.0], [-3.26, 2.0]])], 0.3) == "M1 2l-4.3 0"
    assert path_data([np.array([[1.4, 2.0], [-3.6, 2.0]])], 2.0) == "M1 2l-5 0"
    # an edge seen end on is a dot
    assert path_data([np.array([[1.0, 2.0], [1.0, 2.0]])], 0.3) == "M1 2l0 0"
    assert path_data([], 0.3) == ""


def test_a_named_entity_is_drawn_where_a_pinhole_camera_sees_it():
    """From straight above its middle the rim's image has the length d/z times its own, centred on the sensor."""
    pose = look_at([[60.0, 30.0, 610.0]], [60.0, 30.0, 10.0])[0]
    image = predicted_image(
        read_solid("examples/two_pocket_block.off"), CAMERA, pose, {"a <rim>": RIM}, "#123456"
    )
    assert "a &lt;rim&gt;" in image
    (path,) = re.findall(r'class="entity" stroke="#123456" d="([^"]*)"', image)
    (x1, y1), (x2, y2) = drawn_points(path)
    pitch = CAMERA.pixel_pitch_mm[1]
    assert abs(y2 - y1) == pytest.approx(20.0 * CAMERA.image_distance_mm / 600.0 / pitch, abs=0.2)
    assert x1 == pytest.approx(x2, abs=0.2)
    assert (x1, (y1 + y2) / 2) == pytest.approx(tuple(CAMERA.matrix[:2, 2]), abs=0.2)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"cam2world": np.eye(3)},
            "cam2world must be finite numbers of the shape (4, 4). Got array(",
        ),
        ({"cam2world": 5}, "cam2world must be finite numbers of the shape (4, 4). Got 5."),
        (
            {"entities": {"rim": np.zeros((3, 2))}},
            "entities['rim'] must be finite numbers of the shape (2, 3) or (s, 2, 3). Got array(",
        ),
        (
            {"lamp": [0, np.nan, 9]},
            "lamp must be finite numbers of the shape (3,) or (n, 3). Got [0, nan, 9].",
        ),
        ({"lamp": [0, 9]}, "lamp must be finite numbers of the shape (3,) or (n, 3). Got [0, 9]."),
        ({"solid": 5}, "solid must be a Solid. Got 5; "),
    ],
)
def test_arrays_of_another_shape_are_refused(changes, message):
    block = read_solid("examples/two_pocket_block.off")
    pose = look_at([[55, 30, 400]], [55, 30, 10])[0]
    known = {"solid": block, "camera": CAMERA, "cam2world": pose, **changes}
    with pytest.raises(RequestError) as caught:
        predicted_image(**known)
    assert str(caught.value).startswith(message)


def test_without_entities_nothing_is_highlighted():
    pose = look_at([[60.0, 30.0, 610.0]], [60.0, 30.0, 10.0])[0]
    image = predicted_image(read_solid("examples/two_pocket_block.off"), CAMERA, pose)
    assert image.startswith("<svg")
    assert 'class="edge"' in image
    assert 'class="entity"' not in image


def test_under_a_lamp_grey_values_are_those_of_matt_faces():
    """Beside the edge x = 0, z = 40 the greys above the shadows' are as the lamp's heights over the two faces."""
    solid = read_solid("examples/two_pocket_block.off")
    middle = np.array([0.0, 30, 40])
    lamp = np.array([-200.0, 30, 440])
    maker = PictureMaker(solid, CAMERA)
    pose = look_at([[-300.0, 30, 340]], middle)[0]
    image = maker.shaded(pose, lamp).astype(float) - _AMBIENT
    # four pixels beside the middle, where the edge passes, on either side
    u, v = (
        maker.project((np.array([[0.0, 40, 40]]) - pose[:3, 3]) @ pose[:3, :3])[0]
        - CAMERA.matrix[:2, 2]
    )
    across = np.rint(4 * np.array([u, -v]) / np.hypot(u, v)).astype(int)
    (i, j) = np.array(image.shape) // 2
    rows = np.array([1, -1])
    bright = image[i + rows * across[0], j + rows * across[1]]
    assert np.ptp(bright) / bright.sum() == pytest.approx((400 - 200) / (400 + 200), abs=0.02)


def test_cast_shadows_and_the_ground():
    """A lamp low over the face x = 60 leaves its pocket dark: 20 x 20 of 60 x 40 mm; one before it leaves nothing."""
    solid = read_solid("examples/two_pocket_block.off")
    middle = np.array([60.0, 30, 20])
    maker = PictureMaker(solid, CAMERA)
    pose = look_at([[530.0, 30, 20]], middle)[0]
    low, high = (
        maker.shaded(pose, np.array(place)) for place in ([70.0, -300, 20], [530.0, 30, 20])
    )
    assert (low == _AMBIENT).sum() / (low != _GROUND).sum() == pytest.approx(400 / 2400, rel=0.03)
    assert not (high == _AMBIENT).any()
    assert (low[0, 0], high[0, 0]) == (_GROUND, _GROUND)
    assert predicted_image(solid, CAMERA, pose, lamp=(530, 30, 20)) != predicted_image(
        solid, CAMERA, pose
    )


def test_a_distorted_edge_is_drawn_as_the_curve_opencv_sees():
    k = np.array([[2320.0, 0, 1240.0], [0, 2320.0, 1010.0], [0, 0, 1]])
    lens = np.array([-0.2, 0.05, 1e-3, 2e-3, 0])
    made = {"pixel_pitch_mm": 0.00345, "f_number": 8.0, "focus_distance_mm": 300.0}
    camera = Camera.from_opencv(k, lens, (2448, 2048), **made)
    pose = look_at([[-20.0, 130.0, 310.0]], [-20.0, 130.0, 10.0])[0]
    rim = np.array([[0.0, 20.0, 10.0], [100.0, 20.0, 10.0]])
    image = predicted_image(
        read_solid("examples/two_pocket_block.off"), camera, pose, {"rim": rim}, "#123456"
    )
    (path,) = re.findall(r'class="entity" stroke="#123456" d="([^"]*)"', image)
    drawn = drawn_points(path)
    local = np.linspace(*((rim - pose[:3, 3]) @ pose[:3, :3]), 33)
    seen = cv2.projectPoints(local, np.zeros(3), np.zeros(3), k, lens)[0][:, 0]
    assert drawn[[0, -1]] == pytest.approx(seen[[0, -1]], abs=0.06)
    # a picture so many px wide may lie off by 1/4000 of it, and its points lie on tenths
    line = shapely.LineString(drawn)
    assert max(line.distance(shapely.Point(point)) for point in seen) < 2448 / 4000 + 0.1
    assert len(drawn) > 3
    # it is bent by pixels
    chord = np.linspace(seen[0], seen[-1], 33)
    assert np.abs(seen - chord).max() > 5
    assert 'class="edge"' in image


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


def test_a_window_holds_what_is_measured_and_has_the_sensors_shape():
    maker = PictureMaker(read_solid("examples/two_pocket_block.off"), CAMERA)
    pose = look_at([[260, 30, 610]], RIM[0])[0]
    x, y, width, height = maker.window(pose, {"rim": np.array(RIM)})
    pixels, _ = cv2.projectPoints(np.array(RIM), *_opencv(pose), CAMERA.matrix, np.zeros(5))
    assert (
        (pixels.reshape(-1, 2) > (x, y)) & (pixels.reshape(-1, 2) < (x + width, y + height))
    ).all()
    assert width / height == pytest.approx(2448 / 2048, rel=0.01)
    # the larger side of what is measured, and three tenths for names
    assert (np.ptp(pixels.reshape(-1, 2), axis=0) / (width, height)).max() == pytest.approx(
        1 / 1.3, rel=0.02
    )
    assert min(x, y) >= 0
    assert (x + width, y + height) <= (2448, 2048)


def _opencv(pose):
    """Rotation vector and translation of the part in the camera's axes."""
    inverse = np.linalg.inv(pose)
    return cv2.Rodrigues(inverse[:3, :3])[0], inverse[:3, 3]


@pytest.mark.parametrize("lamp", [None, np.array([-200.0, 30, 440])])
def test_shades_of_a_window_are_those_of_the_whole_image(lamp):
    maker = PictureMaker(read_solid("examples/two_pocket_block.off"), CAMERA)
    pose = look_at([[260, 30, 610]], RIM[0])[0]
    whole = maker.shaded(pose, lamp).astype(int)
    # a half of the sensor each way, so that four of its pixels lie in one of the whole picture
    window = (612, 512, 1224, 1024)
    near = maker.shaded(pose, lamp, window=window).astype(int)
    rows = np.arange(0, near.shape[0] - 1, 2)
    columns = np.arange(0, near.shape[1] - 1, 2)
    coarse = near[np.ix_(rows, columns)]
    place = np.ix_(rows // 2 + whole.shape[0] // 4, columns // 2 + whole.shape[1] // 4)
    # under a lamp the brightest of each picture is the same grey
    lit = (coarse > _AMBIENT) & (whole[place] > _AMBIENT)
    share = (
        1.0
        if lamp is None
        else np.median((coarse[lit] - _AMBIENT) / (whole[place][lit] - _AMBIENT))
    )
    # but for pixels on edges
    differ = np.abs(coarse[lit] - _AMBIENT - share * (whole[place][lit] - _AMBIENT)) > 8
    assert differ.mean() < 0.03
    assert (lit == ((coarse > _AMBIENT) | (whole[place] > _AMBIENT))).mean() > 0.97


def test_of_what_is_enlarged_the_whole_image_shows_the_frame_and_no_names():
    maker = PictureMaker(read_solid("examples/two_pocket_block.off"), CAMERA)
    pose = look_at([[260, 30, 610]], RIM[0])[0]
    window = maker.window(pose, {"rim": np.array(RIM)})
    whole = maker.image_svg(pose, {"rim": np.array(RIM)}, "#123456", outlined=window)
    near = maker.image_svg(pose, {"rim": np.array(RIM)}, "#123456", window=window)
    assert 'x="{}" y="{}" width="{}" height="{}"/>'.format(*window) in whole
    assert ">rim</text>" not in whole
    assert ">rim</text>" in near
    assert f'viewBox="{" ".join(map(str, window))}"' in near


def test_a_rim_is_drawn_as_the_ellipse_that_its_circle_gives():
    """24 chords of a circle of 8 mm leave it by 8 (1 - cos 7.5°) = 0.07 mm, in the image by more than a pixel."""
    solid = holed_plate()
    pose = look_at([[60.0, -50.0, 310.0]], [40.0, 25.0, 10.0])[0]
    lines = np.array(PictureMaker(solid, CAMERA).edge_lines(pose))
    (centre, radius) = HOLES["left"]
    angles = np.linspace(0, 2 * np.pi, 4000)
    around = np.column_stack([np.cos(angles), np.sin(angles)])
    # the lower rim shows through the hole
    circles = [
        np.column_stack([np.array(centre) + radius * around, np.full(4000, z)]) for z in (0.0, 10.0)
    ]
    ellipses = [
        cv2.projectPoints(circle, *_opencv(pose), CAMERA.matrix, np.zeros(5))[0][:, 0]
        for circle in circles
    ]
    middles = lines.mean(axis=1)
    distance = np.min(
        [np.linalg.norm(middles[:, None] - one[None], axis=2).min(axis=1) for one in ellipses],
        axis=0,
    )
    # straight edges are drawn in one piece, what is curved in pieces of five pixels
    near = (distance < 8) & (np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1) < 6)
    assert near.sum() > 48
    assert distance[near].max() < 0.3


def test_names_do_not_lie_on_each_other():
    """Six edges next to each other, under one name each; a letter is about 0.6 of its height wide."""
    pose = look_at([[60.0, 30.0, 610.0]], [60.0, 30.0, 10.0])[0]
    wanted = {f"an edge with a long name {k}": np.add(RIM, [0.4 * k, 0.0, 0.0]) for k in range(6)}
    image = predicted_image(read_solid("examples/two_pocket_block.off"), CAMERA, pose, wanted)
    texts = re.findall(
        r'<text x="([\d.]+)" y="([\d.]+)" font-size="([\d.]+)".*?text-anchor="(\w+)".*?>([^<]*)<',
        image,
    )
    assert len(texts) == 6
    boxes = []
    for x, y, size, anchor, name in texts:
        u = float(x)
        v = float(y)
        height = float(size)
        width = 0.6 * height * len(name)
        boxes.append((u - width * (anchor == "end"), v - height, width, height))
    for i, (u, v, width, height) in enumerate(boxes):
        for x, y, wide, high in boxes[:i]:
            assert u + width <= x or x + wide <= u or v + height <= y or y + high <= v
