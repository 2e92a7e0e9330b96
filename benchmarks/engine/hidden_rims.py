"""How many rims are observable as a whole from nowhere, and of how many of these a run is observable.

    python benchmarks/engine/hidden_rims.py PART [more parts]

Runs are the twelve of 80 % that `runs_of` makes. Seconds are of processor time.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from aspectgraph import Arc, Solid, compute_regions, read_solid, runs_of


def observable(solid: Solid, curves: dict[str, Arc]) -> set[str]:
    """Return the names of rims or runs that are observable from somewhere."""
    regions = compute_regions(solid, curves)
    return {name for name in curves if regions.covering_cells([name])}


def with_a_run(solid: Solid, rim: Arc) -> bool:
    """Tell whether a run of a rim is observable from somewhere."""
    return bool(observable(solid, {f"run {k}": run for k, run in enumerate(runs_of(rim))}))


def main() -> None:
    """Print a line for each part, and the sum."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="+", type=Path)
    total = [0, 0, 0]
    print(f"{'part':28}{'rims':>6}{'hidden':>8}{'with a run':>12}{'s':>8}")
    for path in parser.parse_args().parts:
        began = time.process_time()
        solid = read_solid(path)
        rims = {f"rim {k}": rim for k, rim in enumerate(solid.rims())}
        hidden = set(rims) - observable(solid, rims) if rims else set()
        helped = sum(with_a_run(solid, rims[name]) for name in hidden)
        counts = (len(rims), len(hidden), helped)
        total = [a + b for a, b in zip(total, counts, strict=True)]
        print(
            f"{path.stem[:28]:28}{counts[0]:6}{counts[1]:8}{counts[2]:12}"
            f"{time.process_time() - began:8.1f}",
            flush=True,
        )
    print(f"{'all':28}{total[0]:6}{total[1]:8}{total[2]:12}")


if __name__ == "__main__":
    main()
