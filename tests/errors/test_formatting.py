"""What is told of probabilities must be true, and never be certainty."""

import math
from decimal import Decimal

import numpy as np
import pytest

from errors.checks import (
    below_one,
    frequency_text,
    interval_text,
    percent_text,
    probability_text,
    relation_text,
)


@pytest.mark.parametrize(
    ("value", "told"),
    [
        (0.0, "0.0000"),
        (0.29, "0.2900"),  # 0.29 * 10**4 is below 2900 in binary
        (0.9, "0.9000"),
        (0.89999, "0.8999"),
        (0.99989999, "0.9998"),
        (0.9999, "0.9999"),
        (0.99990001, "> 0.9999"),
        (0.99999999, "> 0.9999"),
        (1.0, "> 0.9999"),
        (math.nan, "nan"),
    ],
)
def test_a_probability_is_told_rounded_down_and_never_as_one(value, told):
    assert probability_text(value) == told
    assert relation_text(value) == (told if told.startswith(">") else f"= {told}")


@pytest.mark.parametrize(
    ("required", "least"), [(0.99, "0.9999"), (0.999, "0.9999"), (0.9999, "0.99999")]
)
def test_digits_tell_a_probability_from_the_required_one(required, least):
    assert probability_text(1.0, required) == f"> {least}"
    assert Decimal(probability_text(1.0, required).removeprefix("> ")) > Decimal(repr(required))
    below = probability_text(required - 1e-9, required)
    assert Decimal(below) < Decimal(repr(required))


def test_in_a_file_no_probability_is_one():
    assert below_one(1.0) == 1.0 - 2.0**-53
    assert below_one(0.5) == 0.5
    assert math.isnan(below_one(math.nan))


def test_frequencies_near_one_are_told_as_counts():
    assert frequency_text(9512, 10_000) == "0.9512"
    assert frequency_text(9998, 10_000) == "0.9998"
    assert frequency_text(9999, 10_000) == "9999 of 10000"
    assert frequency_text(100, 100) == "100 of 100"
    assert frequency_text(2, 3) == "0.6666"


def test_intervals_are_rounded_outwards_and_do_not_end_at_one():
    assert interval_text(0.94716, 0.95502) == "0.9471 to 0.9551"
    assert interval_text(0.99947, 1.0) == "0.9994 or more"
    assert interval_text(0.9991, 0.99995, " .. ") == "0.9991 or more"


def test_what_is_told_holds_for_any_number():
    for value in np.random.default_rng(3).beta(4, 0.4, 500).tolist():
        least = Decimal(probability_text(value).removeprefix("> "))
        assert Decimal(repr(value)) - least >= 0
        assert least < 1
        low, high = (Decimal(x) for x in interval_text(value / 2, 0.99 * value).split(" to "))
        assert low <= Decimal(repr(value / 2)) <= Decimal(repr(0.99 * value)) <= high


@pytest.mark.parametrize(
    ("share", "digits", "told"),
    [
        (1.0, 2, "100 %"),
        (0.997, 2, "100 %"),
        (0.126, 2, "13 %"),
        (0.02, 3, "2 %"),
        (12.34, 3, "1234 %"),
        (0.00000012, 3, "0.000012 %"),
        (-0.5, 2, "-50 %"),
        (0.0, 3, "0 %"),
    ],
)
def test_percents_have_no_exponent(share, digits, told):
    assert percent_text(share, digits) == told
