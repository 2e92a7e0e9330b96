"""Where the robot stands in each setting, as a table for the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from planner.progress.text_table import Column, print_table, print_text
from planner.robot.arm import unchecked_text

if TYPE_CHECKING:
    from planner.plan import InspectionPlan


def print_arm(plan: InspectionPlan) -> None:
    """Print the fixturing and the joints of each setting of a plan for a robot cell."""
    columns = (
        Column("setting", right=True),
        Column("part lies"),
        Column("joints (degrees)"),
        Column("clearance (mm)", right=True),
        Column("to limit", right=True),
    )
    rows = [
        (
            str(number),
            setting.fixturing,
            _turned(setting.angle_deg)
            + " ".join(f"{angle + 0.0:.1f}" for angle in np.round(np.degrees(setting.joints), 1)),
            f"{setting.arm['clearance_robot_mm']:.1f}",
            f"{np.degrees(setting.arm['to_limit_rad']):.0f}°",
        )
        for number, setting in enumerate(plan.settings, start=1)
        if setting.fixturing
    ]
    if not rows:
        return
    print()
    print_table(columns, rows)
    names = list(dict.fromkeys(one.fixturing for one in plan.settings if one.fixturing))
    print_text(f"{plan.cell['robot']} reaches all settings, with the part lying {listed(names)}.")
    unchecked = unchecked_text(plan.cell.get("bodiless_links", ()))
    if unchecked:
        print_text(f"warning: {unchecked}")


def _turned(angle_deg: float | None) -> str:
    return "" if angle_deg is None else f"table {angle_deg:g}°: "


def listed(names: list[str]) -> str:
    """Return names in quotes, the last behind an and."""
    quoted = [repr(name) for name in names]
    return " and ".join(filter(None, [", ".join(quoted[:-1]), *quoted[-1:]]))
