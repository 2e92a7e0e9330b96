"""Tables for the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.table import Table

from aspectgraph import Rim
from errors.formatting import frequency_text, interval_text, probability_text
from planner.progress.console import new_console as _console
from planner.progress.console import new_table as _table
from planner.report.wording import (
    count,
    features_cell,
    features_sentence,
    lamp_texts,
    margin_texts,
    nouns,
    percent,
    promise_sentence,
    shown_sentence,
    simulation_sentence,
    unshown_texts,
    verdict,
    window_texts,
)
from planner.verify.simulate_setting import CONFIRMED
from planner.wanted.feature_counts import features_text

if TYPE_CHECKING:
    from rich.console import JustifyMethod

    from aspectgraph import Edge, EdgeEnd, EntityAspectGraph, Solid
    from planner.plan import InspectionPlan
    from planner.verify.simulate_plan import SimulationResult
    from planner.verify.simulate_setting import SuccessRate

_MOST_ROWS = 60
# of a part in a batch, the best first
_STATUSES = ("planned", "incomplete", "refused", "failed")


def print_part(solid: Solid, edges: Sequence[Edge], curves: Sequence[Any]) -> None:
    """Print what a part consists of, its straight edges, its rims and its arcs."""
    console = _console()
    size = np.ptp(solid.bounds, axis=0)
    n = len(solid.straight_edges())
    chosen = "" if len(edges) == n else f"{len(edges)} of "
    console.print(
        f"{solid.name}: {count(solid.n_shells, 'shell')}, {count(len(solid.faces), 'face')}, "
        f"{count(len(solid.edges), 'edge')}, {chosen}{count(n, 'sharp straight edge')}, {_vector(size, ' x ')} mm"
    )
    for note in solid.notes:
        console.print(f"note: {note}")
    table = _table(
        ("id", "right"),
        ("from (mm)", "right"),
        ("to (mm)", "right"),
        ("length (mm)", "right"),
        ("turn (deg)", "right"),
        ("ends", "left"),
    )
    tangent = 0
    for edge in edges:
        start, end = solid.edge_points(edge.id)
        ends = solid.edge_ends(edge)
        tangent += any(one.kind == "tangent" for one in ends)
        length = f"{np.linalg.norm(end - start):.3f}"
        table.add_row(
            str(edge.id),
            _vector(start),
            _vector(end),
            length,
            f"{edge.turn_deg:+.1f}",
            _ends_text(ends),
        )
    _print_rows(console, table)
    if tangent:
        console.print(
            f"note: {tangent} of {count(len(edges), 'edge')} run on smoothly at an end (tangent): there is no corner "
            "to measure a length to; distance and angle need none"
        )
    for kind in ("rim", "arc"):
        _print_curves(
            console, kind, [curve for curve in curves if isinstance(curve, Rim) == (kind == "rim")]
        )


def _ends_text(ends: Sequence[EdgeEnd]) -> str:
    """Return both ends of an edge in words, one word if both are corners."""
    words = [end.text for end in ends]
    return words[0] if words[0] == words[1] == "corner" else ", ".join(words)


def _print_curves(console: Console, kind: str, curves: Sequence[Any]) -> None:
    """Print the rims or arcs of a part, if it has any."""
    if not curves:
        return
    console.print(
        f"{count(len(curves), kind)}, {count(sum(len(c.edge_ids) for c in curves), 'chord')}"
    )
    table = _table(
        ("id", "right"),
        ("diameter (mm)" if kind == "rim" else "radius (mm)", "right"),
        ("centre (mm)", "right"),
        ("axis", "right"),
        ("chords", "right"),
        ("off by (mm)", "right"),
    )
    for curve in curves:
        size = 2 * curve.radius_mm if kind == "rim" else curve.radius_mm
        row = (f"{size:.3f}", _vector(curve.centre), _vector(curve.axis), str(len(curve.edge_ids)))
        table.add_row(curve.id, *row, f"{curve.chord_mm:.3f}")
    console.print(table)
    if curves[0].fitted:
        console.print(
            f"note: circles of these {kind}s are fitted to chords, of which the mesh has no other record"
        )


def print_graph(graph: EntityAspectGraph) -> None:
    """Print the size of an aspect graph and its domains, largest lists first."""
    console = _console()
    nodes = graph.graph.nodes
    listed = graph.regions.listed_as
    lists = {frozenset(nodes[n][listed]) for n in nodes}
    console.print(
        f"{count(len(nodes), 'viewing domain' if listed == 'observable' else 'light domain')}, "
        f"{count(graph.graph.number_of_edges(), 'adjacency', 'adjacencies')}, "
        f"{count(len(lists), 'distinct list')} of {count(len(graph.entity_names), 'entity', 'entities')}"
    )
    low, high = graph.workspace
    console.print(f"workspace: {_vector(low)} to {_vector(high)} mm")
    table = _table(("domain", "right"), ("volume (mm3)", "right"), (listed, "left"))
    ordered = sorted(nodes, key=lambda n: (-len(nodes[n][listed]), n))
    for n in ordered[:_MOST_ROWS]:
        names = ", ".join(nodes[n][listed]) or "none"
        table.add_row(str(n), f"{nodes[n]['volume']:.4g}", names)
    console.print(table)
    if len(ordered) > _MOST_ROWS:
        console.print(f"and {len(ordered) - _MOST_ROWS} more in the GraphML file")


def print_dimensions(dimensions: Sequence[Any]) -> None:
    """Print the dimensions a model states: values, and the entities that measure them or the reason why none do."""
    console = _console()
    able = sum(one.entities is not None for one in dimensions)
    stated = sum(one.tolerance is not None for one in dimensions)
    console.print(
        f"{count(len(dimensions), 'dimension')}, {stated} with a tolerance, {able} measurable"
    )
    features = features_text([one.n_features for one in dimensions if one.entities is not None])
    if features:
        console.print(f"{features}; a plan measures one feature of each dimension")
    table = _table(
        ("name", "left"),
        ("kind", "left"),
        ("nominal", "right"),
        ("tolerance", "right"),
        ("features", "right"),
        ("entities or reason", "left"),
    )
    for one in dimensions:
        nominal = "" if one.nominal is None else f"{one.nominal:.6g} {one.unit}"
        tolerance = " ".join(f"{deviation:+.4g}" for deviation in one.tolerance or ())
        if tolerance:
            tolerance += f" {one.unit}"
        how = one.reason if one.entities is None else ", ".join(map(str, one.entities))
        kind = one.kind.replace("_", " ")
        table.add_row(one.name, kind, nominal, tolerance, str(one.n_features), how)
    console.print(table)
    for one in dimensions:
        if one.note:
            console.print(f"note: {one.name}: {one.note}")


def print_plan(plan: InspectionPlan) -> None:
    """Print the plan: settings, probabilities, margins, and what cannot be inspected."""
    console = _console()
    columns: list[tuple[str, JustifyMethod]] = [("measured", "left")] if plan.dimensions else []
    table = _table(
        ("setting", "right"),
        ("position (mm)", "right"),
        (nouns(plan)[0], "left"),
        *columns,
        ("P", "right"),
        ("simulated", "left"),
        ("margins", "left"),
    )
    for k, setting in enumerate(plan.settings):
        rates = plan.simulation.rates[k] if plan.simulation else {}
        rows = [
            (
                name,
                *_measured(plan, name),
                probability_text(setting.probability[name], plan.probability),
                _interval(rates.get(name)),
            )
            for name in setting.entities
        ]
        margins = margin_texts(setting.margins)
        rows += [("",) * (4 if plan.dimensions else 3)] * (len(margins) - len(rows))
        margins += [""] * (len(rows) - len(margins))
        for i, (row, margin) in enumerate(zip(rows, margins, strict=True)):
            head = (str(k + 1), _vector(setting.position, " ", 1)) if i == 0 else ("", "")
            table.add_row(*head, *row, margin, end_section=i == len(rows) - 1)
    _print_rows(console, table)
    for name, reason in plan.uninspectable.items():
        console.print(f"not inspected: {name}: {reason}")
    for k in range(len(plan.settings)):
        for text in [*window_texts(plan, k), *lamp_texts(plan, k)]:
            console.print(f"setting {k + 1}: {text}")
    console.print(verdict(plan))


def print_simulation(plan: InspectionPlan, result: SimulationResult) -> None:
    """Print predicted probabilities beside simulated frequencies."""
    console = _console()
    table = _table(
        ("setting", "right"),
        (nouns(plan)[0], "left"),
        ("predicted", "right"),
        ("frequency", "right"),
        ("interval", "right"),
        ("", "left"),
    )
    for k, rates in enumerate(result.rates):
        for i, (name, rate) in enumerate(rates.items()):
            interval = interval_text(rate.low, rate.high, " .. ")
            predicted = probability_text(rate.predicted, plan.probability)
            cells = predicted, frequency_text(rate.successes, rate.n), interval, rate.verdict
            table.add_row(
                str(k + 1) if i == 0 else "", name, *cells, end_section=i == len(rates) - 1
            )
    _print_rows(console, table)
    for name, reason in plan.uninspectable.items():
        console.print(f"not inspected: {name}: {reason}")
    if plan.features_text:
        console.print(features_sentence(plan))
    console.print(simulation_sentence(result))
    if result.shown is not None:
        console.print(shown_sentence(result.shown))
        for k in range(len(plan.settings)):
            for text in unshown_texts(result.shown, k):
                console.print(f"setting {k + 1}: {text}")
    if plan.settings:
        console.print(promise_sentence(plan))
    if any(result.rates):
        console.print(f"All intervals hold together with {percent(result.confidence)} confidence.")


def _print_rows(console: Console, table: Table) -> None:
    """Print a table unless it has no rows: a plan may have no settings, a part no edges."""
    if table.row_count:
        console.print(table)


def _measured(plan: InspectionPlan, name: str) -> tuple[str, ...]:
    """Return a cell that says what is measured and how wrong it may be; none in a plan of edges."""
    if not plan.dimensions:
        return ()
    target = plan.targets[name]
    features = features_cell(target)
    return (f"{target.error_text}{', ' if features else ''}{features}",)


def _interval(rate: SuccessRate | None) -> str:
    """Return the frequency and its interval, and what they say of the prediction unless they confirm it."""
    if rate is None:
        return ""
    told = "" if rate.verdict == CONFIRMED else f" {rate.verdict}"
    return f"{frequency_text(rate.successes, rate.n)} ({interval_text(rate.low, rate.high, ' .. ')}){told}"


def _vector(values: Iterable[float], separator: str = " ", digits: int = 2) -> str:
    return separator.join(f"{value + 0.0:.{digits}f}" for value in np.round(list(values), digits))


def print_batch(results: Sequence[Any]) -> None:
    """Print how many parts are planned, and of the others the reasons (`PartResult`)."""
    console = _console()
    counts = {status: sum(one.status == status for one in results) for status in _STATUSES}
    told = ", ".join(f"{n} {status}" for status, n in counts.items() if n)
    console.print(f"{count(len(results), 'part')}: {told}")
    lacking = [one for one in results if one.status != _STATUSES[0]]
    for one in lacking[:_MOST_ROWS]:
        console.print(f"{one.part} is {one.status}: {one.reason}", markup=False, highlight=False)
    if len(lacking) > _MOST_ROWS:
        console.print(f"and {len(lacking) - _MOST_ROWS} more, see the tables")
