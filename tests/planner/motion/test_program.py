"""Times of joint moves; a program comes back from its file, and what contradicts itself is refused."""

import copy
import json
from dataclasses import replace

import numpy as np
import pytest
from robot_programs import program

from planner import PlanFileError, program_text, read_program, write_program
from planner.robotprogram.program import JointRates, leading_axis, move_times, profile, program_of

RATES = JointRates(np.array([1.0, 2.0]), np.array([4.0, 1.0]))


@pytest.mark.parametrize(
    ("turn", "expected"),
    [
        # 1/4 s up and 1/4 s down, which turns 1/4 rad; 2.75 rad at 1 rad/s
        ([3.0, 0.0], 3.25),
        # too short for full speed: half the way, 0.08 rad, takes sqrt(2 * 0.08 / 4) s
        ([0.16, 0.0], 0.4),
        # the second joint alone: 2 s up, 2 s down, which turns 4 rad; 2 rad at 2 rad/s
        ([0.0, 6.0], 5.0),
        ([0.0, -1.0], 2.0),
        ([0.0, 0.0], 0.0),
        # full speed reached just at half the way
        ([0.25, 0.0], 0.5),
    ],
)
def test_triangles_and_trapezoids(turn, expected):
    assert move_times(np.zeros(2), np.array(turn), RATES) == pytest.approx(expected, rel=1e-12)


def test_a_joint_that_only_follows_costs_nothing():
    assert move_times(np.zeros(2), np.array([3.0, 0.01]), RATES) == pytest.approx(3.25)


def simulated_time(start, end, rates, steps=200_000):
    """Drive along the line with the largest speed that still lets the robot stop, step by step."""
    turn = np.abs(end - start)
    with np.errstate(divide="ignore"):
        speed = (rates.speeds / turn).min()
        acceleration = (rates.accelerations / turn).min()
    place = (np.arange(steps) + 0.5) / steps
    reached = np.minimum(np.sqrt(2 * acceleration * np.minimum(place, 1 - place)), speed)
    return (1 / reached).sum() / steps


def test_equal_to_a_drive_along_the_line():
    rng = np.random.default_rng(5)
    rates = JointRates(np.array([2.1, 2.1, 3.1, 3.1, 3.1, 3.1]), np.array([3.0, 3, 3, 8, 8, 8]))
    for _ in range(20):
        start = rng.uniform(-3, 3, 6)
        end = start + rng.uniform(-1, 1, 6) * rng.choice([0.05, 1.0, 3.0])
        expected = simulated_time(start, end, rates)
        assert move_times(start, end, rates) == pytest.approx(expected, rel=2e-3)


def test_the_leading_axis_takes_the_same_time():
    """A controller that knows one joint's rates must need the time of the whole move."""
    rng = np.random.default_rng(6)
    for _ in range(50):
        start = rng.uniform(-3, 3, 2)
        end = rng.uniform(-3, 3, 2)
        lead = leading_axis(start, end, RATES)
        joint = JointRates(np.array([lead.speed]), np.array([lead.acceleration]))
        farthest = np.abs(end - start).max()
        alone = move_times(np.zeros(1), np.array([farthest]), joint)
        assert alone == pytest.approx(move_times(start, end, RATES), rel=1e-12)
        followers = np.abs(end - start) / farthest
        assert (followers * lead.speed <= RATES.speeds * (1 + 1e-12)).all()
        assert (followers * lead.acceleration <= RATES.accelerations * (1 + 1e-12)).all()


def test_as_ruckig_without_a_limit_on_jerk():
    ruckig = pytest.importorskip("ruckig")
    rng = np.random.default_rng(7)
    # every joint alike, so that one joint leads in speed and in acceleration
    rates = JointRates(np.full(6, 2.0), np.full(6, 3.0))
    otg = ruckig.Ruckig(6)
    for _ in range(20):
        given = ruckig.InputParameter(6)
        given.current_position = rng.uniform(-2, 2, 6).tolist()
        given.target_position = rng.uniform(-2, 2, 6).tolist()
        given.max_velocity = rates.speeds.tolist()
        given.max_acceleration = rates.accelerations.tolist()
        given.max_jerk = [1e9] * 6
        trajectory = ruckig.Trajectory(6)
        otg.calculate(given, trajectory)
        start = np.array(given.current_position)
        end = np.array(given.target_position)
        assert move_times(start, end, rates) == pytest.approx(trajectory.duration, abs=1e-3)


@pytest.mark.parametrize("turn", [[3.0, 0.5], [0.16, 0.1], [0.0, -6.0], [0.25, 0.0]])
def test_the_profile_follows_from_its_accelerations(turn):
    """Integrated between its instants, the speed gives the way; no joint exceeds its rates."""
    turn = np.array(turn)
    found = profile(np.zeros(2), turn, RATES)
    pieces = np.diff(found.seconds)
    assert found.seconds[-1] == pytest.approx(move_times(np.zeros(2), turn, RATES))
    means = (found.rates[1:] + found.rates[:-1]) / 2
    driven = np.concatenate([[0.0], np.cumsum(means * pieces)])
    assert driven == pytest.approx(found.shares)
    assert driven[-1] == pytest.approx(1.0)
    speeds = np.abs(turn) * found.rates[:, None]
    assert (speeds <= RATES.speeds * (1 + 1e-9)).all()
    real = pieces > 0
    grown = np.abs(np.diff(found.rates))[real] / pieces[real]
    assert (np.abs(turn) * grown[:, None] <= RATES.accelerations * (1 + 1e-9)).all()


@pytest.fixture(scope="module")
def record():
    return json.loads(json.dumps(program().to_dict()))


def test_a_program_comes_back_from_its_file(tmp_path):
    path = write_program(program(), tmp_path / "program.json")
    again = read_program(path)
    assert again == program()
    assert again != replace(again, speed=again.speed / 2)
    assert again != again.to_dict()
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
        (
            "colour",
            "red",
            "colour must be left out, or renamed to one of format, .* Got an unknown field",
        ),
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


def test_a_summary_counts_settings_and_fixturings():
    whole = program()
    assert f": {whole.n_stops} settings, fixturings " in repr(whole)
    tour = replace(whole.tours[0], stops=whole.tours[0].stops[:1])
    assert f": 1 setting, fixturing {tour.fixturing}, " in repr(replace(whole, tours=(tour,)))
