"""The STEP kernel within the tests' own process: a process for each file takes a second or two to start.

Imports OCP.
"""

from __future__ import annotations

import json

from aspectgraph.read.step.part import StepPart


class KernelInProcess:
    """What `StepKernel` is to its caller, without the process and its limits."""

    def __init__(self, name, limits):
        self.name = name
        self.part = StepPart()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def ask(self, do, **options):
        header, arrays = self.part.answer(**json.loads(json.dumps({"do": do, **options})))
        return json.loads(json.dumps(header)), arrays


def read_in_process(monkeypatch):
    """Let STEP files be read in this process for the rest of a test."""
    monkeypatch.setattr("aspectgraph.read.step.step_file.StepKernel", KernelInProcess)
