"""Where a plan comes from: program, date, part, camera and uncertainty, for the head of a report."""

from __future__ import annotations

import datetime
import os
import time
from collections.abc import Mapping
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from planner.identity.program import program_version

if TYPE_CHECKING:
    from planner.plan import InspectionPlan

# digits of a digest that tell parts apart at a glance
_DIGEST_DIGITS = 12
# more seconds than that are beyond the year 5138
_SECONDS_DIGITS = 11


def report_date(environment: Mapping[str, str] | None = None) -> str:
    """Return the date for a report: of ``SOURCE_DATE_EPOCH`` if that is set, otherwise today (UTC).

    Parameters
    ----------
    environment : mapping of str to str, optional
        The environment. Default: that of the process.

    Returns
    -------
    str
        Such as ``"2026-03-01"``. A plan file holds no date, so equal requests give equal plans.
    """
    text = (os.environ if environment is None else environment).get("SOURCE_DATE_EPOCH", "")
    is_seconds = text.isascii() and text.isdigit() and len(text) <= _SECONDS_DIGITS
    seconds = int(text) if is_seconds else time.time()
    return datetime.datetime.fromtimestamp(seconds, datetime.timezone.utc).date().isoformat()


def facts(plan: InspectionPlan, date: str | None = None) -> str:
    """Return the list of facts at the head of a report as HTML.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    date : str, optional
        When the report was written; nothing is said of it otherwise.
    """
    camera = plan.camera
    rows = {
        "Part": plan.part or "part",
        "Digest of the part": _digest(plan),
        "Camera": f"{camera.name or 'camera'}, f = {camera.focal_length_mm:g} mm, "
        f"f/{camera.f_number:g}, focused at {camera.focus_distance_mm:g} mm",
        "Camera pose": sigma_text(plan.pose_uncertainty.sigmas),
        "Program": f"aspectgraph {program_version()}",
        "Date": date or "",
    }
    return "".join(
        f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>"
        for name, value in rows.items()
        if value
    )


def _digest(plan: InspectionPlan) -> str:
    """Return the first digits of the part's digest; nothing of plans that hold none."""
    part = plan.request.get("part", {})
    return str(part.get("digest", ""))[:_DIGEST_DIGITS]


def sigma_text(sigmas: np.ndarray) -> str:
    """Return standard deviations (6,) of a camera pose, mm and rad, as short as they allow.

    Parameters
    ----------
    sigmas : ndarray, shape (6,)
        Along and about x, y, z.
    """
    groups = []
    for values, unit in ((sigmas[:3], "mm"), (sigmas[3:], "rad")):
        texts = [f"{value:.4g}" for value in values]
        if len(set(texts)) == 1:
            texts = texts[:1]
        groups.append(f"{', '.join(texts)} {unit}")
    return f"σ = {groups[0]} and {groups[1]}"
