"""Every format is read back by its own rules: its joints lead the camera to the planned poses, in the right order."""

import csv
import hashlib
import io
import json
import re
from dataclasses import replace
from datetime import date

import numpy as np
import pytest
from controllers import (
    POPUPS_BEFORE_STOP,
    Stopped,
    World,
    fanuc_positions,
    fanuc_statements,
    run_fanuc,
    run_fanuc_image,
    run_krl_image,
    run_rapid_image,
    run_urscript,
)
from robot_cells import CAM2FLANGE
from robot_programs import FIXTURINGS, HOME, block, cell, plan_of, program, reached_poses
from scipy.spatial.transform import Rotation

from planner import (
    CameraSignals,
    OutputError,
    RequestError,
    program_text,
    read_program,
    robot_program,
    write_program,
)
from planner.robotprogram.program import JointRates, move_times
from planner.robotprogram.program_texts import FORMATS, plain

DAY = date(2026, 3, 1)
SIGNALS = CameraSignals(settle_s=0.7, trigger_output=3, ready_input=5, pulse_s=0.2, timeout_s=4.0)
LANGUAGES = ("urscript", "rapid", "krl", "fanuc", "ros", "csv")
# rad: what half of the last decimal of an angle is, where a language has few
ROUNDED = {"fanuc": np.radians(0.00051)}
N = r"-?\d+(?:\.\d+)?"


def text(language):
    return program_text(program(), language, signals=SIGNALS, made=DAY)


def numbers(words):
    return np.array([float(word) for word in re.findall(N, words)])


def from_urscript(script):
    """Targets of movej in rad, and images, in the order of the program."""
    for line in script.splitlines():
        if match := re.match(r"\s*movej\(\[(.*)\], a=(.*), v=(.*)\)$", line):
            yield "joints", numbers(match[1])
        elif match := re.match(r'\s*take_image\("(.*)"\)', line):
            yield "image", match[1]
        elif match := re.match(
            r'\s*popup\("Part in fixturing (.*?)\? At home the pendant shows ', line
        ):
            yield "fixturing", match[1]


def from_rapid(module):
    """Targets by their names, in rad."""
    targets = {
        match[1]: np.radians(numbers(match[2]))
        for match in re.finditer(r"CONST jointtarget (\w+):=\[\[(.*?)\],\[9E9", module)
    }
    for line in module.splitlines():
        if match := re.match(r"\s*MoveAbsJ (\w+),v1000\\T:=(.*),fine,tool0;", line):
            yield "joints", targets[match[1]]
        elif match := re.match(r'\s*TakeImage "(.*)";', line):
            yield "image", match[1]
        elif match := re.match(r'\s*UIMsgBox "Part in fixturing (.*?)\?"\\MsgLine2:=', line):
            yield "fixturing", match[1]


def from_krl(source):
    """Axis angles in rad; the first PTP of a round is to where the robot stands."""
    stands = False
    for line in source.splitlines():
        if match := re.match(r"PTP \{(.*)\}$", line):
            names, angles = zip(*(word.split() for word in match[1].split(",")), strict=True)
            assert names == ("A1", "A2", "A3", "A4", "A5", "A6")
            joints = np.radians([float(angle) for angle in angles])
            if stands:
                np.testing.assert_allclose(joints, HOME, atol=1e-7)
                stands = False
            else:
                yield "joints", joints
        elif match := re.match(r"; (setting_\d+\.png)$", line):
            yield "image", match[1]
        elif match := re.match(r"; Put the part in fixturing (.*), then", line):
            stands = True
            yield "fixturing", match[1]


def from_ros(data):
    for turn in json.loads(data)["rounds"]:
        yield "fixturing", turn["fixturing"]
        for step in turn["steps"]:
            if "image" in step:
                yield "image", step["image"]
                continue
            points = step["joint_trajectory"]["points"]
            for point in points[1:]:
                if not np.any(point["velocities"]):
                    yield "joints", np.array(point["positions"])


