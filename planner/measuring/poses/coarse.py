"""The coarse shift: by how many pixels an image is off its prediction, before edges are told from each other.

Every sample votes with the gradient along its scan. A shift of the whole image by (du, dv) moves an edge by its part
across the edge, so the votes of all samples are added at this place of each scan. The shift with the most votes wins.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from compiled.cache import njit
from planner.measuring.image.picture import Picture
from planner.measuring.image.scans import SAMPLING_PX, gradients_of, profiles_of

Array = NDArray[np.float64]

MOST_VOTE = 0.05
"""Largest gradient that a sample votes with, as a share of white per px: a few strong edges do not decide alone."""
STEP_PX = 0.5
"""Shifts are tried this far apart."""
_TOP = 0.98


def coarse_shift(
    pictures: list[Picture], centres: Array, across: Array, half_px: float
) -> tuple[Array, float]:
    """Return the shift of an image in px, and by how much it is better than another one.

    Parameters
    ----------
    pictures : list of Picture
        Images from one pose.
    centres, across : array (m, 2)
        Predicted places of samples, px, and unit vectors across their edges.
    half_px : float
        Largest shift that is tried, in each direction.

    Returns
    -------
    shift : array (2,)
        du and dv.
    lead : float
        Votes for it over the most votes for a shift that is at least 3 px away; 1 if both are as good.
    """
    n = int(np.ceil(half_px / STEP_PX))
    votes = np.zeros((2 * n + 1, 2 * n + 1))
    for picture in pictures:
        # a shift in both directions moves an edge by up to this much
        _, grey = profiles_of(picture.grey, centres, across, 1.5 * half_px)
        inside = np.asarray(np.isfinite(grey).all(axis=1))
        strength = np.abs(gradients_of(np.where(inside[:, None], grey, 0.0)))
        strength = np.minimum(strength, MOST_VOTE * picture.white) / picture.white
        strength[~inside] = 0.0
        _vote(np.ascontiguousarray(strength), np.ascontiguousarray(across), votes, STEP_PX)
    best = np.unravel_index(int(np.argmax(votes)), votes.shape)
    grid = (np.arange(2 * n + 1) - n) * STEP_PX
    far = np.hypot(*np.meshgrid(grid - grid[best[0]], grid - grid[best[1]], indexing="ij")) >= 3.0
    rest = float(votes[far].max()) if far.any() else 0.0
    lead = float(votes[best]) / rest if rest > 0 else np.inf
    # strong edges are cut off and have a flat top: its middle
    top = (votes >= _TOP * votes[best]) & ~far
    i, j = np.nonzero(top)
    return np.array([grid[i].mean(), grid[j].mean()]), lead


@njit(error_model="numpy")
def _vote(strength, across, votes, step):
    n = len(votes) // 2
    middle = strength.shape[1] // 2
    for k in range(len(strength)):
        for i in range(len(votes)):
            du = (i - n) * step * across[k, 0]
            for j in range(len(votes)):
                place = (du + (j - n) * step * across[k, 1]) / SAMPLING_PX + middle
                at = int(place + 0.5)
                if 0 <= at < strength.shape[1]:
                    votes[i, j] += strength[k, at]
