"""Count the graphs that change when a part is turned, moved, scaled or listed in another order.

    python benchmarks/engine/engine_invariance.py [--solids 150] [--turns 2] [--first 0] [--parts FILE ...]

Every generated solid (every other sharp edge an entity) and every part file (its first edges) is turned at random,
moved, scaled and listed anew; graphs count as equal if they agree in lists, degrees and adjacencies.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests" / "aspectgraph" / "helpers"))

from engine_pairs import sharp_edges  # noqa: E402
from exact_checker import ExactChecker  # noqa: E402
from generated_solids import generated_solid  # noqa: E402
from moved_parts import from_file, graph_of, listed, moved, same_graph, shuffled  # noqa: E402


def generated(seed):
    """Return the name of a generated solid, and it as a list with every other sharp edge an entity."""
    part = generated_solid(seed)
    return part.name, listed(
        part.vertices, part.faces, sharp_edges(part, ExactChecker(part.vertices, part.faces))[::2]
    )


def differences(name, part, turns, seed, room):
    """Compare turned copies of a part with itself; print and count those that differ."""
    graph = graph_of(part, room)
    wrong = 0
    for turn in range(turns):
        rng = np.random.default_rng([seed, turn])
        other = graph_of(shuffled(moved(part, rng), rng), room)
        if not same_graph(graph, other):
            wrong += 1
            sizes = [f"{len(g)}/{g.number_of_edges()}" for g in (graph, other)]
            print(
                f"  {name}, seed {seed}, turn {turn}: {sizes[0]} domains/adjacencies became {sizes[1]}",
                flush=True,
            )
    return wrong


def main():
    """Compare the parts asked for with copies of them; exit code 1 if a graph differs."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--solids", type=int, default=150, help="generated solids")
    parser.add_argument("--first", type=int, default=0, help="seed of the first of them")
    parser.add_argument("--turns", type=int, default=2, help="copies of each")
    parser.add_argument(
        "--room", type=float, default=200.0, help="workspace around the part, in its diagonals"
    )
    parser.add_argument("--parts", type=Path, nargs="*", default=[], help="part files")
    parser.add_argument("--entities", type=int, default=20, help="entities of part files")
    chosen = parser.parse_args()
    start = time.process_time()
    wrong = 0
    copies = 0
    for seed in range(chosen.first, chosen.first + chosen.solids):
        wrong += differences(*generated(seed), chosen.turns, seed, chosen.room)
        copies += chosen.turns
    for path in chosen.parts:
        wrong += differences(
            path.name, from_file(path, chosen.entities), chosen.turns, 0, chosen.room
        )
        copies += chosen.turns
    parts = f"{chosen.solids} solids and {len(chosen.parts)} part files"
    print(
        f"{parts}, {copies} turned copies, {wrong} graphs differ, {time.process_time() - start:.0f} s"
    )
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
