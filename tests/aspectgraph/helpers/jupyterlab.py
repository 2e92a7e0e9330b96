"""A JupyterLab server on this machine, for tests of what notebooks show and of the picker in them."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import nbformat
import pytest

# a program of any environment: its kernel runs in the one of the tests, whose extensions it shows
PROGRAM = shutil.which("jupyter-lab") or shutil.which(
    "jupyter-lab", path=Path(sys.executable).parent
)
needs_jupyterlab = pytest.mark.skipif(PROGRAM is None, reason="no JupyterLab on this machine")
ROOT = Path(__file__).parents[3]
START_S = 60.0


class JupyterLab:
    """One server with a folder and settings of its own, which nothing of the user's reaches."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        kernel = folder / "data" / "kernels" / "python3"
        kernel.mkdir(parents=True)
        command = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
        record = {"argv": command, "display_name": "tested", "language": "python"}
        (kernel / "kernel.json").write_text(json.dumps(record), encoding="utf-8")
        runtime = folder / "runtime"
        settings = {
            "JUPYTER_CONFIG_DIR": str(folder / "config"),
            "JUPYTER_DATA_DIR": str(folder / "data"),
            "JUPYTER_RUNTIME_DIR": str(runtime),
            # the first kernel of a name is taken
            "JUPYTER_PATH": os.pathsep.join(
                (str(folder / "data"), str(Path(sys.prefix) / "share" / "jupyter"))
            ),
            "IPYTHONDIR": str(folder / "ipython"),
            "PYTHONPATH": str(ROOT),
        }
        self._log = (folder / "server.log").open("w", encoding="utf-8")
        self._process = subprocess.Popen(
            [
                PROGRAM,
                "--no-browser",
                "--allow-root",
                "--ServerApp.port=0",
                "--ServerApp.ip=127.0.0.1",
                f"--ServerApp.root_dir={folder}",
                "--IdentityProvider.token=",
                "--LabApp.expose_app_in_browser=True",
                "--LabApp.news_url=",
            ],
            env=os.environ | settings,
            stdout=self._log,
            stderr=subprocess.STDOUT,
        )
        self.address = self._wait(runtime)

    def _wait(self, runtime: Path) -> str:
        end = time.monotonic() + START_S
        while time.monotonic() < end:
            for path in runtime.glob("jpserver-*.json"):
                text = path.read_text(encoding="utf-8")
                if text:
                    return json.loads(text)["url"]
            assert self._process.poll() is None, (self.folder / "server.log").read_text()
            time.sleep(0.1)
        raise TimeoutError("JupyterLab does not start")

    def notebook(self, name: str, cells: list[str]) -> str:
        """Store a notebook; return the address that opens it alone."""
        book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(text) for text in cells])
        book.metadata["kernelspec"] = {
            "name": "python3",
            "display_name": "tested",
            "language": "python",
        }
        nbformat.write(book, self.folder / f"{name}.ipynb")
        return f"{self.address}doc/tree/{name}.ipynb"

    def close(self) -> None:
        """End the server, and with it its kernels."""
        self._process.terminate()
        try:
            self._process.wait(20)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._log.close()
