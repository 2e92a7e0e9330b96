"""Few columns that contain every entity: exactly with a proof, by exchange without one, and the linear relaxation."""

from planner.cover.few_columns import (
    exchange_columns,
    few_columns,
    fractional_cover,
    mean_dual,
    sets_to_realise,
)
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