def from_csv(table):
    rows = csv.DictReader(line for line in io.StringIO(table) if not line.startswith("#"))
    for row in rows:
        joints = np.array([float(value) for name, value in row.items() if name.endswith("_rad")])
        if row["step"] == "start":
            np.testing.assert_allclose(joints, HOME, atol=1e-7)
            yield "fixturing", row["fixturing"]
            continue
        yield "joints", joints
        if row["image"]:
            assert row["image"] == f"setting_{int(row['setting']):02d}.png"
            yield "image", row["image"]


def from_fanuc(program):
    """Positions by their numbers, in rad; the first move of a round is to where the robot stands."""
    positions = fanuc_positions(program)
    remark = ""
    for line in fanuc_statements(program):
        if line.startswith("!"):
            remark = f"{remark} {line[1:].strip()}"
            continue
        if match := re.match(r"J P\[(\d+)\] (\d+)(%|msec)", line):
            joints = np.radians(positions[int(match[1])])
            if match[3] == "%":
                assert match[2] == "1"
                np.testing.assert_allclose(joints, HOME, atol=ROUNDED["fanuc"])
            else:
                yield "joints", joints
        elif match := re.match(r" Put the part in fixturing (.*), then start again", remark):
            yield "fixturing", match[1]
        elif match := re.fullmatch(r" (setting_\d+\.png)", remark):
            yield "image", match[1]
        remark = ""


PARSERS = {
    "fanuc": from_fanuc,
    "urscript": from_urscript,
    "rapid": from_rapid,
    "krl": from_krl,
    "ros": from_ros,
    "csv": from_csv,
}


def read_back(language):
    return list(PARSERS[language](text(language)))


@pytest.mark.parametrize("language", LANGUAGES)
def test_joints_lead_to_the_pose_of_the_image_that_is_taken_there(language):
    poses = reached_poses()
    images = []
    for kind, value in read_back(language):
        if kind == "fixturing":
            part2base = FIXTURINGS[value].part2base
        elif kind == "joints":
            joints = value
        else:
            k = int(re.fullmatch(r"setting_(\d+)\.png", value)[1]) - 1
            images.append(k)
            camera = np.linalg.inv(part2base) @ cell().robot.forward(joints) @ CAM2FLANGE
            # a lever of 1.5 m turns what is rounded into mm
            rounded = 1500.0 * len(HOME) * ROUNDED.get(language, 0.0)
            np.testing.assert_allclose(camera, poses[k], atol=2e-4 + rounded)
    assert sorted(images) == list(range(len(poses)))
    # the order of the round is not that of the plan, so names by place would be wrong
    assert images != sorted(images)


@pytest.mark.parametrize("language", LANGUAGES)
def test_all_rows_of_the_moves_are_there_and_the_round_ends_at_home(language):
    rows = [value for kind, value in read_back(language) if kind == "joints"]
    expected = [row for tour in program().tours for move in tour.moves for row in move.joints[1:]]
    rounded = ROUNDED.get(language, 0.0)
    np.testing.assert_allclose(rows, expected, atol=2e-8 + rounded)
    np.testing.assert_allclose(rows[-1], HOME, atol=1e-7 + rounded)


def unbroken(language, made=None):
    """Return a program, that of FANUC without the breaks of its short remarks."""
    made = program() if made is None else made
    written = program_text(made, language, signals=SIGNALS, made=DAY)
    if language != "fanuc":
        return written
    remarks = [line[2:] for line in fanuc_statements(written) if line.startswith("! ")]
    # a digest is broken where it is longer than a line
    return re.sub(r"(?<=[0-9a-f]{20}) (?=[0-9a-f]{9,})", "", " ".join(remarks))


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_head(language):
    written = unbroken(language)
    if language == "fanuc":
        written = re.sub(r"(?<=: [0-9a-f]{11}) (?=[0-9a-f]{31})", "", written)
    assert "2026-03-01" in written
    assert "Run at reduced speed first. Checked against the model of the cell only." in written
    for value in program().digests.values():
        assert value in written
    for name in ("shoulder_pan", "wrist_3"):
        assert name in written


