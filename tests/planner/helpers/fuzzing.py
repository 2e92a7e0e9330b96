"""Every reader with a good file, ways to damage it, and what reading it means; mutants have numbers, to be kept."""

from __future__ import annotations

import json
import random
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from file_mutants import damaged_json as damaged_fields
from file_mutants import damaged_toml
from graph_examples import small_graph
from mesh_files import corners, glb_bytes, obj_text, off_text, ply_bytes, stl_bytes, stl_text
from part_mutants import damaged_bytes, damaged_encoding, damaged_glb, damaged_numbers, damaged_xml
from plan_examples import ENTITIES, plan, setting
from solids import l_block

from aspectgraph import ReadLimits, read_entities, read_graphml, read_solid, write_graphml
from aspectgraph.exceptions import AspectGraphError
from errors.exceptions import MeasurementModelError
from errors.measurands.measurand import kinds
from ga.exceptions import GAError
from planner import Camera, look_at
from planner.exceptions import PlannerError
from planner.files import encoded
from planner.plan import read_plan
from planner.request.dimension_files import read_wanted
from planner.request.resolve import resolve_wanted
from planner.resume import PlanningState
from planner.sensor_setting import Outcome

OWN = (AspectGraphError, MeasurementModelError, GAError, PlannerError)
SOLID = l_block()
LOOPS = [face.outer for face in SOLID.faces]
STEP_FILE = Path(__file__).parents[3] / "examples" / "mfcad_6-11-11-19.step"
CAMERA = """focal_length_mm = 25.0
pixel_pitch_mm = [0.00345, 0.00345]
resolution = [2448, 2048]
f_number = 8.0
focus_distance_mm = 600.0
name = "cell 7"
"""
EDGES = """step = 3
rim = 1
slot = [[0, 0, 0], [3, 0, 0]]
"""
WANTED = """plain = 3
long = { length = 4, accuracy = 0.99 }
step = { distance = [3, 5], max_error = 0.02 }
inch = { edge = 4, tolerance = [-0.001, 0.001], unit = "in", share = 0.5 }
ends = [[0, 0, 0], [3, 0, 0]]
"""
TABLE = "name,id\nstep,3\nrim,e1\nslot,0,0,0,3,0,0\n"


class Reader(NamedTuple):
    """A reader under test.

    Attributes
    ----------
    good : callable
        Returns the bytes of a file that is read without complaint.
    damages : tuple of callable
        Each takes these bytes and a random generator of NumPy, and returns others.
    read : callable
        Takes the path; returns anything or raises one of `OWN`.
    """

    good: Callable[[], bytes]
    damages: tuple[Callable[[bytes, np.random.Generator], bytes], ...]
    read: Callable[[Path], Any]


def _fields(data: bytes, rng: np.random.Generator) -> bytes:
    return damaged_fields(json.loads(data), random.Random(int(rng.integers(2**63))))


def _lines(data: bytes, rng: np.random.Generator) -> bytes:
    return damaged_toml(data.decode(), random.Random(int(rng.integers(2**63))))


def _state() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "state.json"
        state = PlanningState({"entities": ENTITIES}, path)
        state.put(["bottom"], Outcome(reason="hidden"))
        state.put(
            ["top front", "top right"],
            Outcome(setting((40.0, -180.0, 620.0), ["top front", "top right"])),
        )
        poses = look_at([[0.0, 1.0, 200.0], [3.0, 4.0, 500.0]], (0.0, 0.0, 0.0), roll=0.3)
        pools = {"realised": {"poses": poses}, "near": {"poses": poses[:1]}}
        entries = {"proven": [2, "boxes"]}
        state.keep(
            {"stage": "lower bound", "pools": pools, "uninspectable": {}, "entries": entries}
        )
        state.save()
        return path.read_bytes()


def _graph() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        write_graphml(small_graph(), Path(folder) / "g.graphml")
        return (Path(folder) / "g.graphml").read_bytes()


def _wanted(path: Path) -> Any:
    return resolve_wanted(SOLID, read_wanted(path, kinds()), 0.98)


def _as_json(toml: str) -> bytes:
    import tomllib

    return json.dumps(tomllib.loads(toml)).encode()


TEXT = (damaged_bytes, damaged_numbers)
READERS = {
    "binary.stl": Reader(lambda: stl_bytes(corners(SOLID)), (damaged_bytes,), read_solid),
    "text.stl": Reader(lambda: stl_text(corners(SOLID)), TEXT, read_solid),
    "part.obj": Reader(lambda: obj_text(SOLID.vertices, LOOPS), TEXT, read_solid),
    "part.off": Reader(lambda: off_text(SOLID.vertices, LOOPS), TEXT, read_solid),
    "text.ply": Reader(lambda: ply_bytes(SOLID.vertices, LOOPS), TEXT, read_solid),
    "binary.ply": Reader(
        lambda: ply_bytes(SOLID.vertices, LOOPS, "binary_big_endian"), (damaged_bytes,), read_solid
    ),
    "part.glb": Reader(
        lambda: glb_bytes(SOLID.vertices, SOLID.triangles), (damaged_bytes, damaged_glb), read_solid
    ),
    "part.step": Reader(
        STEP_FILE.read_bytes,
        TEXT,
        lambda path: read_solid(path, limits=ReadLimits(time_s=20.0, memory_mb=1000.0)),
    ),
    "graph.graphml": Reader(_graph, (*TEXT, damaged_encoding, damaged_xml), read_graphml),
    "entities.toml": Reader(EDGES.encode, (*TEXT, _lines), lambda path: read_entities(path, SOLID)),
    "entities.json": Reader(
        lambda: _as_json(EDGES), (*TEXT, _fields), lambda path: read_entities(path, SOLID)
    ),
    "entities.csv": Reader(TABLE.encode, TEXT, lambda path: read_entities(path, SOLID)),
    "wanted.toml": Reader(WANTED.encode, (*TEXT, _lines), _wanted),
    "wanted.json": Reader(lambda: _as_json(WANTED), (*TEXT, _fields), _wanted),
    "camera.toml": Reader(CAMERA.encode, (*TEXT, _lines), Camera.from_toml),
    "plan.json": Reader(
        lambda: json.dumps(encoded(plan().to_dict())).encode(), (*TEXT, _fields), read_plan
    ),
    "state.json": Reader(
        _state, (*TEXT, _fields), lambda path: PlanningState({"entities": ENTITIES}, path)
    ),
}


def mutant(name: str, seed: int, good: bytes) -> bytes:
    """Return the mutant of a reader's good file with a number, the same on every machine."""
    rng = np.random.default_rng([sorted(READERS).index(name), seed])
    damages = READERS[name].damages
    return damages[rng.integers(len(damages))](good, rng)


def outcome(name: str, path: Path) -> str:
    """Read a file: return "read", or "refused" if it is by an own error of one line; all else is raised."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            READERS[name].read(path)
        except OWN as error:
            if "\n" in str(error) or not str(error):
                raise AssertionError(
                    f"an error must be one line. Got {str(error)[:500]!r}"
                ) from error
            return "refused"
    return "read"
