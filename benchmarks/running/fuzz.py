"""Damage files at random and read them: every reader gives a result or one of the package's own errors, nothing else.

Mutants are numbered, so any of them can be made again. What fails is told with its number; once it is repaired the
number goes into ``KEPT`` of tests/planner/test_plan_file.py. STEP files are read by a kernel in a process
of its own.

Usage: python benchmarks/running/fuzz.py --seconds 600 [--readers part.step,plan.json] [--first 0] [--only 17]
"""

import argparse
import collections
import signal
import sys
import tempfile
import time
import traceback
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "tests" / package / "helpers") for package in ("aspectgraph", "planner")]

from fuzzing import READERS, mutant, outcome  # noqa: E402

LONGEST_S = 30
"""A file of a few kilobytes that takes longer has found a way to keep the reader busy."""

SLOW = {"part.step": 100}
"""One mutant of these for so many of the others: each starts a process."""


def too_long(*_):
    """End a reader that takes too long, at the signal of the alarm."""
    raise TimeoutError(f"took more than {LONGEST_S} s")


def main() -> int:
    """Try mutants until the time is over; return 1 if one of them failed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--readers", default=",".join(READERS))
    parser.add_argument("--first", type=int, default=0, help="number of the first mutant")
    parser.add_argument("--mutants", type=int, help="numbers to try; else what the time allows")
    parser.add_argument("--only", type=int, help="one mutant alone")
    options = parser.parse_args()
    names = options.readers.split(",")
    good = {name: READERS[name].good() for name in names}
    signal.signal(signal.SIGALRM, too_long)
    counts: dict[str, collections.Counter] = {name: collections.Counter() for name in names}
    failures = 0
    end = time.monotonic() + options.seconds
    seed = options.first if options.only is None else options.only
    with tempfile.TemporaryDirectory() as folder:
        while time.monotonic() < end:
            for name in names:
                if len(names) > 1 and seed % SLOW.get(name, 1):
                    continue
                path = Path(folder) / name
                path.write_bytes(mutant(name, seed, good[name]))
                signal.alarm(LONGEST_S)
                try:
                    counts[name][outcome(name, path)] += 1
                except BaseException as error:
                    if isinstance(error, KeyboardInterrupt):
                        raise
                    counts[name]["failed"] += 1
                    failures += 1
                    print(f"{name} {seed}: {type(error).__name__}: {str(error)[:200]}", flush=True)
                    if failures <= 20:
                        traceback.print_exception(error, limit=-4, chain=False)
                finally:
                    signal.alarm(0)
            seed += 1
            if options.only is not None or seed - options.first == options.mutants:
                break
    for name, count in counts.items():
        told = ", ".join(f"{n} {what}" for what, n in sorted(count.items()))
        print(f"{name:>16}: {count.total()} mutants: {told}")
    print(
        f"{sum(count.total() for count in counts.values())} mutants, {failures} failed; next: --first {seed}"
    )
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
