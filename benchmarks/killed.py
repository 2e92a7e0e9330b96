"""Plans that are killed (kill -9) at random moments and resumed: the same plan, no orphans, nothing left, little lost.

``python benchmarks/killed.py --kills 20``
``python benchmarks/killed.py PART --entities FILE --camera FILE --kills 20``

A plan is made once without interruption. Then it is begun anew, killed at a random moment of that length, and resumed
with ``--resume`` until it has been killed so many times; a plan that is done before its kill is begun anew. The table
tells, for each kill, after how many seconds it came, how long before the state was last saved (what is lost of the
planning), the processes that outlived it by more than a second, and hidden files that it left. At the end of each plan
the plan files must be those of the plan without interruption, byte for byte, and nothing else may be there. Linux only.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

_COMMAND = "import sys; from planner.cli.main import main; sys.exit(main())"
_EXAMPLES = Path(__file__).parents[1] / "examples"
_STATE = "planning-state.json"


def main() -> None:
    """Kill, resume, compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", nargs="?", default=str(_EXAMPLES / "slotted_block.off"))
    parser.add_argument("--entities", default=str(_EXAMPLES / "slotted_block_entities.toml"))
    parser.add_argument("--camera", default="basler-acA2440-20gm-8mm")
    parser.add_argument("--kills", type=int, default=20, metavar="N")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    chance = random.Random(options.seed)
    asked = ["plan", options.part, "--entities", options.entities, "--camera", options.camera, "--simulate", "1000"]
    asked += ["--sigma-mm", "0.05", "--sigma-rad", "0.001", "--quiet"]
    with tempfile.TemporaryDirectory() as scratch:
        whole, broken = Path(scratch) / "whole", Path(scratch) / "broken"
        begun = time.perf_counter()
        _begin([*asked, "--out", str(whole)]).wait()
        length = time.perf_counter() - begun
        print(f"without interruption: {length:.1f} s\nkill     at s   lost s  orphans  left over  plan", flush=True)
        kills = wrong = 0
        while kills < options.kills:
            process = _begin([*asked, "--resume", "--out", str(broken)])
            after = chance.uniform(0.0, length)
            try:
                process.wait(after)
            except subprocess.TimeoutExpired:
                kills += 1
                print(f"{kills:>4}{_killed(process, broken, after)}", flush=True)
                if kills < options.kills:
                    continue
                _begin([*asked, "--resume", "--out", str(broken)]).wait()
            same = _files(broken) == _files(whole)
            wrong += not same
            print(f"{'':<46}{'the same' if same else 'ANOTHER'}", flush=True)
            shutil.rmtree(broken)
    sys.exit(1 if wrong else 0)


def _begin(arguments: list[str]) -> subprocess.Popen:
    command = [sys.executable, "-c", _COMMAND, *arguments]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, start_new_session=True)


def _killed(process: subprocess.Popen, folder: Path, after: float) -> str:
    """Kill; return the columns of the table."""
    state = folder / _STATE
    saved = state.stat().st_mtime if state.exists() else None
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    lost = min(after, after if saved is None else time.time() - saved)
    time.sleep(1.0)
    orphans = [int(pid.name) for pid in Path("/proc").iterdir() if pid.name.isdigit() and _session(pid) == process.pid]
    hidden = [path.name for path in folder.rglob(".*")] if folder.exists() else []
    for pid in orphans:
        os.kill(pid, signal.SIGKILL)
    return f"{after:>9.1f}{lost:>9.1f}{len(orphans):>9}{len(hidden):>11}"


def _session(pid: Path) -> int:
    try:
        fields = (pid / "stat").read_text().rpartition(")")[2].split()
    except OSError:
        return -1
    # after the name in brackets: state, parent, group, session; a zombie waits to be collected only
    return -1 if fields[0] == "Z" else int(fields[3])


def _files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


if __name__ == "__main__":
    main()
