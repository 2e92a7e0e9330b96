"""The contrast of edges in rendered images is that of the formula, and not that of another lamp."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from aspectgraph import read_solid

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
from edge_contrast import triples

EXAMPLES = Path(__file__).parents[1] / "examples"
PARTS = ["nist_ctc_01_ap242.stp", "nist_ctc_03_ap242.stp.gz", "mfcad_4-5-5-6-9-23.step"]
N = 70


@pytest.mark.parametrize("name", PARTS)
def test_rendered_contrast_agrees_within_noise(name):
    rows = triples(read_solid(EXAMPLES / name), N, seed=2, n_edges=12)
    predicted, beside, measured, error = (
        np.array([getattr(row, field) for row in rows]) for field in ("predicted", "beside", "measured", "error")
    )
    z = (measured - beside) / error
    # the noise is known: of 70 standard normal values the root mean square is in 0.75 to 1.25 but for 1 in 400
    assert 0.7 < np.sqrt((z**2).mean()) < 1.3
    assert np.abs(z).max() < 4.5
    # and what the formula leaves out by speaking of the edge itself is small: 4 px of 200 px of its length
    assert np.abs(predicted - beside).max() < 0.02
    assert np.ptp(predicted) > 1


def test_another_lamp_is_noticed():
    rows = triples(read_solid(EXAMPLES / PARTS[2]), 30, seed=2, n_edges=6, wrong_lamp=True)
    off = [abs(row.measured - row.predicted) > 10 * row.error for row in rows]
    assert np.mean(off) > 0.5
