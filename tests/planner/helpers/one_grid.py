"""Chance that never shifts the pixel grid: simulation then measures the nominal part on the sensor's own grid."""

from __future__ import annotations

import numpy as np


class OneGrid(np.random.Generator):
    """A generator whose uniform draws, which are the phases of the grid, are 0."""

    def __init__(self, seed: int = 0):
        super().__init__(np.random.PCG64(seed))

    def uniform(self, low=0.0, high=1.0, size=None):
        """Return zeros."""
        return np.zeros(size)
