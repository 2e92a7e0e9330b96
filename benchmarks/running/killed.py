"""Plans that are killed (kill -9) at random moments and resumed: the same plan, no orphans, nothing left, little lost.

``python benchmarks/running/killed.py --kills 20``
``python benchmarks/running/killed.py PART --entities FILE --camera FILE --kills 20``
``python benchmarks/running/killed.py PART --entities all --effort quick --kills 20 --within 30``

A plan is made once without interruption. Then it is begun anew, killed at a random moment of that length (or of as much
as ``--within`` says, where that would take a day), and resumed with ``--resume`` until it has been killed often enough;
a plan that is done before its kill is begun anew. Moments and lengths are in processor seconds of all its processes:
what else the machine does changes nothing. The table tells, for each kill, after how many of them it came, how many it
was after the state or a visible region was last saved (what is lost), the processes that outlived it by more than ten
seconds of the clock, and hidden files that it left. At the end of each plan the plan files must be those of the plan
without interruption, byte for byte, and nothing else may be there. It ends with 1 if they are not, or if more than 20 s
were lost. Linux only.
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

_COMMAND = "import sys; from planner.app import start; sys.exit(start())"
_EXAMPLES = Path(__file__).parents[2] / "examples"
_STATE = "planning-state.json"
_REGIONS = "planning-regions"
_MOST_LOST_S = 20.0
# how often it is looked whether something was saved
_LOOK_S = 0.1
_ORPHANS_S = 10.0


def main() -> None:
    """Kill, resume, compare."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("part", nargs="?", default=str(_EXAMPLES / "slotted_block.off"))
    parser.add_argument("--entities", default=str(_EXAMPLES / "slotted_block_entities.toml"))
    parser.add_argument("--camera", default="basler-acA2440-20gm-8mm")
    parser.add_argument("--effort", default="standard")
    parser.add_argument("--kills", type=int, default=20, metavar="N")
    parser.add_argument(
        "--within",
        type=float,
        metavar="S",
        help="processor seconds (default: the length of the plan)",
    )
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    # the one value of a plan that is not from its request
    os.environ["SOURCE_DATE_EPOCH"] = "0"
    chance = random.Random(options.seed)
    asked = [
        "plan",
        options.part,
        "--entities",
        options.entities,
        "--camera",
        options.camera,
        "--simulate",
        "1000",
    ]
    asked += ["--sigma-mm", "0.05", "--sigma-rad", "0.001", "--effort", options.effort, "--quiet"]
    with tempfile.TemporaryDirectory() as scratch:
        whole = Path(scratch) / "whole"
        broken = Path(scratch) / "broken"
        _begin([*asked, "--out", str(whole)]).wait()
        spent = resource.getrusage(resource.RUSAGE_CHILDREN)
        length = spent.ru_utime + spent.ru_stime
        print(
            f"without interruption: {length:.1f} s\nkill     at s   lost s  orphans  left over  plan",
            flush=True,
        )
        kills = 0
        wrong = 0
        most = 0.0
        while kills < options.kills:
            process = _begin([*asked, "--resume", "--out", str(broken)])
            after = chance.uniform(0.0, options.within or length)
            if (lost := _lost_after(process, broken, after)) is not None:
                kills += 1
                most = max(most, lost)
                print(f"{kills:>4}{after:>9.1f}{lost:>9.1f}{_killed(process, broken)}", flush=True)
                if kills < options.kills:
                    continue
                _begin([*asked, "--resume", "--out", str(broken)]).wait()
            same = _files(broken) == _files(whole)
            wrong += not same
            print(f"{'':<46}{'the same' if same else 'ANOTHER'}", flush=True)
            shutil.rmtree(broken)
    print(f"at most {most:.1f} s lost, {_MOST_LOST_S:g} s permitted", flush=True)
    sys.exit(1 if wrong or most > _MOST_LOST_S else 0)


def _begin(arguments: list[str]) -> subprocess.Popen:
    command = [sys.executable, "-c", _COMMAND, *arguments]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, start_new_session=True)


def _lost_after(process: subprocess.Popen, folder: Path, after: float) -> float | None:
    """Wait; return the processor seconds since something was saved, or None if the plan is done."""
    newest = at = used = 0.0
    while used < after:
        if process.poll() is not None:
            return None
        used = max(used, _processor_s(process.pid))
        if (saved := _saved(folder)) != newest:
            newest = saved
            at = used
        time.sleep(_LOOK_S)
    return used - at


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
    for pid in _of_session(session):
        with suppress(OSError):
            used += sum(
                map(int, Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:15])
            )
    return used / os.sysconf("SC_CLK_TCK")


def _of_session(session: int) -> list[int]:
    """Return the processes of a session."""
    return [
        int(pid.name)
        for pid in Path("/proc").iterdir()
        if pid.name.isdigit() and _session(pid) == session
    ]


def _killed(process: subprocess.Popen, folder: Path) -> str:
    """Kill; return the columns of the table on what stayed."""
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    end = time.monotonic() + _ORPHANS_S
    # a process that has just been started arranges to die with its parent, which a busy machine delays
    while (orphans := _of_session(process.pid)) and time.monotonic() < end:
        time.sleep(_LOOK_S)
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
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


if __name__ == "__main__":
    main()
