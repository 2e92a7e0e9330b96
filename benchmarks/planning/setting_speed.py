"""Processor time of one setting on Table II's object with the paper's population of 100 (their machine: 136 s).

``python benchmarks/planning/setting_speed.py`` shows, for the four sets of Table IV, the least and the most over five
seeds: the plan's whole search, and the genetic algorithm alone, without refinement.
"""

from __future__ import annotations

import time

from cases import SETUPS, TABLE_IV, regions

from planner import plan_setting
from planner.effort import Search

_SEEDS = 5


def main() -> None:
    """Print a row per set of entities."""
    print(f"{'entities':<24}{'whole search, s':>18}{'GA alone, s':>18}")
    for names in TABLE_IV:
        whole, alone = (times(names, search) for search in (Search(), Search.genetic()))
        print(f"{', '.join(names):<24}{spread(whole):>18}{spread(alone):>18}")


def times(names, search: Search) -> list[float]:
    """Return the processor time, s, of a search for each seed; the first run, which may compile, is not counted."""
    setup = SETUPS["block"]
    space = regions("block")
    result = []
    for seed in (0, *range(_SEEDS)):
        begun = time.process_time()
        plan_setting(
            space,
            names,
            setup.camera(),
            setup.pose_uncertainty,
            accuracy=setup.accuracy,
            field_margin_px=setup.field_margin_px,
            search=search,
            rng=seed,
        )
        result.append(time.process_time() - begun)
    return result[1:]


def spread(values: list[float]) -> str:
    """Return the least and the most of some values."""
    return f"{min(values):.2f} .. {max(values):.2f}"


if __name__ == "__main__":
    main()
