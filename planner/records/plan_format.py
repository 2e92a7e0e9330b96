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
    if data.get("version") not in (VERSION, WITH_DIMENSIONS) or isinstance(
        data.get("version"), bool
    ):
        raise PlanFileError(
            f"version must be {VERSION} or {WITH_DIMENSIONS}. Got {shown(data.get('version'))}."
        )
    if "on_grid" in data:
        # of earlier programs; what they counted is false of an edge that is a tenth of a pixel longer
        raise PlanFileError(
            "on_grid must not be in a plan: its probabilities hold for a part of exactly "
            f"nominal size only. Plan again. Got {shown(data['on_grid'])}."
        )
