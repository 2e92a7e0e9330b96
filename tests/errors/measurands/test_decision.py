"""Decisions by a measured value: known answers of JCGM 106 and ISO 14253-1."""

import math

import pytest

from errors.measurands import Decision, DecisionRule, conformance_probability, decide

ISO = DecisionRule.iso14253()
WIDE = (-1.0, 1.0)


def test_probability_half_at_a_limit():
    """At a limit that is far from the other one, half of the true values are beyond it."""
    assert conformance_probability(1.0, 0.01, WIDE) == pytest.approx(0.5, abs=1e-12)


def test_probability_of_jcgm_106_one_sided():
    """JCGM 106:2012, 7.3: one standard uncertainty inside one limit, the probability is 0.8413."""
    assert conformance_probability(0.9, 0.1, (-math.inf, 1.0)) == pytest.approx(0.841345, abs=1e-6)


def test_probability_with_a_tolerance_of_four_u():
    """T = 4 u and the value in the middle: within two standard deviations, 0.9545."""
    assert conformance_probability(0.0, 0.5, WIDE) == pytest.approx(0.954500, abs=1e-6)


@pytest.mark.parametrize("in_u", [-40.0, -9.0, -3.0, -0.5, 0.0, 0.5, 3.0, 9.0])
def test_probability_with_one_limit_is_that_of_one_tail(in_u):
    """The normal distribution's tail beyond the limit; far tails keep their digits."""
    wanted = math.erfc(-in_u / math.sqrt(2)) / 2
    upper = conformance_probability(0.1 - in_u * 0.01, 0.01, (-math.inf, 0.1))
    lower = conformance_probability(-0.1 + in_u * 0.01, 0.01, (-0.1, math.inf))
    assert upper == pytest.approx(wanted, rel=1e-9, abs=0)
    assert lower == pytest.approx(wanted, rel=1e-9, abs=0)


@pytest.mark.parametrize("side", [-1, 1])
def test_decisions_with_one_limit(side):
    """The side without a limit never decides; 1.645 u is the 95 % point of the normal distribution."""
    tolerance = (-math.inf, 0.1) if side > 0 else (-0.1, math.inf)
    rule = DecisionRule.iso14253()
    for deviation, decision in (
        (-1e6, Decision.CONFORMS),
        (0.1 - 0.0165, Decision.CONFORMS),
        (0.1 - 0.0164, Decision.UNDECIDED),
        (0.1 + 0.0164, Decision.UNDECIDED),
        (0.1 + 0.0165, Decision.DOES_NOT_CONFORM),
    ):
        assert decide(side * deviation, 0.01, tolerance, rule) is decision
    for rule in (DecisionRule.simple(), DecisionRule.guard()):
        assert decide(side * -1e6, 0.01, tolerance, rule) is Decision.CONFORMS
        assert decide(side * 0.2, 0.01, tolerance, rule) is Decision.DOES_NOT_CONFORM


def test_a_value_without_error():
    assert conformance_probability(1.0, 0.0, WIDE) == 1.0
    assert conformance_probability(1.0 + 1e-12, 0.0, WIDE) == 0.0


@pytest.mark.parametrize("side", [-1, 1])
def test_guard_band_of_iso_is_1645_thousandths_of_u(side):
    """Of a wide tolerance each limit has one side: the 95 % quantile of the normal distribution."""
    u = 0.1
    inside = side * (1.0 - 1.6449 * u)
    outside = side * (1.0 + 1.6449 * u)
    assert decide(inside, u, WIDE, ISO) is Decision.CONFORMS
    assert decide(inside + side * 2e-5, u, WIDE, ISO) is Decision.UNDECIDED
    assert decide(outside, u, WIDE, ISO) is Decision.DOES_NOT_CONFORM
    assert decide(outside - side * 2e-5, u, WIDE, ISO) is Decision.UNDECIDED


def test_a_narrow_tolerance_cannot_be_proven():
    """T = 3.9 u: even in the middle less than 95 % lie inside; of 4 u more do."""
    assert decide(0.0, 2 / 3.9, WIDE, ISO) is Decision.UNDECIDED
    assert decide(0.0, 2 / 4.0, WIDE, ISO) is Decision.CONFORMS


def test_other_rules():
    assert decide(0.99, 0.1, WIDE, DecisionRule.simple()) is Decision.CONFORMS
    assert decide(1.01, 0.1, WIDE, DecisionRule.simple()) is Decision.DOES_NOT_CONFORM
    guard = DecisionRule.guard()
    assert decide(0.79, 0.1, WIDE, guard) is Decision.CONFORMS
    assert decide(0.81, 0.1, WIDE, guard) is Decision.UNDECIDED
    assert decide(1.21, 0.1, WIDE, guard) is Decision.DOES_NOT_CONFORM
    assert decide(0.0, 0.1, None, guard) is Decision.NO_TOLERANCE


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: DecisionRule("best"), "rule must be one of iso14253-1, simple, guard U"),
        (lambda: DecisionRule.iso14253(0.5), "level must be above 0.5. Got 0.5"),
        (lambda: DecisionRule.iso14253(1.0), r"level must be in \(0, 1\)"),
        (lambda: conformance_probability(0, -1, WIDE), "standard_uncertainty must not be negative"),
    ],
)
def test_refusals(make, message):
    with pytest.raises(ValueError, match=message):
        make()
