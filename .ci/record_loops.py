"""Record which compiled loops plans need, for ground/loops.json: run as ``make loops``.

Some requests are planned without any machine code on disk. The first is the demo, so what a first plan needs comes
first.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
DEMO = ["plan", "examples/nist_ctc_01_ap242.stp", "--camera", "examples/camera.toml"]
QUICK = ["--effort", "quick", "--jobs", "1", "--quiet"]
PROMISE = ["--accuracy", "0.99", "--probability", "0.9"]
NAMED = ["--camera", "basler-acA2440-20gm-8mm"]
REQUESTS = [
    [*DEMO, "--dimensions", "all", "--accuracy", "0.999", "--probability", "0.9"],
    [*DEMO, "--entities", "examples/nist_ctc_01_corners.toml", *PROMISE, "--time-limit", "600"],
    [
        "plan",
        "examples/mfcad_6-11-11-19.step",
        "--all",
        "--camera",
        "examples/camera.toml",
        *PROMISE,
    ],
    [
        "plan",
        "examples/two_pocket_block.off",
        "--entities",
        "17",
        "--light",
        "ring",
        *NAMED,
        *PROMISE,
    ],
    ["plan", "examples/two_pocket_block.off", "--entities", "17", *NAMED, *PROMISE],
    [
        "plan",
        "examples/two_pocket_block.off",
        "--dimensions",
        "examples/two_pocket_block_dimensions.toml",
        "--register",
        "edges",
        *NAMED,
        *PROMISE,
    ],
]


def main() -> None:
    """Plan, and write the list."""
    os.chdir(ROOT)
    sys.path.insert(0, str(ROOT))
    with tempfile.TemporaryDirectory() as folder:
        os.environ["NUMBA_CACHE_DIR"] = folder
        loops = _recorded(Path(folder) / "plan")
    lines = ",\n".join(json.dumps(loop) for loop in loops)
    (ROOT / "ground" / "loops.json").write_text(f"[\n{lines}\n]\n")
    print(f"{len(loops)} loops")


def _recorded(out: Path) -> list[list[Any]]:
    from numba.core import event

    from ground.ahead import list_entry
    from planner.app.main import main as run

    loops: dict[str, list[Any]] = {}

    class Compiled(event.Listener):
        def on_start(self, event: Any) -> None:
            pass

        def on_end(self, event: Any) -> None:
            dispatcher = event.data["dispatcher"]
            args = tuple(event.data["args"])
            local = "<locals>" in dispatcher.py_func.__qualname__
            if local or args not in dispatcher.overloads:
                return
            entry = list_entry(dispatcher.py_func, args)
            ours = dispatcher.py_func.__module__.partition(".")[0]
            if entry is not None and (ROOT / ours).is_dir():
                loops.setdefault(json.dumps(entry), entry)

    event.register("numba:compile", Compiled())  # type: ignore[no-untyped-call]
    for request in REQUESTS:
        run([*request, *QUICK, "--out", str(out), "--force"])
    return list(loops.values())


if __name__ == "__main__":
    main()
