"""The part of a command: how it is read, and what `info` shows of it. This loads nothing of plans."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aspectgraph import (
    AspectGraphError,
    PartFileNotFoundError,
    ReadError,
    ReadLimits,
    SolidChoice,
    list_solids,
    read_solid,
)
from aspectgraph.phases import phases_checked_by
from aspectgraph.read.part_file import MESH_SUFFIXES
from planner.app.checks import in_words_of_shell
from planner.app.options import Info, PartReading, SearchEffort
from planner.app.process import DONE
from planner.callbacks import KEPT_LIMIT_S
from planner.exceptions import RequestError
from planner.files import print_json
from planner.progress import WATCHED_S, reading_shown, visible
from planner.report.part_tables import part_record, print_part, print_solids, solid_records
from planner.text_table import print_text

if TYPE_CHECKING:
    from aspectgraph import Solid, SolidEntry


def reading_of(options: PartReading) -> dict[str, Any]:
    """Return how the part is to be read, as `aspectgraph.read_solid` takes it, with ``occluders`` apart."""
    return {
        "units": options.units,
        "solids": options.solids,
        "occluders": options.occluders,
        "gap_mm": options.gap_mm,
    }


def check_nothing_read(options: PartReading) -> None:
    """Refuse options that say how a part is read where there is none.

    Raises
    ------
    RequestError
        Names the option.
    """
    for name, value in reading_of(options).items():
        if value is not None:
            raise RequestError.of_rule(name, "must be given with a part", "none")


def read_part(part: str, options: PartReading) -> Solid:
    """Read the part; an error names the file."""
    with shown_reading(options, begun=options.begun):
        return read_as(part, reading_of(options), options)


def shown_reading(
    options: PartReading, *, begun: float | None = None
) -> AbstractContextManager[None]:
    """Return `reading_shown` as the options of a command ask for it: in steady steps where the time is limited.

    Parameters
    ----------
    options : PartReading
        Of the command.
    begun : float, optional
        As `reading_shown` takes it.
    """
    return reading_shown(
        quiet=options.quiet,
        lines=options.verbose,
        begun=begun,
        most_silent_s=None if _kept_limit(options) is None else WATCHED_S,
    )


@contextmanager
def read_in_time(options: PartReading) -> Iterator[None]:
    """Let reading in the block end with the time of a plan, which would have none left for a pose.

    Parameters
    ----------
    options : PartReading
        Of a command; shorter limits than `KEPT_LIMIT_S` do not count the reading.

    Raises
    ------
    RequestError
        The time is up.
    """
    end = _end_of_time(options)

    def check() -> None:
        if time.monotonic() > end:
            raise _too_short(options)

    try:
        with phases_checked_by(check):
            yield
    except ReadError as error:
        # the kernel was ended by the limit that `read_limits` gave it
        if time.monotonic() > end and any("time_s" in text for text in error.mentions):
            raise _too_short(options) from None
        raise


def _end_of_time(options: PartReading) -> float:
    """Return when the time of a plan is up, as `time.monotonic` counts; infinity for other commands."""
    limit = _kept_limit(options)
    return math.inf if limit is None else options.begun + limit


def _kept_limit(options: PartReading) -> float | None:
    """Return the time limit of a search that also counts the reading; None if there is none."""
    limit = options.time_limit if isinstance(options, SearchEffort) else None
    return None if limit is None or limit < KEPT_LIMIT_S else float(limit)


def _too_short(options: PartReading) -> RequestError:
    rule = "must be long enough to read the part"
    return RequestError.of_rule("time_limit_s", rule, f"{_kept_limit(options):g}")


def read_as(part: str, reading: dict[str, Any], options: PartReading) -> Solid:
    """Read the part as a mapping says, such as that of a plan's file; an error names the file."""
    arguments = dict(reading)
    occluders = arguments.pop("occluders", None)
    if occluders:
        arguments["solids"] = SolidChoice(arguments.get("solids"), occluders)
    with _naming_part(part, options), read_in_time(options):
        return read_solid(part, limits=read_limits(options), **arguments)