def with_a_left_out_setting():
    """A program of a plan whose last setting is out of reach, and the plan."""
    poses = reached_poses()[:2]
    far = poses[:1].copy()
    far[:, :3, 3] += [5000.0, 0.0, 0.0]
    plan = plan_of(np.concatenate([poses, far]))
    return robot_program(plan, block(), cell()), plan


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_head_names_a_setting_that_is_left_out_and_the_digest_of_the_whole_plan(language):
    made, plan = with_a_left_out_setting()
    written = unbroken(language, made)
    assert re.search(r"Not reached: setting 3: beyond the arm.?s reach", written)
    if language == "fanuc":
        written = re.sub(r"(?<=: [0-9a-f]{11}) (?=[0-9a-f]{31})", "", written)
    assert made.digests["plan"] == plan.digest
    assert plan.digest in written
    # no image of it is taken
    assert "setting_02" in written
    assert "setting_03" not in written


def test_the_record_names_a_setting_that_is_left_out(tmp_path):
    made, plan = with_a_left_out_setting()
    path = write_program(made, tmp_path / "program.json")
    record = json.loads(path.read_text("utf-8"))
    assert record["unreached"] == {"3": "beyond the arm's reach"}
    assert record["digests"]["plan"] == plan.digest
    plan.write(tmp_path / "plan.json")
    assert hashlib.sha256((tmp_path / "plan.json").read_bytes()).hexdigest() == plan.digest
    again = read_program(path)
    assert again.unreached == made.unreached
    assert again.digests == made.digests
    assert not again.complete
    whole = robot_program(plan_of(reached_poses()[:2]), block(), cell())
    assert whole.digests["plan"] != made.digests["plan"]


def test_urscript_asks_unless_the_robot_stands_at_home_and_drives_there_first():
    script = text("urscript")
    home = re.search(r"home = \[(.*)\]", script)
    np.testing.assert_allclose(numbers(home[1]), HOME, atol=1e-8)
    for part in re.split(r"\n  # fixturing ", script)[1:]:
        assert part.index("go_home(home)") < part.index("movej")
    check = script[script.index("def go_home") : script.index("def take_image")]
    tolerance = program().start.tolerance_rad
    assert f"> {tolerance:g}:\n        is_far = True" in check
    # the operator answers for a way that is not checked, then the drive is slow
    assert re.search(r"if is_far:\s+popup\(.*not checked.*blocking=True\)\s+end\s+movej", check)
    speed = float(re.search(r"movej\(joints, a=.*, v=(.*)\)", check)[1])
    assert speed * cell().levers_mm.sum() <= 250.0


def test_urscript_rates_give_the_time_of_the_move():
    """The leading joint, from rest to rest at the rates in the program, by hand."""
    here = np.array(HOME)
    seconds = []
    for match in re.finditer(r"movej\(\[(.*)\], a=(.*), v=(.*)\)", text("urscript")):
        there = numbers(match[1])
        way = np.abs(there - here).max()
        a = float(match[2])
        v = float(match[3])
        seconds.append(way / v + v / a if way > v * v / a else 2 * np.sqrt(way / a))
        here = there
    assert sum(seconds) == pytest.approx(program().seconds, rel=1e-5)


def test_urscript_blocks_are_closed():
    depth = 0
    for line in text("urscript").splitlines():
        words = line.split("#")[0].strip()
        depth += bool(re.match(r"(def|while|if)\b.*:$", words))
        depth -= words == "end"
        assert depth >= 0
    assert depth == 0


