"""Columns of the cover: what poses inspect, better poses where the cover would profit, and the settings they become.

What a pose inspects was judged by every constraint and by the required probability.
"""

from planner.columns.candidates import Pools, derive_seed, judged_poses, price_poses
from planner.columns.judge import Judge
from planner.columns.outcome import Outcome
from planner.columns.pool import ColumnPool
from planner.columns.realise_column import best_supported, realise, without_contradicted

__all__ = [
    "ColumnPool",
    "Judge",
    "Outcome",
    "Pools",
    "best_supported",
    "derive_seed",
    "judged_poses",
    "price_poses",
    "realise",
    "without_contradicted",
]
