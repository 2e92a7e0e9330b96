"""How the file of a part was read, as a plan keeps it: so the plan can be made again."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from planner.files import absolute, name_text
from planner.identity.inspection_request import SOURCE
from planner.plan import InspectionPlan


def with_source(
    plan: InspectionPlan, folder: Path, part: str | Path, reading: Mapping[str, Any]
) -> InspectionPlan:
    """Return a plan that says which file its part is, and how it was read.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    folder : Path
        Where it is written: the file is named relative to it, so that both can be moved.
    part : path
        The part's file.
    reading : mapping
        Options of `aspectgraph.read_solid`; those that are None are left out.
    """
    if not plan.request:
        return plan
    path = absolute(part)
    try:
        name = Path(os.path.relpath(path, absolute(folder))).as_posix()
    except (OSError, ValueError):
        # on another drive
        name = str(path)
    given = {key: value for key, value in reading.items() if value is not None}
    # names of files need not be Unicode
    return replace(plan, request={**plan.request, SOURCE: {"file": name_text(name), **given}})
