"""Poses come back from files as OpenCV, ROS, robot programs and spreadsheets write them."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aspectgraph import read_solid
from planner import (
    Cell,
    LightPlan,
    PoseFileError,
    RequestError,
    look_at,
    pose_files,
    read_plan,
    read_poses,
    robot_program,
    write_poses,
    write_program,
)

cv2 = pytest.importorskip("cv2")

PLAN = "examples/two_pocket_block_plan.json"
EYES = [[300.0, 40.0, 170.0], [-80.0, 250.0, 120.0], [35.0, -210.0, 260.0]]
POSES = look_at(EYES, [30.0, 30.0, 15.0], roll=[0.1, 2.0, -1.2])


def views():
    """Rotation vectors and translations of the poses, by OpenCV."""
    for pose in POSES:
        world2cam = np.linalg.inv(pose)
        yield cv2.Rodrigues(world2cam[:3, :3])[0], world2cam[:3, 3:]


def matrix_of_calibration(storage):
    # as the sample calibration.cpp of OpenCV writes it
    rows = np.array([np.concatenate([r.ravel(), t.ravel()]) for r, t in views()])
    storage.write("board_width", 9)
    storage.write("square_size", 20.0)
    storage.write("extrinsic_parameters", rows)


def two_matrices(storage):
    rvecs, tvecs = zip(*views(), strict=True)
    storage.write("rvecs", np.array(rvecs).reshape(-1, 3))
    storage.write("tvecs", np.array(tvecs).reshape(-1, 3))


def two_sequences(storage):
    for name, vectors in zip(("rvecs", "tvecs"), zip(*views(), strict=True), strict=True):
        storage.startWriteStruct(name, cv2.FileNode_SEQ)
        for vector in vectors:
            storage.write("", vector)
        storage.endWriteStruct()


def numbered(storage):
    for k, (rvec, tvec) in enumerate(views(), 1):
        storage.write(f"rvec_{k}", rvec)
        storage.write(f"tvec_{k}", tvec)


def list_of_views(storage):
    storage.startWriteStruct("views", cv2.FileNode_SEQ)
    for k, (rvec, tvec) in enumerate(views(), 1):
        storage.startWriteStruct("", cv2.FileNode_MAP)
        storage.write("image", f"left_{k}.png")
        storage.write("rvec", rvec)
        storage.write("tvec", tvec)
        storage.endWriteStruct()
    storage.endWriteStruct()


WAYS = [matrix_of_calibration, two_matrices, two_sequences, numbered, list_of_views]


def assert_same_poses(poses, tolerance=1e-9):
    assert len(poses) == len(POSES)
    for pose, expected in zip(poses, POSES, strict=True):
        np.testing.assert_allclose(pose.cam2world, expected, atol=tolerance)


@pytest.mark.parametrize("suffix", ["yml", "json", "xml"])
@pytest.mark.parametrize("write", WAYS)
def test_views_of_opencv_are_read_as_its_file_storage_writes_them(tmp_path, write, suffix):
    path = tmp_path / f"views.{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    write(storage)
    storage.release()
    found = read_poses(path, units="mm")
    assert_same_poses(found.poses)
    if write is list_of_views:
        assert [pose.name for pose in found.poses] == ["left_1", "left_2", "left_3"]
    # the unit of the board is nowhere in the file
    with pytest.raises(PoseFileError, match="must state the unit of its lengths"):
        read_poses(path)
    np.testing.assert_allclose(
        read_poses(path, units="m").poses[0].cam2world[:3, 3], 1000 * POSES[0, :3, 3]
    )


def message(pose, scale=1e-3):
    x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()
    place = dict(zip("xyz", (scale * pose[:3, 3]).tolist(), strict=True))
    return {"position": place, "orientation": {"x": x, "y": y, "z": z, "w": w}}


def stamped(pose, frame="part"):
    stamp = {"sec": 12, "nanosec": 5}
    return {"header": {"stamp": stamp, "frame_id": frame}, "pose": message(pose)}


def block_style(data, indent=0):
    """YAML as `ros2 topic echo` prints messages."""
    lines = []
    for key, value in data.items():
        if isinstance(value, dict):
            lines += [" " * indent + f"{key}:", *block_style(value, indent + 2)]
        else:
            lines.append(" " * indent + f"{key}: {value}")
    return lines


ROS = {
    "echo.yaml": "\n---\n".join("\n".join(block_style(stamped(pose))) for pose in POSES)
    + "\n---\n",
    "array.json": json.dumps(
        {"header": {"frame_id": "part"}, "poses": [message(p) for p in POSES]}, indent="\t"
    ),
    "path.json": json.dumps({"poses": [stamped(pose) for pose in POSES]}),
    "list.yaml": json.dumps([message(pose) for pose in POSES]),
}


@pytest.mark.parametrize("name", ROS)
def test_messages_of_ros_are_read_in_metres(tmp_path, name):
    path = tmp_path / name
    path.write_text(ROS[name])
    found = read_poses(path)
    assert_same_poses(found.poses)
    assert found.frame == ("" if name == "list.yaml" else "part")
    assert "optical frame (z forward)" in found.source


def table(head, rows):
    return "\n".join([*head, *(",".join(map(str, row)) for row in rows)]) + "\n"


def rows_of(scale=1.0):
    for pose in POSES:
        turn = Rotation.from_matrix(pose[:3, :3])
        yield [*(scale * pose[:3, 3]).tolist(), *turn.as_quat().tolist()]


VECTORS = [
    [*pose[:3, 3].tolist(), *np.degrees(Rotation.from_matrix(pose[:3, :3]).as_rotvec()).tolist()]
    for pose in POSES
]
TABLES = {
    "suffixes": table(["x_mm,y_mm,z_mm,qx,qy,qz,qw"], rows_of()),
    "brackets": table(["x [m],y [m],z [m],qx,qy,qz,qw"], rows_of(1e-3)),
    "a comment": table(["# units: cm", "x,y,z,qx,qy,qz,qw"], rows_of(0.1)),
    "semicolons": table(["x_mm,y_mm,z_mm,qx,qy,qz,qw"], rows_of()).replace(",", ";"),
    "vectors": table(["x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg"], VECTORS),
}


@pytest.mark.parametrize("name", TABLES)
def test_tables_are_read_with_the_units_of_their_header(tmp_path, name):
    path = tmp_path / "poses.csv"
    path.write_text(TABLES[name])
    assert_same_poses(read_poses(path).poses)


def test_a_header_may_be_a_comment_and_blanks_may_separate(tmp_path):
    # the form of TUM's trajectories
    path = tmp_path / "poses.txt"
    text = table(["# tx ty tz qx qy qz qw"], rows_of(1e-3)).replace(",", " ")
    path.write_text(text)
    assert_same_poses(read_poses(path, units="m").poses)
    with pytest.raises(PoseFileError, match=r"poses.txt:1: header must state the unit"):
        read_poses(path)


@pytest.fixture(scope="module")
def plan():
    return read_plan(PLAN)


def test_our_own_files_give_the_poses_of_the_plan(tmp_path, plan):
    write_poses(plan, tmp_path)
    plan.to_csv(tmp_path / "measurements.csv")
    expected = plan.settings[0].cam2world
    for name in ("poses_opencv.json", "poses_ros.yaml", "measurements.csv"):
        (pose,) = read_poses(tmp_path / name).poses
        # the table has 0.1 µm and 0.00001 degrees
        atol = 1e-4 if name.endswith(".csv") else 1e-9
        np.testing.assert_allclose(pose.cam2world, expected, atol=atol, err_msg=name)
    (pose,) = read_poses(PLAN).poses
    assert (pose.cam2world == expected).all()
    assert pose.name == "setting_01"


# joints in degrees have six decimals and in rad eight: some 1e-8 rad at 2 m, 2e-5 mm
PROGRAMS = {
    "urscript": ("i.script", 1e-4),
    "rapid": ("i.mod", 1e-4),
    "krl": ("i.src", 1e-4),
    # three decimals: 6 axes, each 9e-6 rad off at 1.5 m
    "fanuc": ("i.ls", 0.08),
    "csv": ("i.csv", 1e-4),
    "ros": ("i.json", 1e-9),
    "json": ("program.json", 1e-9),
}


@pytest.fixture(scope="module")
def program(plan):
    cell = Cell.from_toml("examples/cell.toml")
    return cell, robot_program(plan, read_solid("examples/two_pocket_block.off"), cell)


@pytest.mark.parametrize("language", PROGRAMS)
def test_stops_of_a_robot_program_are_the_poses_of_its_plan(tmp_path, plan, program, language):
    cell, made = program
    name, tolerance = PROGRAMS[language]
    path = write_program(made, tmp_path / name, format=language)
    (pose,) = read_poses(path, cell=cell).poses
    np.testing.assert_allclose(pose.cam2world, plan.settings[0].cam2world, atol=tolerance)
    with pytest.raises(RequestError, match="cell must be given for a robot program"):
        read_poses(path)


def test_a_program_in_krl_has_the_name_of_its_file(tmp_path, program):
    path = write_program(program[1], tmp_path / "side_2.src")
    assert path.read_text().splitlines()[0] == "DEF side_2( )"
    for name in ("2_sides.src", "left-side.src", "a" * 25 + ".src", "ä.src"):
        with pytest.raises(RequestError, match="path must be named by up to 24 letters"):
            write_program(program[1], tmp_path / name)
        assert not (tmp_path / name).exists()


def test_a_program_of_fanuc_has_the_name_of_its_file(tmp_path, program):
    path = write_program(program[1], tmp_path / "side_2.ls")
    assert path.read_text().splitlines()[0] == "/PROG  SIDE_2"
    with pytest.raises(RequestError, match="path must be named by up to 36 letters"):
        write_program(program[1], tmp_path / "2_sides.ls")
    text = path.read_text().replace("J P[2] ", "J P[20] ")
    path.write_text(text)
    with pytest.raises(
        PoseFileError, match=r"a move must be to a position of the program. Got P\[20"
    ):
        read_poses(path, cell=program[0])


def test_a_program_that_takes_no_known_images_is_refused(tmp_path, program):
    path = tmp_path / "theirs.script"
    path.write_text("def weld():\n  movel(p[0.1, 0.2, 0.3, 0, 3.1, 0], a=1)\nend\n")
    with pytest.raises(PoseFileError, match="must take images as those of 'aspectgraph program'"):
        read_poses(path, cell=program[0])


MATRIX = "extrinsic_parameters: !!opencv-matrix\n  rows: 1\n  cols: 6\n  dt: d\n  data: "
ONE = message(POSES[0])
BROKEN = {
    "five.yml": (f"%YAML:1.0\n---\n{MATRIX}[1., 2., 3., 4., 5.]\n", "six numbers", ""),
    "alone.yml": ("rvec_3: [0, 0, 1]\n", ":1: rvec_3 must stand with tvec_3", ""),
    "word.yml": (
        "rvec: [0, 0, up]\ntvec: [0, 0, 1]\n",
        r"rvec\[2\] must be a number. Got 'up'",
        "",
    ),
    "mirror.yml": (
        "R: [1, 0, 0, 0, 1, 0, 0, 0, -1]\nt: [0, 0, 1]\n",
        "must hold a rotation",
        "",
    ),
    "nan.yml": ("rvec: [0, 0, .nan]\ntvec: [0, 0, 1]\n", "must be finite", ""),
    "zero.json": (
        json.dumps([{**ONE, "orientation": dict.fromkeys("xyzw", 0.0)}]),
        "must have the length 1, in the order x y z w",
        None,
    ),
    "no_w.json": (
        json.dumps([{**ONE, "orientation": {"x": 0, "y": 0, "z": 1}}], indent=1),
        r":\d+: \[0\].orientation must hold x, y, z, w",
        None,
    ),
    "frames.json": (
        json.dumps([stamped(POSES[0]), stamped(POSES[1], "base")], indent=1),
        "frame_id must be that of all poses, 'part'. Got 'base'",
        None,
    ),
    "twice.json": (
        json.dumps([{**ONE, "name": "a"}, {**ONE, "name": "a"}]),
        "names of poses must be different",
        None,
    ),
    "other.yaml": ("a: 1\n", "must hold position and orientation, or rvec and tvec", None),
    "torn.yaml": ("a: [1, 2\n", "file of poses must be YAML, JSON", None),
    "empty.yaml": ("", "must hold a pose", None),
    "units.csv": ("x_mm,y_m,z_mm,qx,qy,qz,qw\n", "one unit for x, y, z", None),
    "none.csv": ("x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,1\n", ":1: header must state the unit", None),
    "short.csv": ("x_mm,y_mm,z_mm,qx,qy,qz,qw\n0,0,0,0,0,1\n", ":2: row must have 7 cells", None),
    "text.csv": ("x_mm,y_mm,z_mm,qx,qy,qz,qw\n0,no,0,0,0,0,1\n", ":2: y must be a finite", None),
    "no_turn.csv": ("x_mm,y_mm,z_mm\n0,0,0\n", ":1: header must name qx, qy, qz, qw", None),
    "no_head.csv": ("0,0,0,0,0,0,1\n", ":1: first row must be a header", None),
    "angle.csv": ("x_mm,y_mm,z_mm,rx,ry,rz\n0,0,0,0,0,1\n", "unit of rx, ry, rz", None),
}


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_unclear_is_one_error_with_file_field_and_value(tmp_path, name):
    text, message_, units = BROKEN[name]
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(PoseFileError, match=message_) as caught:
        read_poses(path, units=None if units is None else "mm")
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_unit_that_contradicts_the_file_is_refused(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text(TABLES["suffixes"])
    with pytest.raises(PoseFileError, match=r"units must be mm, as the file states\. Got m"):
        read_poses(path, units="m")
    with pytest.raises(PoseFileError, match="units must be one of mm, cm"):
        read_poses(path, units="parsec")


def test_the_light_of_a_plan_is_known(tmp_path, monkeypatch):
    """What a plan's light does not show is no fault of its poses."""
    plan = read_plan(PLAN)
    assert read_poses(PLAN).light == ""
    dark = ({},) * len(plan.settings)
    images = ((),) * len(plan.settings)
    lamp = LightPlan("placed", 0.1, 0.1, "dark", np.ones((1, 3)), images, dark, 1, "by hand")
    monkeypatch.setattr(pose_files, "read_plan", lambda path: replace(plan, light=lamp))
    assert read_poses(PLAN).light == "placed"
