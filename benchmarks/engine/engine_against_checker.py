"""Compare the engine with the exact referee of the tests on many generated solids."""

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "aspectgraph" / "helpers"))

from engine_pairs import compare


def main():
    """Count the pairs of viewpoint and entity on which engine and referee disagree."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--solids", type=int, default=600)
    parser.add_argument(
        "--points",
        type=int,
        default=400,
        help="viewpoints per solid, half of them near partition planes",
    )
    parser.add_argument("--entities", type=int, default=10)
    chosen = parser.parse_args()
    start = time.perf_counter()
    pairs = 0
    wrong = []
    for seed in range(chosen.solids):
        comparison = compare(seed, chosen.points, chosen.entities)
        pairs += comparison.engine.size
        wrong += comparison.disagreements()
    print(
        f"{chosen.solids} solids, {pairs} pairs, {len(wrong)} disagreements, {time.perf_counter() - start:.1f} s"
    )
    for name, viewpoint, edge, answer in wrong[:20]:
        print(
            f"  {name}: viewpoint {viewpoint}, edge {edge}: engine {answer}, referee {not answer}"
        )
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
