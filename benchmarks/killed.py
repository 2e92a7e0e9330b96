"""Plans that are killed (kill -9) at random moments and resumed: the same plan, no orphans, nothing left, little lost.

``python benchmarks/killed.py --kills 20``
``python benchmarks/killed.py PART --entities FILE --camera FILE --kills 20``
``python benchmarks/killed.py PART --entities all --effort quick --kills 20 --within 120``

A plan is made once without interruption. Then it is begun anew, killed at a random moment of that length (or of as
many seconds as ``--within`` says, where that would take a day), and resumed with ``--resume`` until it has been killed
so many times; a plan that is done before its kill is begun anew. The table tells, for each kill, after how many seconds
it came, how long before that the state or a visible region was last saved (what is lost), in seconds of the clock and
in processor seconds of all processes, which are fewer where other work kept the machine busy; the processes that
outlived it by more than a second, and hidden files that it left. At the end of each plan the plan files must be those
of the plan without interruption, byte for byte, and nothing else may be there. It ends with 1 if they are not, or if a
kill cost more than 20 s by the one count and by the other. Linux only.
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
from contextlib import suppress
from pathlib import Path

_COMMAND = "import sys; from planner.cli.main import main; sys.exit(main())"
_EXAMPLES = Path(__file__).parents[1] / "examples"
_STATE, _REGIONS = "planning-state.json", "planning-regions"
_MOST_LOST_S = 20.0
# how often it is looked whether something was saved
_LOOK_S = 0.1


def main() -> None:
    """Kill, resume, compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", nargs="?", default=str(_EXAMPLES / "slotted_block.off"))
    parser.add_argument("--entities", default=str(_EXAMPLES / "slotted_block_entities.toml"))
    parser.add_argument("--camera", default="basler-acA2440-20gm-8mm")
    parser.add_argument("--effort", default="standard")
    parser.add_argument("--kills", type=int, default=20, metavar="N")
    parser.add_argument("--within", type=float, metavar="S", help="of the start (default: the length of the plan)")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    chance = random.Random(options.seed)
    asked = ["plan", options.part, "--entities", options.entities, "--camera", options.camera, "--simulate", "1000"]
    asked += ["--sigma-mm", "0.05", "--sigma-rad", "0.001", "--effort", options.effort, "--quiet"]
    with tempfile.TemporaryDirectory() as scratch:
        whole, broken = Path(scratch) / "whole", Path(scratch) / "broken"
        begun = time.perf_counter()
        _begin([*asked, "--out", str(whole)]).wait()
        length = time.perf_counter() - begun
        print(
            f"without interruption: {length:.1f} s\nkill     at s   lost s    CPU s  orphans  left over  plan",
            flush=True,
        )
        kills, wrong, most = 0, 0, 0.0
        while kills < options.kills:
            process = _begin([*asked, "--resume", "--out", str(broken)])
            after = chance.uniform(0.0, options.within or length)
            if (lost := _lost_after(process, broken, after)) is not None:
                kills += 1
                most = max(most, min(lost))
                print(f"{kills:>4}{after:>9.1f}{lost[0]:>9.1f}{lost[1]:>9.1f}{_killed(process, broken)}", flush=True)
                if kills < options.kills:
                    continue
                _begin([*asked, "--resume", "--out", str(broken)]).wait()
            same = _files(broken) == _files(whole)
            wrong += not same
            print(f"{'':<55}{'the same' if same else 'ANOTHER'}", flush=True)
            shutil.rmtree(broken)
    print(f"at most {most:.1f} s lost, {_MOST_LOST_S:g} s permitted", flush=True)
    sys.exit(1 if wrong or most > _MOST_LOST_S else 0)


def _begin(arguments: list[str]) -> subprocess.Popen:
    command = [sys.executable, "-c", _COMMAND, *arguments]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, start_new_session=True)


def _lost_after(process: subprocess.Popen, folder: Path, after: float) -> tuple[float, float] | None:
    """Wait; return the seconds and processor seconds since something was saved, or None if the plan is done."""
    begun = time.monotonic()
    newest, at, used = None, begun, 0.0
    while time.monotonic() - begun < after:
        if process.poll() is not None:
            return None
        if (saved := _saved(folder)) != newest:
            newest, at, used = saved, time.monotonic(), _processor_s(process.pid)
        time.sleep(_LOOK_S)
    return time.monotonic() - at, _processor_s(process.pid) - used


def _saved(folder: Path) -> float:
    """Return when the state or a region was last saved."""
    times = [0.0]
    for path in (folder / _STATE, *folder.glob(f"{_REGIONS}/*.npz")):
        with suppress(OSError):
            times.append(path.stat().st_mtime)
    return max(times)


def _processor_s(session: int) -> float:
    """Return the processor seconds of the processes of a session, and of those they have waited for."""
    used = 0
    for pid in Path("/proc").iterdir():
        if pid.name.isdigit() and _session(pid) == session:
            with suppress(OSError):
                used += sum(map(int, (pid / "stat").read_text().rpartition(")")[2].split()[11:15]))
    return used / os.sysconf("SC_CLK_TCK")


def _killed(process: subprocess.Popen, folder: Path) -> str:
    """Kill; return the columns of the table on what stayed."""
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    time.sleep(1.0)
    orphans = [int(pid.name) for pid in Path("/proc").iterdir() if pid.name.isdigit() and _session(pid) == process.pid]
    hidden = [path.name for path in folder.rglob(".*")] if folder.exists() else []
    for pid in orphans:
        os.kill(pid, signal.SIGKILL)
    return f"{len(orphans):>9}{len(hidden):>11}"


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