def test_rapid_times_and_blocks():
    module = text("rapid")
    times = [float(t) for t in re.findall(r"\\T:=([\d.]+)", module)]
    assert sum(times) == pytest.approx(program().seconds, abs=0.01)
    for opening, closing in (("PROC ", "ENDPROC"), ("IF ", "ENDIF"), ("MODULE ", "ENDMODULE")):
        lines = [line.strip() for line in module.splitlines()]
        assert sum(line.startswith(opening) for line in lines) == lines.count(closing)
    for statement in re.findall(r"^ {4,8}\w.*$", module, re.MULTILINE):
        blocks = ("IF", "ELSEIF", "ENDIF", "WHILE", "ENDWHILE")
        is_block = statement.strip().startswith(blocks)
        assert is_block or statement.endswith(";")
    main = module[module.index("PROC main") :]
    assert main.index("GoHome;") < main.index("MoveAbsJ")
    limits = re.findall(r"Abs\(now\.robax\.rax_(\d)-jHome\.robax\.rax_\1\)>([\d.]+) THEN", module)
    assert [int(axis) for axis, _ in limits] == [1, 2, 3, 4, 5, 6]
    # rounded down: what the program lets pass is within what is proven
    proven = np.degrees(program().start.tolerance_rad)
    assert all(proven - 1e-4 <= float(limit) <= proven for _, limit in limits)
    ask = module[module.index("PROC GoHome") : module.index("PROC TakeImage")]
    assert re.search(r"IF answer<>resOK THEN\s+EXIT;", ask)
    assert ask.index("EXIT;") < ask.index("MoveAbsJ jHome,vHome,fine,tool0;")
    assert all(len(name) <= 32 for name in re.findall(r"jointtarget (\w+):=", module))


def test_krl_asks_for_home_before_each_round():
    source = text("krl")
    for part in source.split("; Put the part in fixturing")[1:]:
        check, _, rest = part[part.index("IF ") :].partition("ENDIF")
        assert "HALT" in check
        found = re.findall(r"\$AXIS_ACT\.A\d-\(([-\d.]+)\)\)>([\d.]+)\)", check)
        np.testing.assert_allclose(np.radians([float(a) for a, _ in found]), HOME, atol=1e-7)
        proven = np.degrees(program().start.tolerance_rad)
        assert all(proven - 1e-4 <= float(limit) <= proven for _, limit in found)
        # the first move is the slow one to home
        assert re.search(r"\$VEL_AXIS\[i\]=(\d+)", rest)[1] == "1"
        assert rest.index("$VEL_AXIS[i]=1\n") < rest.index("PTP") < rest.index("$VEL_AXIS[i]=50")
    assert source.count("DEF ") == 2
    assert source.rstrip().endswith("END")
    assert "$VEL_AXIS[i]=50" in source


def run_image(language, world, **options):
    """Take one image by the program of a controller."""
    if language == "rapid":
        run_rapid_image(text("rapid"), world, **options)
    elif language == "krl":
        run_krl_image(text("krl"), world)
    elif language == "fanuc":
        run_fanuc_image(text("fanuc"), world)
    else:
        lines = text("urscript").splitlines()
        first = lines.index("  def take_image(name):")
        last = lines.index("  end", first)
        called = ["def inspection():", *lines[first : last + 1], '  take_image("image")', "end"]
        run_urscript("\n".join(called), world)


CONTROLLERS = ("urscript", "rapid", "krl", "fanuc")


@pytest.mark.parametrize("language", CONTROLLERS)
@pytest.mark.parametrize(
    ("rises", "falls"), [(0.05, 0.12), (0.05, 9.0), (0.5, 0.6), (3.0, 9.0)], ids=str
)
def test_an_answer_is_the_rise_after_the_trigger(language, rises, falls):
    """Also one that is over before the trigger falls."""
    world = World(lambda t: rises <= t < falls)
    run_image(language, world)
    assert world.said == []
    # polled each 12 ms
    assert world.pulses == pytest.approx([0.2], abs=0.013)
    assert 0.7 + max(rises, 0.0) <= world.now <= 0.7 + max(rises, 0.2) + 0.03


@pytest.mark.parametrize("language", CONTROLLERS)
def test_the_answer_to_the_image_before_is_none(language):
    """It is waited for to fall; no trigger is given meanwhile."""
    world = World(lambda t: True, at_start=True)
    with pytest.raises(Stopped):
        run_image(language, world)
    assert all("still says that an image is taken" in words for words in world.said)
    assert world.pulses == []


