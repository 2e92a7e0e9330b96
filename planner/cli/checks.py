"""Rules of the command line that are checked before anything is loaded that takes long.

An error names the option as it was typed.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from planner.exceptions import RequestError

_COUNTS = {"seed": 0, "simulate": 1, "jobs": 1, "poses": 1, "graph_limit": 0, "rows": 1}
# of what is counted
_MOST = 10**9
# as `planner.request.defaults.MOST_SEED`, which takes a second to load
_MOST_SEED = 10**300
_NOT_NEGATIVE = (
    "sigma_mm",
    "sigma_rad",
    "stand_off",
    "min_length",
    "min_length_px",
    "field_margin_px",
    "focus_margin_mm",
    "visibility_radius_mm",
    "separation_px",
    "surround_px",
    "min_corner_deg",
)


def check_numbers(options: Any) -> None:
    """Refuse numbers that break the rule of their option, before any work.

    Parameters
    ----------
    options : argparse.Namespace
        Those of one command; options it does not have are passed over.

    Raises
    ------
    RequestError
        If a number breaks its rule; names the option.
    """
    given = vars(options)
    for name, least in _COUNTS.items():
        value = given.get(name)
        if value is None:
            continue
        if value < least:
            raise RequestError.of_rule(name, f"must be at least {least}", str(value))
        most = _MOST_SEED if name == "seed" else _MOST
        if value > most:
            got = f"a number of {len(str(value))} digits"
            raise RequestError.of_rule(name, f"must be at most {most:g}", got)
    for name in _NOT_NEGATIVE:
        value = given.get(name)
        if value is not None and not (math.isfinite(value) and value >= 0):
            raise RequestError.of_rule(name, "must be finite and not negative", f"{value:g}")
    for name in ("accuracy", "probability"):
        value = given.get(name)
        if value is not None and not 0 < value < 1:
            hint = f"write {value:g}%" if 2 <= value < 100 else ""
            raise RequestError.of_rule(name, "must be in (0, 1)", repr(value), hint=hint)
    contrast = given.get("contrast")
    share = given.get("share")
    if contrast is not None and not 0 < contrast < 1:
        rule = "must lie strictly between 0 and 1"
        raise RequestError.of_rule("contrast", rule, repr(contrast))
    if share is not None and not 0 < share <= 1:
        raise RequestError.of_rule("share", "must be in (0, 1]", repr(share))
    limit = given.get("time_limit")
    if limit is not None and not 0 < limit < math.inf:
        rule = "must be a positive number of seconds"
        raise RequestError.of_rule("time_limit", rule, f"{limit:g}")
    for name in ("gap", "give_up"):
        value = given.get(name)
        if value is not None and not 0 <= value < 1:
            raise RequestError.of_rule(name, "must be in [0, 1)", f"{value:g}")


def check_inputs(options: Any) -> None:
    """Refuse a camera that nobody knows, and a part that is not there.

    Parameters
    ----------
    options : argparse.Namespace
        Those of one command; options it does not have are passed over.

    Raises
    ------
    CameraError, RequestError
        Names the option.
    """
    given = vars(options)
    camera = given.get("camera")
    part = given.get("part")
    if camera is not None:
        # here, because it loads numpy
        from planner.cli.parsing.camera import read_camera

        read_camera(camera)
    if part is not None and not Path(part).exists():
        raise RequestError.of_rule("part", "must be an existing file", repr(str(Path(part))))
