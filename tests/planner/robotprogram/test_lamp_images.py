"""A setting with several lamps: each program takes one image per lamp, named as `measure` asks for it."""

import csv
import io
import json
import re
from dataclasses import replace
from datetime import date
from functools import cache

import numpy as np
import pytest
from controllers import World, fanuc_positions, fanuc_statements, run_fanuc, run_urscript
from robot_programs import HOME, block, cell, plan_of, reached_poses

from planner import (
    LightPlan,
    LitImage,
    PlanFileError,
    program_text,
    read_poses,
    read_program,
    robot_program,
    write_program,
)
from planner.measuring.images import shots_of
from planner.robotprogram.program import program_of
from planner.robotprogram.program_texts import FORMATS

DAY = date(2026, 3, 1)
LANGUAGES = tuple(FORMATS)
LAMPS = np.array([[40.0, -300.0, 500.0], [300.0, 25.0, 90.0], [0.0, 0.0, 700.0]])
ONE = (LitImage((0,), {"near": 0.5, "far": 0.5}),)
# the second image has two lamps on
TWO = (LitImage((1,), {"near": 0.5}), LitImage((0, 2), {"far": 0.5}))
# by setting, the lamps of its images as tables count them
EXPECTED = {
    "setting_01.png": (),
    "setting_02_1.png": (2,),
    "setting_02_2.png": (1, 3),
    "setting_03.png": (),
}
REMARK = r"(setting_\d+(?:_\d+)?\.png)(?:: lamps? ([\d, ]+) on)?"


def lit_plan(*images):
    plan = plan_of(reached_poses()[: len(images)])
    light = LightPlan("placed", 0.1, 0.05, "dark", LAMPS, images, ({},) * len(images), 1, "by hand")
    return replace(plan, light=light)


@cache
def lamp_program():
    return robot_program(lit_plan(ONE, TWO, ONE), block(), cell())


def text(language, made=None):
    return program_text(lamp_program() if made is None else made, language, made=DAY)


def lamps_in(words):
    return tuple(map(int, re.findall(r"\d+", words or "")))


def from_calls(program, sign, call):
    """Images of calls, with the lamps of the comment in the line before."""
    remark = None
    for line in program.splitlines():
        if match := re.fullmatch(rf'\s*{call} ?\(?"(.*?)"\)?;?', line):
            if remark:
                assert remark[1] == match[1]
            yield match[1], lamps_in(remark and remark[2])
        remark = re.fullmatch(rf"\s*{sign} {REMARK}", line)


def from_krl(program):
    for match in re.finditer(rf"^; {REMARK}\ntake_image\( \)$", program, re.MULTILINE):
        yield match[1], lamps_in(match[2])
    assert program.count("\ntake_image( )") == len(re.findall(r"^; setting_", program, re.M))


def from_fanuc(program):
    remark = ""
    for line in fanuc_statements(program):
        if line.startswith("!"):
            remark = f"{remark} {line[1:].strip()}".strip()
            continue
        if match := re.fullmatch(REMARK, remark):
            yield match[1], lamps_in(match[2])
        remark = ""


def from_ros(program):
    for tour in json.loads(program)["rounds"]:
        for step in tour["steps"]:
            if "image" in step:
                assert f"{step['trigger']}.png" == step["image"]
                yield step["image"], tuple(step.get("lamps", ()))


def from_csv(program):
    rows = csv.DictReader(line for line in io.StringIO(program) if not line.startswith("#"))
    for row in rows:
        if row["step"] == "image":
            yield row["image"], lamps_in(row["lamps"])


def from_json(program):
    for tour in json.loads(program)["tours"]:
        for stop in tour["stops"]:
            alone = [{"image": f"setting_{stop['setting']:02d}.png", "lamps": []}]
            for image in stop.get("images", alone):
                yield image["image"], tuple(image["lamps"])


READERS = {
    "urscript": lambda program: from_calls(program, "#", "take_image"),
    "rapid": lambda program: from_calls(program, "!", "TakeImage"),
    "krl": from_krl,
    "fanuc": from_fanuc,
    "ros": from_ros,
    "csv": from_csv,
    "json": from_json,
}