@pytest.mark.parametrize("language", CONTROLLERS)
def test_a_silent_camera_is_told_after_the_timeout_and_asked_again(language):
    world = World(lambda t: False)
    with pytest.raises(Stopped):
        run_image(language, world)
    assert all("does not answer" in words for words in world.said)
    count = POPUPS_BEFORE_STOP + 1
    assert world.pulses == pytest.approx([0.2] * count, abs=0.013)
    # 0.7 s once, then 4 s for each answer
    assert world.now == pytest.approx(0.7 + 4.0 * count, rel=0.02)


@pytest.mark.parametrize("language", CONTROLLERS)
def test_a_camera_that_answers_the_second_trigger_is_taken(language):
    world = World(None)
    world.camera = lambda t: bool(world.said) and 0.3 <= t < 0.5
    run_image(language, world)
    assert len(world.said) == 1
    assert len(world.pulses) == 2


def test_who_cancels_in_rapid_stops_the_program():
    with pytest.raises(Stopped):
        run_image("rapid", world := World(lambda t: False), answer="resCancel")
    assert len(world.said) == 1


def test_an_urscript_runs_as_a_whole():
    """By an interpreter of its own: the moves, the images between them, and home at both ends."""
    world = World(lambda t: 0.05 <= t < 0.12, position=list(HOME))
    run_urscript(text("urscript"), world)
    assert world.said == []
    assert len(world.pulses) == len(program().tours[0].stops) + len(program().tours[1].stops)
    steps = read_back("urscript")
    joints = [value for kind, value in steps if kind == "joints"]
    # each round begins with a move to home, where the robot stands
    moved = [move for move in world.moves if not np.allclose(move, HOME)]
    np.testing.assert_allclose(moved, [q for q in joints if not np.allclose(q, HOME)])
    taken = [name for name in world.images if name]
    assert taken == [value for kind, value in steps if kind == "image"]


def test_a_program_of_fanuc_runs_as_a_whole():
    """By an interpreter of its own, from home and from elsewhere."""
    for start, is_far in (
        (list(HOME), False),
        ([0.1, *HOME[1:]], True),
        ([*HOME[:5], -0.02], True),
    ):
        world = World(lambda t: 0.05 <= t < 0.15, position=start)
        run_fanuc(fanuc_statements(text("fanuc")), fanuc_positions(text("fanuc")), world)
        assert world.said == []
        steps = read_back("fanuc")
        joints = [value for kind, value in steps if kind == "joints"]
        # each round begins with a slow move to home
        assert len(world.moves) == len(joints) + len(program().tours)
        moved = [move for move in world.moves if not np.allclose(move, HOME, atol=1e-5)]
        np.testing.assert_allclose(
            moved, [q for q in joints if not np.allclose(q, HOME, atol=1e-5)], atol=1e-9
        )
        taken = [name for name in world.images if not name.startswith("(")]
        assert taken == [value for kind, value in steps if kind == "image"]
        assert len(world.pulses) == len(taken)
        assert (world.images.count("(Not at home)") == 1) is is_far
        # moves, waits of 0.7 s and answers after 0.05 s
        seconds = program().seconds + 0.75 * len(taken)
        assert world.now == pytest.approx(seconds, abs=0.02 * len(world.moves))


def test_times_that_fanuc_cannot_wait_are_refused():
    for name, value in (("timeout_s", 328.0), ("pulse_s", 25.6), ("settle_s", 327.68)):
        with pytest.raises(RequestError, match=f"{name} must be at most .* s for fanuc"):
            program_text(program(), "fanuc", signals=CameraSignals(**{name: value}))
    short = CameraSignals(settle_s=0.001, pulse_s=0.001, timeout_s=0.001)
    written = program_text(program(), "fanuc", signals=short)
    assert "WAIT    .01(sec)" in written
    assert "PULSE,0.1sec" in written
    assert "$WAITTMOUT=1 " in written
    assert "(sec)" not in program_text(program(), "fanuc", signals=CameraSignals(settle_s=0.0))


