"""Compare the engine's regions of rims with the tests' exact referee, chord by chord, on many generated plates."""

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "aspectgraph" / "helpers"))

from rimmed_solids import compare_rims


def main():
    """Count the pairs of viewpoint and rim on which engine and referee disagree."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--solids", type=int, default=200)
    parser.add_argument(
        "--points",
        type=int,
        default=150,
        help="viewpoints per solid, a third near partition planes",
    )
    parser.add_argument("--rims", type=int, default=4)
    chosen = parser.parse_args()
    start = time.perf_counter()
    pairs = 0
    seen = 0
    wrong = []
    for seed in range(chosen.solids):
        comparison = compare_rims(seed, chosen.points, chosen.rims)
        pairs += comparison.engine.size
        seen += int(comparison.referee.sum())
        wrong += comparison.disagreements
    seconds = time.perf_counter() - start
    print(
        f"{chosen.solids} solids, {pairs} pairs, {seen} seen, {len(wrong)} disagreements, {seconds:.1f} s"
    )
    for name, viewpoint, rim in wrong[:20]:
        print(f"  {name}: viewpoint {viewpoint}, rim {rim}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
