"""Format and version of plan files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from planner.exceptions import PlanFileError
from planner.records.schema import shown

FORMAT = "aspectgraph inspection plan"
VERSION = 1
# of plans that hold dimensions
WITH_DIMENSIONS = 2
# of plans for a robot cell
WITH_CELL = 3


def version_of(dimensions: bool, cell: bool) -> int:
    """Return the version of a plan, by whether it holds dimensions and is for a robot cell."""
    if cell:
        return WITH_CELL
    return WITH_DIMENSIONS if dimensions else VERSION


def check_format(data: Any) -> None:
    """Refuse data that is no plan, or one of a version that this program does not read.

    Parameters
    ----------
    data : Any
        What a plan file holds.

    Raises
    ------
    PlanFileError
        Names the field.
    """
    if not isinstance(data, Mapping) or data.get("format") != FORMAT:
        found = data.get("format") if isinstance(data, Mapping) else type(data).__name__
        raise PlanFileError(f"format must be {FORMAT!r}. Got {repr(found)[:60]}.")
    known = (VERSION, WITH_DIMENSIONS, WITH_CELL)
    if data.get("version") not in known or isinstance(data.get("version"), bool):
        words = f"{VERSION}, {WITH_DIMENSIONS} or {WITH_CELL}"
        raise PlanFileError(f"version must be {words}. Got {shown(data.get('version'))}.")
    if "on_grid" in data:
        # of earlier programs; what they counted is false of an edge that is a tenth of a pixel longer
        raise PlanFileError(
            "on_grid must not be in a plan: its probabilities hold for a part of exactly "
            f"nominal size only. Plan again. Got {shown(data['on_grid'])}."
        )