@pytest.mark.parametrize(
    ("language", "least", "most"), [("urscript", 0, 7), ("krl", 1, 4096), ("fanuc", 1, 4096)]
)
def test_signals_that_a_controller_has_not_are_refused(language, least, most):
    for number in (least - 1, most + 1):
        if not 0 <= number <= 4096:
            continue
        for name in ("trigger_output", "ready_input"):
            with pytest.raises(RequestError, match=f"{name} must be from .* for {language}"):
                program_text(program(), language, signals=CameraSignals(**{name: number}))
    for number in (least, most):
        signals = CameraSignals(trigger_output=number, ready_input=number)
        assert program_text(program(), language, signals=signals)


@pytest.mark.parametrize(
    ("language", "wanted"),
    [
        ("ros", ['"settle_s": 0.7', '"trigger_s": 0.2', '"wait_for_camera_s": 4.0']),
        ("csv", ["# At each image: wait 0.7 s. Wait until input 5 is low, then raise output 3"]),
        ("ros", ["Wait until the input rises, for at most 4 s. If it does not, stop."]),
    ],
)
def test_what_a_driver_does_at_each_image(language, wanted):
    for words in wanted:
        assert words in text(language)


def test_an_answer_is_waited_for_at_least_as_long_as_the_trigger_lasts():
    assert CameraSignals(pulse_s=5.0, timeout_s=2.0).longest_s == 5.0


SHOWN = {
    "urscript": (rf"X ({N}), Y ({N}), Z ({N}) mm, RX ({N}), RY ({N}), RZ ({N}) rad", "vector"),
    "krl": (rf"X ({N}), Y ({N}), Z ({N}) mm, A ({N}), B ({N}), C ({N}) degrees", "euler"),
    "fanuc": (rf"X ({N}), Y ({N}), Z ({N}) mm, W ({N}), P ({N}), R ({N}) degrees", "fixed"),
    "rapid": (rf"x ({N}), y ({N}), z ({N}) mm, quaternion w ({N}), x ({N}), y ({N}), z ({N})", ""),
    "csv": (rf"x ({N}), y ({N}), z ({N}) mm, quaternion w ({N}), x ({N}), y ({N}), z ({N})", ""),
}


def shown_poses(language, made):
    """Return the poses that the head names: home, and the first setting."""
    pattern, kind = SHOWN[language]
    head = unbroken(language, made)
    for match in list(re.finditer(rf"(?:home|setting \d+): {pattern}", head)):
        values = [float(word) for word in match.groups()]
        if kind == "vector":
            turn = Rotation.from_rotvec(values[3:])
        elif kind == "fixed":
            w, p, r = np.radians(values[3:])
            about_z = Rotation.from_rotvec([0, 0, r])
            turn = about_z * Rotation.from_rotvec([0, p, 0]) * Rotation.from_rotvec([w, 0, 0])
        elif kind == "euler":
            a, b, c = np.radians(values[3:])
            about_z = Rotation.from_rotvec([0, 0, a])
            turn = about_z * Rotation.from_rotvec([0, b, 0]) * Rotation.from_rotvec([c, 0, 0])
        else:
            turn = Rotation.from_quat([*values[4:], values[3]])
        result = np.eye(4)
        result[:3, :3] = turn.as_matrix()
        result[:3, 3] = values[:3]
        yield result


@pytest.mark.parametrize("language", SHOWN)
def test_the_head_names_poses_as_the_pendant_shows_them(language):
    """Home and the first setting; where the URDF has a link ``base``, in its frame."""
    robot = cell().robot
    first = program().tours[0].stops[0].joints
    expected = [robot.forward(HOME), robot.forward(first)]
    turned = np.diag([-1.0, -1.0, 1.0, 1.0])
    turned[:3, 3] = [0.0, 0.0, 12.0]
    for made, frame in (
        (program(), np.eye(4)),
        (replace(program(), pendant=turned), np.linalg.inv(turned)),
    ):
        poses = list(shown_poses(language, made))
        assert len(poses) == 2
        for pose, told in zip(expected, poses, strict=True):
            np.testing.assert_allclose(told[:3, 3], (frame @ pose)[:3, 3], atol=0.006)
            np.testing.assert_allclose(told[:3, :3], (frame @ pose)[:3, :3], atol=1e-4)


