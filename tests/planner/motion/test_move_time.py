"""Known answers: triangles and trapezoids by hand, and the integral of the profile."""

import numpy as np
import pytest

from planner.robotprogram.program import JointRates, leading_axis, move_times, profile

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
