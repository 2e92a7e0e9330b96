"""Memory and time of joint graphs, beside the estimate that `aspectgraph.graph.aspect_graph` gives before the work.

``python benchmarks/engine/joint_memory.py PART [PART ...] --edges 10 20 40``

The first so many straight edges of each part are joined in a process of its own, whose largest memory is read at the
end. Run it on a machine that does nothing else: the times are those of the clock. Linux only.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import resource
import time
from pathlib import Path
from typing import Any

from aspectgraph import VisibilityRegions, compute_regions, graph_of, read_solid
from aspectgraph.graph.build_graph import estimate_joint_graph

_MIB = 2**20
_HEADER = (
    "part                      edges   cells  domains    MiB   est. MiB  ratio      s   est. s"
)


def main() -> None:
    """Join and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("parts", nargs="+", type=Path, metavar="PART")
    parser.add_argument("--edges", nargs="+", type=int, default=[10, 20, 40], metavar="N")
    options = parser.parse_args()
    print(_HEADER, flush=True)
    for part in options.parts:
        solid = read_solid(part)
        edges = [edge.id for edge in solid.straight_edges()]
        counts = [n for n in options.edges if n <= len(edges)]
        regions = compute_regions(solid, {f"e{edge}": edge for edge in edges[: max(counts)]})
        # what is compiled is loaded once, before the processes part
        graph_of(regions, regions.entity_names[:2])
        for n in counts:
            print(f"{part.name[:24]:<24}{_row(regions, n)}", flush=True)


def _row(regions: VisibilityRegions, n: int) -> str:
    names = regions.entity_names[:n]
    single = [regions._regions[name] for name in names]
    about = estimate_joint_graph(single)
    context = multiprocessing.get_context("fork")
    receive, send = context.Pipe(duplex=False)
    process = context.Process(target=_join, args=(send, regions, names))
    process.start()
    domains, used, seconds = receive.recv()
    process.join()
    cells = sum(region.n_leaves for region in single)
    counts = f"{n:>7}{cells:>8}{domains:>9}{used / _MIB:>7.0f}"
    ratio = used / about.memory_bytes
    return f"{counts}{about.memory_bytes / _MIB:>11.0f}{ratio:>7.2f}{seconds:>7.1f}{about.seconds:>9.1f}"


def _join(send: Any, regions: VisibilityRegions, names: tuple[str, ...]) -> None:
    before = _resident()
    begun = time.perf_counter()
    graph = graph_of(regions, names)
    used = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    send.send((len(graph.graph), used, time.perf_counter() - begun))


def _resident() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


if __name__ == "__main__":
    main()