def test_who_starts_a_round_is_told_what_the_pendant_shows_at_home():
    x, y, z = cell().robot.forward(HOME)[:3, 3]
    words = f"X {x:.2f}, Y {y:.2f}, Z {z:.2f} mm, RX"
    (told, *_) = re.findall(r'popup\("Part in fixturing .*?", title', text("urscript"))
    assert f"At home the pendant shows {words}" in told
    assert f"; At home the pendant shows {words[:-4]}" in text("krl")
    lines = re.findall(r'\\MsgLine\d:="(.*?)"', text("rapid"))
    # what FlexPendant shows of a line
    assert all(len(line) <= 55 for line in lines)
    silent = replace(program(), home_flange=None)
    assert "At home" not in program_text(silent, "rapid", signals=SIGNALS, made=DAY)


def test_ros_points_are_those_of_cubic_splines():
    """Between points, the cubic through places and speeds has one acceleration: the trapezoid itself."""
    rates = program().rates
    for turn in json.loads(text("ros"))["rounds"]:
        for step in turn["steps"]:
            if "image" in step:
                continue
            points = step["joint_trajectory"]["points"]
            times = [
                p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"] for p in points
            ]
            for k in range(len(points) - 1):
                dt = times[k + 1] - times[k]
                if dt < 1e-6:
                    continue
                p0, p1 = (np.array(points[k + i]["positions"]) for i in (0, 1))
                v0, v1 = (np.array(points[k + i]["velocities"]) for i in (0, 1))
                # the third derivative of the cubic Hermite spline
                jerk = (6 * (v0 + v1) - 12 * (p1 - p0) / dt) / dt**2
                assert np.abs(jerk * dt).max() < 1e-4
                assert (np.abs(v1) <= rates.speeds * (1 + 1e-9)).all()
                assert (np.abs((v1 - v0) / dt) <= rates.accelerations * (1 + 1e-6)).all()


@pytest.mark.parametrize(
    ("name", "expected"),
    [('a"b\nc', "a_b_c"), ("größe", "gr__e"), ("x" * 80, "x" * 57 + "..."), ("up (1)", "up (1)")],
)
def test_names_cannot_break_a_program(name, expected):
    assert plain(name) == expected


@pytest.mark.parametrize("language", FORMATS)
def test_files_by_format(language, tmp_path):
    path = write_program(program(), tmp_path / FORMATS[language], format=language)
    assert path.read_text(encoding="utf-8") == program_text(program(), language)


@pytest.mark.parametrize(
    ("name", "language"),
    [
        ("a.script", "urscript"),
        ("a.MOD", "rapid"),
        ("inspection.src", "krl"),
        ("inspection.ls", "fanuc"),
        ("a.csv", "csv"),
        ("a.json", "json"),
    ],
)
def test_files_by_suffix(name, language, tmp_path):
    path = write_program(program(), tmp_path / name)
    assert path.read_text(encoding="utf-8") == program_text(program(), language)


@pytest.mark.parametrize(
    ("name", "language", "got"),
    [
        ("a.src", "rapid", r"must end in \.mod for rapid: \.src is that of krl"),
        ("a.csv", "urscript", r"must end in \.script for urscript"),
    ],
)
def test_a_file_has_the_suffix_of_its_language(name, language, got, tmp_path):
    """A controller takes the language from it, and one program would replace that of another."""
    with pytest.raises(RequestError, match=got):
        write_program(program(), tmp_path / name, format=language)
    assert not (tmp_path / name).exists()