@pytest.mark.parametrize("language", LANGUAGES)
def test_each_lamp_has_its_image_with_the_name_that_measure_asks_for(language):
    taken = list(READERS[language](text(language)))
    asked = [f"{shot.name}.png" for shot in shots_of(lit_plan(ONE, TWO, ONE))]
    assert sorted(name for name, _ in taken) == asked
    assert dict(taken) == EXPECTED
    # the lamps of a setting follow each other, in their order
    names = [name for name, _ in taken]
    assert names.index("setting_02_2.png") == names.index("setting_02_1.png") + 1


@pytest.mark.parametrize("language", [name for name in LANGUAGES if name != "json"])
def test_the_head_says_that_lamps_are_switched_elsewhere(language):
    words = "This program switches no lamps."
    written = text(language)
    if language == "fanuc":
        written = " ".join(line[2:] for line in fanuc_statements(written) if line[0] == "!")
    assert words in written


@pytest.mark.parametrize("language", LANGUAGES)
def test_one_lamp_image_in_each_setting_gives_the_program_without_lamps(language):
    poses = reached_poses()[:2]
    dark = robot_program(plan_of(poses), block(), cell())
    lit = robot_program(lit_plan(ONE, ONE), block(), cell())
    assert lit.digests["plan"] != dark.digests["plan"]
    # all else is the same, to the last character
    written = text(language, replace(lit, digests=dark.digests))
    assert written == text(language, dark)
    assert "lamp" not in written


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_setting_of_several_images_is_read_as_one_pose(language, tmp_path):
    path = write_program(lamp_program(), tmp_path / FORMATS[language])
    poses = read_poses(path, cell=cell()).poses
    order = [stop.setting_idx for tour in lamp_program().tours for stop in tour.stops]
    assert [pose.name for pose in poses] == [f"setting_{k + 1:02d}" for k in order]
    for k, pose in zip(order, poses, strict=True):
        # FANUC rounds axes to 0.0005 degrees
        np.testing.assert_allclose(pose.cam2world, reached_poses()[k], atol=0.1)


def test_programs_with_lamps_run_as_a_whole():
    for run in (
        lambda world: run_urscript(text("urscript"), world),
        lambda world: run_fanuc(
            fanuc_statements(text("fanuc")), fanuc_positions(text("fanuc")), world
        ),
    ):
        world = World(lambda t: 0.05 <= t < 0.15, position=list(HOME))
        run(world)
        taken = [name for name in world.images if name.startswith("setting")]
        assert sorted(taken) == list(EXPECTED)
        assert world.said == []
        assert len(world.pulses) == len(EXPECTED)


def test_a_further_image_has_a_row_without_a_move():
    rows = [line.split(",") for line in text("csv").splitlines() if line[0] != "#"]
    first, second = (
        next(row for row in rows if name in row)
        for name in ("setting_02_1.png", "setting_02_2.png")
    )
    assert float(first[2]) > 0.0
    assert second[2] == "0.000"
    assert second[6:] == first[6:]
    assert {len(row) for row in rows} == {len(first)}


def test_the_record_comes_back_and_refuses_a_wrong_name(tmp_path):
    path = write_program(lamp_program(), tmp_path / "program.json")
    assert read_program(path) == lamp_program()
    data = lamp_program().to_dict()
    stop = next(s for tour in data["tours"] for s in tour["stops"] if "images" in s)
    stop["images"][1]["image"] = "setting_02.png"
    with pytest.raises(PlanFileError, match=r"images\[1\].image must be setting_02_2.png"):
        program_of(data)


def test_a_notebook_lists_the_lamps_of_each_image():
    html = lamp_program()._repr_html_()
    assert (
        "<li>setting 2 takes: setting_02_1.png: lamp 2 on; setting_02_2.png: lamps 1, 3 on</li>"
        in html
    )
    assert html.count(" takes: ") == 1
    # nothing is said of a probability that is not known
    assert "smallest P" not in html
