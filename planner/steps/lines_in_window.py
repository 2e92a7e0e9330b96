"""Which other lines a detector may take for an edge: visible ones where the edge has to be looked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from planner.plan import InspectionPlan
from planner.request.request import Request
from planner.verify.setting_record import search_windows_px


def with_lines_in_windows(plan: InspectionPlan, request: Request) -> InspectionPlan:
    """Return a plan whose settings tell of other visible lines in the search windows of targets.

    Lines that leave an edge's own ends at the angle asked for are no such lines: their direction tells them apart.
    Beside lines and circles that are fitted, a fifth of the points may have such lines.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    request : Request
        What it answers; where it asks nothing of images, the plan is returned as it is.
    """
    showing = request.requirements.showing
    if showing.asks_nothing or not plan.settings:
        return plan
    windows = [search_windows_px(plan, setting) for setting in plan.settings]
    # all are looked for as far as the widest window
    widest = max(max(one.values()) for one in windows)
    settings = []
    for setting, window in zip(plan.settings, windows, strict=True):
        # of witnesses, each setting has its own
        own = request.at_pose(setting.cam2world, setting.entities)
        check = own.constraints.image_check(replace(showing, separation_px=widest))
        wanted = np.ones((1, len(own.names)), bool)
        apart = check.separations(setting.cam2world[None], wanted, 0.0)[0] + widest
        near = dict(zip(own.names, apart.tolist(), strict=True))
        lines = {name: near[name] for name in setting.entities if near[name] < window[name]}
        settings.append(replace(setting, lines_in_window_px=lines))
    return replace(plan, settings=tuple(settings))
