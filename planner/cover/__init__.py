"""Few columns that contain every entity: exactly with a proof, by exchange without one, and the linear relaxation."""

from planner.cover.exchange_search import exchange_columns
from planner.cover.few_columns import few_columns, sets_to_realise
from planner.cover.relaxation import fractional_cover, mean_dual
from planner.cover.set_cover import (
    Cover,
    cover_within,
    distinct_rows,
    is_cover,
    maximal_columns,
    min_cover,
)

__all__ = [
    "Cover",
    "cover_within",
    "distinct_rows",
    "exchange_columns",
    "few_columns",
    "fractional_cover",
    "is_cover",
    "maximal_columns",
    "mean_dual",
    "min_cover",
    "sets_to_realise",
]
