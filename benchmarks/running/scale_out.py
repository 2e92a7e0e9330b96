"""A thousand parts on a Dask cluster of processes of this machine, one of which is killed; and on a process pool.

``python benchmarks/running/scale_out.py --parts 1000 --broken 9``     all parts, on two workers of a cluster
``python benchmarks/running/scale_out.py --parts 60 --compare``        cluster and pool, with one worker and with two

The parts are those of `made_parts`; their edges on top that are longer than 30 mm are planned by
``aspectgraph batch FOLDER --scheduler ADDRESS``. When half of the parts are done one worker is killed (kill -9). At the
end the command is given again: it must find all it has done, and the plans must be the same. With ``--compare`` nobody
is killed, and the plans of all rows must be the same. Processor seconds are those of all workers, MiB the most
of one of them. Linux only.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from made_parts import write_parts

_COMMAND = "import sys; from planner.app import start; sys.exit(start())"
_REQUEST = [
    "--camera",
    "basler-acA2440-20gm-8mm",
    "--select",
    "length > 30 and face = top",
    "--accuracy",
    "0.95",
]
_REQUEST += [
    "--sigma-mm",
    "0.05",
    "--sigma-rad",
    "0.001",
    "--simulate",
    "1000",
    "--effort",
    "quick",
]
_HEADER = (
    "on       workers  parts  planned  refused  failed       s  parts/h  CPU s/part  MiB/worker"
)
_LOOK_S = 0.2


def main() -> None:
    """Plan and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--parts", type=int, default=1000, metavar="N")
    parser.add_argument("--broken", type=int, default=0, metavar="N")
    parser.add_argument("--workers", type=int, default=2, metavar="N")
    parser.add_argument(
        "--compare", action="store_true", help="one worker and two, cluster and pool"
    )
    options = parser.parse_args()
    # the one value of a plan that is not from its request
    os.environ["SOURCE_DATE_EPOCH"] = "0"
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "parts"
        out = Path(scratch) / "plans"
        write_parts(folder, options.parts, options.broken)
        print(_HEADER, flush=True)
        if options.compare:
            kinds = [(on, n) for n in (1, 2) for on in ("cluster", "pool")]
            plans = [_row(on, n, folder, Path(scratch) / f"{on}-{n}") for on, n in kinds]
            if any(one != plans[0] for one in plans):
                sys.exit("the plans depend on who makes them.")
            return
        first = _row(
            "cluster", options.workers, folder, out, kill_at=(options.parts + options.broken) // 2
        )
        begun = time.perf_counter()
        if _row("cluster", options.workers, folder, out) != first:
            sys.exit("the plans are others after a restart.")
        print(
            f"all were found again in {time.perf_counter() - begun:.0f} s, with the cluster's start"
        )


def _row(
    on: str, workers: int, folder: Path, out: Path, kill_at: int | None = None
) -> dict[str, str]:
    """Plan, print a row, and return the digests of the plans."""
    command = [
        sys.executable,
        "-c",
        _COMMAND,
        "batch",
        str(folder),
        *_REQUEST,
        "--out",
        str(out),
        "--quiet",
        "--json",
    ]
    if on == "pool":
        begun = time.perf_counter()
        process = subprocess.Popen([*command, "--jobs", str(workers)], stdout=subprocess.DEVNULL)
        used = _watched(process, process.pid, out, None)
    else:
        with _cluster(workers) as (address, pid):
            begun = time.perf_counter()
            process = subprocess.Popen(
                [*command, "--scheduler", address], stdout=subprocess.DEVNULL
            )
            used = _watched(process, pid, out, kill_at)
    seconds = time.perf_counter() - begun
    results = json.loads((out / "results.json").read_text(encoding="utf-8"))
    states = Counter(one["status"] for one in results)
    each = sum(cpu for cpu, _ in used.values()) / max(1, len(results))
    counts = f"{len(results):>7}{states['planned']:>9}{states['refused']:>9}{states['failed']:>8}"
    most = max((size for _, size in used.values()), default=0.0)
    rate = 3600 * len(results) / seconds
    print(
        f"{on:<9}{workers:>7}{counts}{seconds:>8.0f}{rate:>9.0f}{each:>12.2f}{most:>12.0f}",
        flush=True,
    )
    return {one["part"]: one["plan_sha256"] for one in results}


@contextmanager
def _cluster(workers: int) -> Iterator[tuple[str, int]]:
    """Provide a scheduler with workers of one thread each; yield its address and the process that keeps the workers."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    module = [sys.executable, "-m"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    begin = [
        "distributed.cli.dask_scheduler",
        "--host",
        "127.0.0.1",
        "--port",
        str(port),
        "--no-dashboard",
    ]
    scheduler = subprocess.Popen([*module, *begin], **quiet)
    begin = [
        "distributed.cli.dask_worker",
        address,
        "--nworkers",
        str(workers),
        "--nthreads",
        "1",
        "--no-dashboard",
    ]
    with tempfile.TemporaryDirectory() as scratch:
        keeper = subprocess.Popen([*module, *begin, "--local-directory", scratch], **quiet)
        try:
            yield address, keeper.pid
        finally:
            for process in (keeper, scheduler):
                process.terminate()
                process.wait()


def _watched(
    process: subprocess.Popen, keeper: int, out: Path, kill_at: int | None
) -> dict[int, tuple[float, float]]:
    """Wait for a command; return processor seconds and most MiB of each worker. One worker is killed on the way."""
    used: dict[int, tuple[float, float]] = {}
    while process.poll() is None:
        for pid in _under(keeper):
            with suppress(OSError, ValueError, IndexError):
                cpu, size = _taken(pid)
                used[pid] = cpu, max(size, used.get(pid, (0.0, 0.0))[1])
        if kill_at is not None and sum(1 for _ in out.glob("*/result.json")) >= kill_at:
            # the one that works most: beside the workers there is a process that keeps track of them
            victim = max(_under(keeper), key=lambda pid: used.get(pid, (0.0, 0.0)))
            os.kill(victim, signal.SIGKILL)
            print(f"worker {victim} is killed", flush=True)
            kill_at = None
        time.sleep(_LOOK_S)
    return used


def _under(pid: int) -> list[int]:
    """Return the processes that one has started, and those that they have."""
    found: list[int] = []
    # any thread may have started one
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        with suppress(OSError):
            for child in map(int, task.read_text().split()):
                found += [child, *_under(child)]
    return found


def _taken(pid: int) -> tuple[float, float]:
    """Return processor seconds and MiB of a process."""
    ticks = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK"), pages * os.sysconf(
        "SC_PAGE_SIZE"
    ) / 2**20


if __name__ == "__main__":
    main()