def test_bad_input(tmp_path):
    with pytest.raises(RequestError, match="format must be one of urscript, rapid"):
        program_text(program(), "karel")
    with pytest.raises(RequestError, match="program must be a RobotProgram"):
        program_text(plan_of(reached_poses()[:1]), "csv")
    with pytest.raises(RequestError, match=r"path must end in \.script"):
        write_program(program(), tmp_path / "a.jbi")
    with pytest.raises(OutputError):
        write_program(program(), tmp_path / "none" / "a.csv")
    with pytest.raises(RequestError, match="settle_s must be finite"):
        CameraSignals(settle_s=-1.0)
    with pytest.raises(RequestError, match="trigger_output must be an integer"):
        CameraSignals(trigger_output=1.5)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("settle_s", 1e300),
        ("settle_s", 3600.1),
        ("settle_s", 1e-300),
        ("settle_s", 0.0009),
        ("pulse_s", 0.0),
        ("pulse_s", 2001.0),
        ("timeout_s", 0.0),
        ("timeout_s", 1e9),
    ],
)
def test_times_that_no_controller_can_wait_are_refused(name, value):
    with pytest.raises(RequestError, match=rf"{name} must be .*from 0\.001 to \d+ s\. Got"):
        CameraSignals(**{name: value})


@pytest.mark.parametrize("value", [float("nan"), float("inf"), "1"])
def test_times_are_finite_numbers(value):
    with pytest.raises(RequestError, match="settle_s must be finite and not negative"):
        CameraSignals(settle_s=value)


@pytest.mark.parametrize("language", [name for name in LANGUAGES if name != "fanuc"])
def test_times_are_written_without_an_exponent(language):
    signals = CameraSignals(settle_s=0.001, pulse_s=2000.0, timeout_s=3600.0)
    written = program_text(program(), language, signals=signals)
    assert not re.search(r"(?:sleep\(|InPos,|WAIT SEC |PLength:=|> )\d+(?:\.\d+)?e", written)


def slower(share):
    """The same moves at a share of the speeds; the writers only read their rates."""
    rates = program().rates
    return replace(
        program(), speed=share, rates=JointRates(rates.speeds * share, rates.accelerations)
    )


@pytest.mark.parametrize(
    ("language", "share", "least"),
    [
        ("krl", 0.0099, 0.01),
        *((name, 0.0009, 0.001) for name in ("urscript", "rapid", "fanuc", "csv", "ros")),
    ],
)
def test_speeds_that_a_language_cannot_say_are_refused(language, share, least):
    with pytest.raises(RequestError, match=f"speed must be at least {least:g} for {language}"):
        program_text(slower(share), language)
    assert program_text(slower(least), language)


def test_krl_never_drives_faster_than_asked():
    for share, percent in ((0.01, 1), (0.019, 1), (0.29, 29), (1.0, 100)):
        assert f"$VEL_AXIS[i]={percent}\n" in program_text(slower(share), "krl").split("PTP")[1]


def test_urscript_writes_slow_rates_exactly():
    """By the rule that times follow from the rates in the text, at the least speed as well."""
    slow = slower(0.001)
    here = np.array(HOME)
    for match in re.finditer(r"movej\(\[(.*)\], a=(.*), v=(.*)\)", program_text(slow, "urscript")):
        there = numbers(match[1])
        way = np.abs(there - here).max()
        seconds = way / float(match[3]) + float(match[3]) / float(match[2])
        wanted = move_times(here, there, slow.rates)
        assert seconds == pytest.approx(wanted, rel=1e-5)
        here = there


def test_urscript_refuses_rates_of_nothing():
    tiny = replace(
        program(), rates=JointRates(program().rates.speeds * 1e-9, program().rates.accelerations)
    )
    with pytest.raises(RequestError, match=r"speed must be at least 0\.0001 for the slowest joint"):
        program_text(tiny, "urscript")


def test_files_without_a_check_of_home_say_so():
    for language in ("csv", "ros"):
        assert "This file does not check where the robot stands" in text(language)
    start = json.loads(text("ros"))["start_at"]
    assert start["tolerance"] == program().start.tolerance_rad
