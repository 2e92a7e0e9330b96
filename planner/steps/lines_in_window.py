"""Which other lines a detector may take for an edge: visible ones where the edge has to be looked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from planner.plan import InspectionPlan
from planner.request.request import Request
from planner.verify.setting_record import search_windows_px


def with_lines_in_windows(plan: InspectionPlan, request: Request) -> InspectionPlan:
    """Return a plan whose settings tell of other visible lines in the search windows of edges.

    Lines that leave an edge's own ends at the angle asked for are no such lines: their direction tells them apart.

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
    # one check for all of them, as wide as the widest
    widest = max(max(one.values()) for one in windows)
    check = request.first.constraints.image_check(replace(showing, separation_px=widest))
    poses = np.array([setting.cam2world for setting in plan.settings])
    wanted = np.array(
        [[name in setting.entities for name in request.names] for setting in plan.settings]
    )
    apart = check.separations(poses, wanted, 0.0) + widest
    settings = []
    for k, setting in enumerate(plan.settings):
        near = {name: float(apart[k, request.names.index(name)]) for name in setting.entities}
        lines = {name: px for name, px in near.items() if px < windows[k][name]}
        settings.append(replace(setting, lines_in_window_px=lines))
    return replace(plan, settings=tuple(settings))
