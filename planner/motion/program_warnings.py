"""What a person should look at before driving a program."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from planner.motion.program_record import FixturedTour, Stop
from planner.verify.simulate_plan import promises_too_much

NEAR_LIMIT_RAD = 0.05
"""A joint is near its limit if less than this is left, rad."""

NEAR_SINGULAR = 0.05
"""The arm is nearly singular if its smallest singular value is less, lengths divided by 500 mm."""


def program_warnings(tours: Sequence[FixturedTour], probability: float) -> tuple[str, ...]:
    """Return sentences on the stops of a program, in the order of the plan's settings.

    Parameters
    ----------
    tours : sequence of FixturedTour
        Its rounds.
    probability : float
        The probability that the plan requires.
    """
    stops = [stop for tour in tours for stop in tour.stops]
    stops.sort(key=lambda stop: stop.setting_idx)
    return tuple(
        f"setting {stop.setting_idx + 1}: {text}"
        for stop in stops
        for text in _warnings(stop, probability)
    )


def _warnings(stop: Stop, probability: float) -> Iterator[str]:
    low = [f"{name} {p:.3f}" for name, p in stop.probability.items() if p < probability]
    if low:
        yield f"P with this arm is below {probability:g} for {', '.join(low)}."
    broken = [
        f"{name} {rate.frequency:.3f}"
        for name, rate in stop.simulated.items()
        if promises_too_much(rate)
    ]
    if broken:
        yield f"a simulation with this arm finds less than P for {', '.join(broken)}."
    if stop.arm.to_limit_rad < NEAR_LIMIT_RAD:
        yield f"a joint is {np.degrees(stop.arm.to_limit_rad):.1f} degrees from its limit."
    if stop.arm.singular_value < NEAR_SINGULAR:
        yield "the arm is nearly singular."
