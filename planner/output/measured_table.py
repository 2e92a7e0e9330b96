"""The table of measured values for the terminal."""

from __future__ import annotations

from collections.abc import Iterable

from planner.measuring.merge import Result
from planner.measuring.results import MeasurementResults
from planner.progress.text_table import Column, print_table, print_text, words
from planner.report.wording import count
from planner.wanted.words.tolerance_texts import tolerance_text


def print_results(results: MeasurementResults) -> None:
    """Print measured values with their uncertainties and decisions, and why others have none."""
    columns = (
        Column("target"),
        Column("nominal", right=True),
        Column("value", right=True),
        Column("U (k = 2)", right=True),
        Column("found", right=True),
        Column("decision"),
    )
    print_table(columns, [_row(one) for one in results])
    names = [one.name for one in results]
    for one in results:
        if one.reason:
            print_text(words(f"not measured: {one.name}: {one.reason}", names))
        for note in one.notes:
            print_text(words(f"{one.name}: {note}", names))
    for note in image_notes(results):
        print_text(note)
    print_text(verdict(results))


def image_notes(results: MeasurementResults) -> Iterable[str]:
    """Yield what is to be known of the images."""
    for note in results.notes:
        yield f"note: {note}"
    for name, why in results.failed.items():
        yield f"{name} cannot be registered: {why}"


# of decisions whose words differ for several targets
_SEVERAL = {"conforms": "conform", "does not conform": "do not conform"}


def verdict(results: MeasurementResults) -> str:
    """Say in a sentence or two what was measured."""
    measured = sum(one.measured for one in results)
    parts = [
        f"{n} {name if n == 1 else _SEVERAL.get(name, name)}" for name, n in results.counts.items()
    ]
    return (
        f"{measured} of {count(len(results), 'target')} measured in "
        f"{count(len(results.images), 'image')}. "
        f"Decisions ({results.rule}): {', '.join(parts) or 'none'}."
    )


def number_text(value: float, uncertainty: float) -> str:
    """Return a value with as many decimals as its uncertainty has with two digits."""
    decimals = 4
    for decimals in range(7):
        if uncertainty * 10**decimals >= 9.5:
            break
    return f"{value:.{decimals}f}"


def _row(one: Result) -> tuple[str, ...]:
    tolerance = "" if one.tolerance is None else f" {tolerance_text(one.tolerance)}"
    nominal = f"{one.nominal:.6g} {one.unit}{tolerance}"
    readings = [reading for reading in one.readings if reading.measured] or list(one.readings)
    found = f"{100 * max((r.found_share for r in readings), default=0.0):.0f} %"
    if not one.measured:
        return one.name, nominal, "", "", found, one.decision.value
    u = one.expanded_uncertainty
    return (
        *(one.name, nominal, number_text(one.value, u), number_text(u, u), found),
        one.decision.value,
    )