def read_solid_list(part: str, options: PartReading) -> tuple[SolidEntry, ...]:
    """List the solids of a STEP file; an error names the file."""
    with (
        shown_reading(options, begun=options.begun),
        _naming_part(part, options),
    ):
        return list_solids(part, limits=read_limits(options))


@contextmanager
def _naming_part(part: str, options: PartReading) -> Iterator[None]:
    """Let an error of reading a part name its file, and options instead of parameters."""
    try:
        yield
    except AspectGraphError as error:
        if error.parameter == "path":
            missing = isinstance(error, PartFileNotFoundError)
            rule = "must be an existing file" if missing else error.rule
            raise type(error).of_rule("part", rule, error.got) from None
        words = in_words_of_shell(error, vars(options))
        raise type(error)(f"{part}: {words}") from None


def read_limits(options: PartReading) -> ReadLimits:
    """Return what reading the part may take: no more than the time of a plan that is left."""
    limits = ReadLimits()
    if options.read_time_limit is not None:
        limits = replace(limits, time_s=options.read_time_limit)
    seconds = max(_end_of_time(options) - time.monotonic(), 1e-3)
    return replace(limits, time_s=min(limits.time_s, seconds))


def info(options: Info) -> int:
    """Show what a part consists of and which edges, rims and arcs can be entities."""
    if options.list:
        return _list_solids(options)
    solid = read_part(options.part, options)
    with shown_reading(options):
        edges = solid.straight_edges(min_length_mm=options.min_length)
        curves = (*solid.rims(), *solid.arcs())
    if options.select is not None:
        from aspectgraph import select_entities

        chosen = set(select_entities(solid, options.select))
        edges = tuple(edge for edge in edges if edge.id in chosen)
        curves = tuple(curve for curve in curves if curve.id in chosen)
    if options.picture:
        _write_picture(
            solid, options.picture, [edge.id for edge in edges], [curve.id for curve in curves]
        )
    if options.json:
        print_json(
            part_record(solid, edges, curves, reading_notes(options.part, options.units, solid))
        )
        return DONE
    print_part(solid, edges, curves)
    print_reading(options.part, options.units, solid)
    if options.picture:
        print(visible(str(options.picture)))
    return DONE


def _list_solids(options: Info) -> int:
    """Show the solids of a STEP file, with the names that --solids takes."""
    entries = read_solid_list(options.part, options)
    if options.json:
        print_json({"part": options.part, "solids": solid_records(entries)})
    else:
        print_solids(entries)
    return DONE


def _write_picture(solid: Solid, path: str, edge_ids: list[int], curve_ids: list[str]) -> None:
    """Write the picture of `info`; an error names the option."""
    from aspectgraph import write_edge_picture

    try:
        write_edge_picture(solid, path, edge_ids, curve_ids)
    except AspectGraphError as error:
        if error.parameter != "path":
            raise
        raise type(error).of_rule("picture", error.rule, error.got) from None


def print_reading(part: str, units: str | None, solid: Solid) -> None:
    """Print what reading the part assumed, and what its ids hold for."""
    for text in reading_notes(part, units, solid):
        print_text(f"note: {text}")


def reading_notes(part: str, units: str | None, solid: Solid) -> list[str]:
    """Return what reading the part assumed, and what its ids hold for; nothing where that is plain."""
    notes = [unit_note(part, units), ids_note(solid)]
    return [text for text in notes if text]


def ids_note(solid: Solid) -> str:
    """Say for which choice of solids ids hold, if some of the file are left out or only in the way."""
    if solid.file_solids is None or not solid.file_solids.is_choice:
        return ""
    return (
        "ids of edges, rims and arcs hold for this choice of solids only: 'info' lists them with the same --solids "
        "and --occluders"
    )


def unit_note(part: str, units: str | None) -> str:
    """Say which unit was assumed for a file that has none; nothing of others."""
    mesh = [suffix for suffix in Path(part).suffixes if suffix.lower() in MESH_SUFFIXES]
    if units is None and mesh and mesh[-1].lower() != ".glb":
        return f"{mesh[-1][1:].upper()} files state no unit, so the program assumes mm. Use --units for another unit"
    return ""
