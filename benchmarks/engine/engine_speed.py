"""Speed of the aspect-graph engine, as ratios measured in one run on one core.

    python benchmarks/engine/engine_speed.py [--quick]

1. Plate of n x n pockets, two floor edges per pocket: the engine against the same insertion in plain rational
   arithmetic (tests/aspectgraph/helpers/rational_twin.py), cells per domain, growth with the number of faces.
2. A million viewpoints times 20 entities: exact location against Open3D casting 32 rays per edge.
3. Real parts: regions of all edges, joint graphs, peak memory.
"""

import argparse
import resource
import sys
import time
from fractions import Fraction
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests" / "aspectgraph" / "helpers"))

import solids  # noqa: E402
from exact_checker import ExactChecker  # noqa: E402
from rational_twin import twin_graph  # noqa: E402

from aspectgraph import build_aspect_graph, compute_regions, graph_of, read_solid  # noqa: E402
from aspectgraph.graph.build_graph import SightLines  # noqa: E402


def cells_per_domain(eag):
    """Mean number of convex cells per viewing domain."""
    return (eag._domains.of_cell >= 0).sum() / max(1, len(eag.graph))


def seconds(call, repeats=1):
    """Least processor time of some calls, and the last result."""
    best = np.inf
    for _ in range(repeats):
        start = time.process_time()
        result = call()
        best = min(best, time.process_time() - start)
    return best, result


def box_around(solid, room=60):
    """Return a workspace (2, 3), mm, in whole millimetres, with so much room around the solid."""
    low, high = solid.bounds
    return np.array([np.floor(low) - room, np.ceil(high) + room])


def twin_seconds(solid, entities, workspace):
    """The twin on the same solid; coordinates of the plates are integers."""
    checker = ExactChecker(
        solid.vertices.astype(int).tolist(), [(face.outer, face.holes) for face in solid.faces]
    )
    index = {tuple(v): k for k, v in enumerate(solid.vertices.astype(int).tolist())}
    edges = {name: tuple(index[tuple(end)] for end in ends) for name, ends in entities.items()}
    low, high = workspace.astype(int).tolist()
    return seconds(lambda: twin_graph(checker, edges, low, high, Fraction))


def plates(quick):
    """Print a row per plate of pockets: the engine's time, the graph, the twin's time; and the growth with faces."""
    print("plate     entities  faces  engine s  domains  adjacencies  cells/domain  twin s   ratio")
    rows = []
    for n, k in [(n, 8) for n in range(2, 9)] + [(5, 20)]:
        solid = solids.plate(n)
        entities = solids.plate_entities(n, k)
        workspace = box_around(solid)
        own, eag = seconds(lambda s=solid, e=entities, w=workspace: build_aspect_graph(s, e, w), 5)
        sizes = (
            f"{len(eag.graph):8d} {eag.graph.number_of_edges():12d} {cells_per_domain(eag):13.1f}"
        )
        line = f"{n} x {n} {k:11d} {len(solid.faces):7d} {own:9.3f} {sizes}"
        if n == 5 and (k == 8 or not quick):
            other, twin = twin_seconds(solid, entities, workspace)
            same = sorted(map(sorted, twin.lists)) == sorted(
                sorted(d["observable"]) for d in eag.graph.nodes.values()
            )
            line += f" {other:7.1f} {other / own:7.0f}  lists {'agree' if same else 'DIFFER'}"
        print(line, flush=True)
        if k == 8:
            rows.append((len(solid.faces), own))
    faces, times = np.log(np.array(rows)).T
    print(
        f"growth: time ~ faces ** {np.polyfit(faces, times, 1)[0]:.2f} (2 x 2 to 8 x 8, 8 entities)\n"
    )


def queries(n_viewpoints=1_000_000, n_cast=5_000):
    """Print the time of exact visibility for many viewpoints, and of ray casting, which is timed for fewer."""
    solid = solids.plate(5)
    entities = solids.plate_entities(5, 20)
    regions = compute_regions(solid, entities, box_around(solid))
    points = np.random.default_rng(0).uniform(*regions.workspace, (n_viewpoints, 3))
    regions.observable(points[:10])
    own, exact = seconds(lambda: regions.observable(points))
    lines = SightLines(solid, list(regions.entities.values()))
    start = time.process_time()
    cast = lines.arrive(points[:n_cast])
    other = (time.process_time() - start) * n_viewpoints / n_cast
    wrong = (cast != exact[:n_cast]).mean()
    print(
        f"{n_viewpoints} viewpoints x {len(entities)} entities: exact {own:.2f} s; 32 rays per edge {other:.0f} s"
    )
    print(
        f"(from {n_cast} viewpoints), {other / own:.0f} times as long, and {wrong:.2%} of its answers wrong\n"
    )


def real(path, n_entities, joint):
    """Print the time and memory of a part's regions, of its first or all edges, and of the joint graph if wanted."""
    solid = read_solid(path)
    edges = [edge.id for edge in solid.straight_edges()][:n_entities]
    spent, regions = seconds(lambda: compute_regions(solid, edges))
    line = f"{path.name}: {len(solid.faces)} faces, {len(edges)} regions {spent:.2f} s"
    if joint:
        more, eag = seconds(lambda: graph_of(regions))
        line += f", joint graph {more:.2f} s, {len(eag.graph)} domains, {eag.graph.number_of_edges()} adjacencies"
        doubts = sum(node["n_arbitrated"] for node in eag.graph.nodes.values())
        line += f", {eag.graph.graph['n_slivers']} slivers, {doubts} doubts settled exactly"
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"{line}; peak memory {peak:.2f} GiB", flush=True)


def main():
    """Measure what the module's description lists."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="leave out the twin with 20 entities")
    parser.add_argument(
        "--parts",
        type=Path,
        nargs="*",
        default=[],
        help="further part files: all edges, regions only",
    )
    arguments = parser.parse_args()
    build_aspect_graph(solids.cube(), [0], None)
    plates(arguments.quick)
    queries()
    real(ROOT / "examples" / "nist_ctc_01_ap242.stp", 20, True)
    for path in arguments.parts:
        real(path, None, False)


if __name__ == "__main__":
    main()
