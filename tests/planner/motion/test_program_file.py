"""A program comes back from its file, and a file that contradicts itself is refused by the name of the field."""

import copy
import json

import numpy as np
import pytest
from robot_programs import program

from planner import PlanFileError, program_text, read_program, write_program
from planner.robotprogram.program import program_of


@pytest.fixture(scope="module")
def record():
    return json.loads(json.dumps(program().to_dict()))


def test_a_program_comes_back_from_its_file(tmp_path):
    path = write_program(program(), tmp_path / "program.json")
    again = read_program(path)
    assert again.to_dict() == program().to_dict()
    assert program_text(again, "rapid") == program_text(program(), "rapid")
    assert program_text(again, "urscript") == program_text(program(), "urscript")
    for one, other in zip(again.tours, program().tours, strict=True):
        for stop, before in zip(one.stops, other.stops, strict=True):
            assert stop.simulated == before.simulated
            np.testing.assert_array_equal(stop.joints, before.joints)


def changed(record, path, value):
    data = copy.deepcopy(record)
    *way, last = path.split(".")
    inside = data
    for key in way:
        inside = inside[int(key) if isinstance(inside, list) else key]
    inside[int(last) if isinstance(inside, list) else last] = value
    return data


STOP = "tours.0.stops.0"
STOPPED = r"tours\[0\].stops\[0\]"


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("format", "plan", 'format must be "aspectgraph robot program". Got "plan"'),
        ("version", True, "version must be 2. Got true"),
        ("version", 1, "version must be 2. Got 1."),
        (
            "start.tolerance_rad",
            0.02,
            "start.tolerance_rad must be above 0 and at most 0.01. Got 0.02",
        ),
        ("start.tolerance_rad", 0.0, "start.tolerance_rad must be above 0"),
        ("start.speed", 0.0, "start.speed must be positive"),
        ("coupled", [[3, 3, 1.0]], "coupled must name another joint, from 1 to 6. Got"),
        ("coupled", "3", "coupled must be an array. Got"),
        ("axis_limits", [[1, 3.0, 3.1]], "axis_limits must hold all joints of the moves"),
        ("home", [0.0] * 5, "home must have 6 numbers. Got 5"),
        ("home.0", 0.5, r"tours\[0\].stops\[0\].move.joints must begin where the last move ended"),
        ("speed", 0, "speed must be above 0 and at most 1. Got 0"),
        ("rates.speeds.1", -1.0, r"rates.speeds\[1\] must be above 0. Got -1.0"),
        ("rates.speeds.0", "fast", r"rates.speeds\[0\] must be a number"),
        ("seconds", 1.0, "seconds must be .*, as the other fields say. Got 1.0"),
        ("tours.0.seconds", 1.0, r"tours\[0\].seconds must be .*, as the other fields say"),
        (f"{STOP}.setting", 0, rf"{STOPPED}.setting must be an integer from 1. Got 0"),
        (f"{STOP}.joints", [0.0] * 6, rf"{STOPPED}.joints must be .*, as the other"),
        (f"{STOP}.move.seconds", 9.0, r"tours\[0\].seconds must be .*, as the other fields say"),
        (f"{STOP}.move.joints", [[0.0] * 6], rf"{STOPPED}.move.joints must hold two rows"),
        (f"{STOP}.flange", [[1.0]], rf"{STOPPED}.flange must have the shape \(4, 4"),
        (f"{STOP}.arm.closest", ["a"], rf"{STOPPED}.arm.closest must be two names"),
        (f"{STOP}.probability.near", 1.5, rf"{STOPPED}.probability.near must be from 0 to 1"),
        (f"{STOP}.simulated.near.low", 1.0, rf"{STOPPED}.simulated.near.low must be at most"),
        (f"{STOP}.simulated.near.n", 5, rf"{STOPPED}.simulated.near.n must be all displaced poses"),
        ("tours.0.stops", [], r"tours\[0\].stops must hold a stop"),
        ("tours.0.back.joints.1.0", 0.1, r"tours\[0\].back.seconds must be the time of the moves"),
        ("tours.0.turntable", {"speeds": [1]}, r"tours\[0\].turntable.accelerations must be given"),
        ("unreached", {"0": "far"}, "unreached must have whole numbers from 1 as keys"),
        ("unreached", {"1": "far"}, "unreached must hold settings that are not visited. Got 1"),
        ("tours.1.stops.0.setting", 4, "must visit each setting once. Got 'setting 4 again'"),
        ("warnings", [1], r"warnings\[0\] must be text. Got 1"),
        ("colour", "red", "colour must be one of format, .* Got an unknown field"),
        ("keep_mm", None, "keep_mm must be a number. Got null"),
    ],
)
def test_a_file_that_contradicts_itself_is_refused(record, path, value, message):
    with pytest.raises(PlanFileError, match=message):
        program_of(changed(record, path, value))


def test_an_error_names_the_file(tmp_path):
    path = tmp_path / "program.json"
    path.write_text("{}", "utf-8")
    with pytest.raises(PlanFileError, match=r"program.json: format must be"):
        read_program(path)
    path.write_text("[", "utf-8")
    with pytest.raises(PlanFileError, match="program file must be JSON"):
        read_program(path)
