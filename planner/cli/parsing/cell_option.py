"""The cell of a plan, from its file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from planner.exceptions import RequestError

if TYPE_CHECKING:
    from pathlib import Path

    from planner.plan import InspectionPlan
    from planner.robot import Cell


def read_cell(path: str | None) -> Cell | None:
    """Return the cell of a file, or None without one."""
    if path is None:
        return None
    from planner.robot import Cell

    return Cell.from_toml(path)


def cell_again(plan: InspectionPlan, path: str | None, plan_path: Path) -> Cell | None:
    """Return the cell for which a plan is made again.

    Parameters
    ----------
    plan : InspectionPlan
        It holds a digest of its cell only.
    path : str or None
        The cell's file.
    plan_path : Path
        The plan's file, for the error.

    Raises
    ------
    RequestError
        If there is no file although the plan is for a cell, or it describes another one.
    """
    stated = plan.request["requirements"].get("cell")
    cell = read_cell(path)
    if stated is None and cell is None:
        return None
    if stated is None:
        rule = "must not be given with --again, which takes the request from the plan"
        raise RequestError.of_rule("cell", rule, f"{path!r}, and {plan_path} is for no cell")
    if cell is None:
        rule = "must be given for a plan of a robot cell, of which plan.json holds a digest only"
        raise RequestError.of_rule("cell", rule, "none")
    if cell.state_name != stated.get("state_name"):
        raise RequestError.of_rule("cell", "must be the cell of the plan", f"{path!r}, another one")
    return cell


def without_cell(request: Mapping[str, Any]) -> dict[str, Any]:
    """Return the identity of a request without its cell, which no file can hold."""
    return {**request, "requirements": {**request["requirements"], "cell": None}}
