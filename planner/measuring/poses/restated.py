"""Registration of a part whose faces deviate more than stated: it is repeated with what the image shows."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2 as chi_squared

from aspectgraph.entities.carriers import PARAMETERS
from errors.registration import surprise
from planner.measuring.image.picture import Picture
from planner.measuring.part_model import POSE, PartModel
from planner.measuring.poses.register import register
from planner.measuring.poses.registered import Registered, prior_covariance

Array = NDArray[np.float64]

CREDIBLE = 0.999
"""Faces that deviate more than with this probability deviate more than stated."""
_ROUNDS = 3


def register_as_shown(
    model: PartModel,
    pictures: list[Picture],
    planned: Array,
    pose_covariance: Array,
    surfaces_mm: float,
    bias_px: float,
) -> Registered:
    """Return the pose of a setting and the deviations of the part's surfaces, see `register`.

    If the image shows that faces deviate more than stated, U would promise too much. Then the registration is repeated
    with the deviation that it shows, and says so.

    Parameters
    ----------
    model, pictures, planned, bias_px
        As of `register`.
    pose_covariance : array (6, 6)
        Of the planned pose.
    surfaces_mm : float
        Stated standard deviation of the position of faces, mm.

    Returns
    -------
    Registered
        The estimate and its joint covariance.

    Raises
    ------
    NotRegisteredError
        If the images do not show the part from near the planned pose.
    """
    shown_mm = surfaces_mm
    for _ in range(_ROUNDS):
        prior = prior_covariance(model, pose_covariance, shown_mm, pictures[0].camera)
        found = register(model, pictures, planned, prior, bias_px)
        more = times_more(model, found, prior)
        if more <= 1:
            break
        shown_mm *= more
    if shown_mm <= surfaces_mm:
        return found
    note = (
        f"faces deviate by about {shown_mm:.2g} mm, not by {surfaces_mm:.2g} mm as stated; "
        f"U is computed with that"
    )
    return replace(found, warnings=(note,))


def times_more(model: PartModel, found: Registered, prior: Array) -> float:
    """Return how many times more than stated the faces deviate that no target measures; 1 if it may be chance."""
    planes = [
        k for k, one in enumerate(model.carriers.surfaces) if one.is_plane and k not in model.free
    ]
    if not planes:
        return 1.0
    own = (PARAMETERS * np.array(planes)[:, None] + np.arange(PARAMETERS)).ravel()
    at = np.ix_(POSE + own, POSE + own)
    total, n = surprise(found.deviations[own], found.covariance[at], prior[at])
    if n == 0 or total <= chi_squared.ppf(CREDIBLE, n):
        return 1.0
    return math.sqrt(total / n)
