"""STEP files: read with OCCT in a process of its own, solid by solid, in millimetres."""

from __future__ import annotations

import io
import json
import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aspectgraph import exceptions
from aspectgraph.exceptions import MissingExtraError, ReadError, SolidError, how_to_install
from aspectgraph.files import (
    ReadLimits,
    SolidChoice,
    SolidEntry,
    as_choice,
    list_text,
    more_of,
    with_labels,
)
from aspectgraph.phases import phase, report_phase
from aspectgraph.read.join_faces import Tessellation, assemble
from aspectgraph.read.mesh import repair_facets
from aspectgraph.read.step.fit import RELATIVE_CHORD, check_fit, unpack_circles
from aspectgraph.read.step.server import LENGTHS, OUT_OF_MEMORY
from aspectgraph.solid.checks import RELATIVE_PLANARITY
from aspectgraph.solid.solid import FileSolids, Solid
from aspectgraph.solid.topology import signed_volume

# The caller's side of the STEP kernel's process: requests out, checked answers back, within
# limits.


_PROGRAM = """
import sys
sys.path[:] = {path!r}
from aspectgraph.read.step.server import serve
serve({parent!r}, {memory_mb!r})
"""


class StepKernel:
    """A process with the STEP kernel; to be used in a ``with`` block, at whose end it is gone.

    Parameters
    ----------
    name : str
        Name of the file, for messages.
    limits : ReadLimits
        The time limit is for all requests together.

    Raises
    ------
    MissingExtraError
        The package cadquery-ocp-novtk is not installed.
    ReadError
        The file crashed the kernel, or made it exceed a limit.
    """

    def __init__(self, name: str, limits: ReadLimits) -> None:
        self.name = name
        self.limits = limits
        self.seconds_left = limits.time_s

    def __enter__(self) -> StepKernel:
        program = _PROGRAM.format(
            path=sys.path,
            parent=os.getpid(),
            memory_mb=self.limits.memory_mb,
        )
        self.process: subprocess.Popen[bytes] = subprocess.Popen(
            [sys.executable, "-c", program],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
        )
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self._requests = self.process.stdin
        self._answers = self.process.stdout
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()
        self._answers.close()
        try:
            self._requests.close()
        except OSError:
            # a request that could not be delivered any more
            return

    def ask(self, do: str, **options: Any) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Send a request and return its answer: JSON values and arrays."""
        timed_out = threading.Event()

        def stop() -> None:
            timed_out.set()
            self.process.kill()

        timer = threading.Timer(self.seconds_left, stop)
        timer.daemon = True
        started = time.monotonic()
        timer.start()
        try:
            answer = self._exchange({"do": do, "time_s": self.seconds_left, **options})
        finally:
            timer.cancel()
            self.seconds_left = max(self.seconds_left - (time.monotonic() - started), 1e-3)
        if answer is None:
            raise self._death(timed_out.is_set())
        header, arrays = answer
        if "error" in header:
            raise self._complaint(header)
        return header, arrays

    def _exchange(
        self, request: dict[str, Any]
    ) -> tuple[dict[str, Any], dict[str, np.ndarray]] | None:
        """Return the answer to a request, or None if the process died."""
        try:
            self._requests.write(json.dumps(request).encode() + b"\n")
            self._requests.flush()
        except OSError:
            # gone; what it said last may still be in the pipe
            pass
        while (answer := self._next_answer()) is not None and "phase" in answer[0]:
            report_phase(*answer[0]["phase"])
        return answer

    def _next_answer(self) -> tuple[dict[str, Any], dict[str, np.ndarray]] | None:
        head = self._answers.read(LENGTHS.size)
        if len(head) < LENGTHS.size:
            return None
        sizes = LENGTHS.unpack(head)
        header, packed = (self._answers.read(size) for size in sizes)
        if (len(header), len(packed)) != sizes:
            return None
        with np.load(io.BytesIO(packed), allow_pickle=False) as archive:
            return json.loads(header), dict(archive)

    def _death(self, timed_out: bool) -> ReadError:
        self.process.kill()
        code = self.process.wait()
        if timed_out or code == -getattr(signal, "SIGALRM", 0):
            written = f"time_s={self.limits.time_s:g}"
            more = more_of("time_s")
            more["mentions"] = (written, *more["mentions"])
            return ReadError.of_rule(
                "",
                f"a STEP file must be read within {written} seconds",
                f"{self.name}, which takes longer",
                **more,
            )
        if code == OUT_OF_MEMORY:
            return self._complaint({"error": "MemoryError"})
        end = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        return ReadError(
            f"a STEP file must be one that OCCT can read. Got {self.name}, on which it crashes ({end}), or runs out of "
            f"its memory_mb={self.limits.memory_mb:g} MB."
        )

    def _complaint(self, header: dict[str, Any]) -> ReadError:
        if header["error"] == "MemoryError":
            return ReadError.of_rule(
                "",
                f"a STEP file must be read within memory_mb={self.limits.memory_mb:g} MB",
                f"{self.name}, which takes more",
                **more_of("memory_mb"),
            )
        if header["error"] == "MissingExtraError":
            return MissingExtraError(
                f"STEP files need the package cadquery-ocp-novtk, 8 or newer. Got {header['message']}; "
                f"{how_to_install('step')}"
            )
        if header["error"] == "KernelError":
            return ReadError(
                f"a STEP file must be one that OCCT can read. Got {self.name}, on which it stops with "
                f"{header['message']}."
            )
        return getattr(exceptions, header["error"])(header["message"])


# STEP files: read with OCCT in a process of its own, solid by solid, in millimetres.


RELATIVE_VOLUME = 1e-9
"""Flat solids that become one body keep their volume up to this share of it: rounding."""

MOST_REFINED_FACETS = 1_000_000
"""A chord tolerance that would give more facets is not tried: to check a surface of so many takes minutes."""

_REFINED_GROWTH = 4.0
_MAX_REFINEMENTS = 3


def read_step(
    path: Path,
    *,
    chord_tolerance_mm: float | None = None,
    angular_tolerance_deg: float | None = None,
    planarity_mm: float | None = None,
    gap_mm: float | None = None,
    solids: int | str | Sequence[int | str] | SolidChoice | None = None,
    name: str = "",
    limits: ReadLimits | None = None,
) -> Solid:
    """Read the solids of a STEP file as one polyhedral solid, in mm.

    Parameters
    ----------
    path : Path
        An uncompressed STEP file.
    chord_tolerance_mm : float, optional
        Largest distance between a curved face and the flat facets that stand for it. Default: a thousandth of the
        bounding box diagonal. If the facets of neighbouring walls would run into each other, a quarter of it is tried,
        up to three times, unless this gives more than a million facets; a tolerance given is never exceeded.
    angular_tolerance_deg : float, optional
        Largest turn between neighbouring chords of a curve. Default: 30.
    planarity_mm : float, optional
        Facets this close to one plane become one face; see `assemble`.
    gap_mm : float, optional
        How far apart vertices, edges and faces that should meet may lie; default: by the rule of `step_fit`.
    solids : int, str, sequence of them, or SolidChoice, optional
        Which solids of the file to read, by their names, or counted from 0 in the order of the file, damaged ones
        included; default: all. Solids that touch become one body.
    name : str
        Name of the file, without its ending.
    limits : ReadLimits, optional
        What the kernel may take.

    Raises
    ------
    MissingExtraError
        The package cadquery-ocp-novtk is not installed.
    ReadError
        The file is not a STEP file, holds no closed solid, a solid asked for is damaged, or a limit is exceeded.
    SolidError
        A solid is not valid, or solids overlap, or touch in a line or a point only.
    """
    angle_deg = 30.0 if angular_tolerance_deg is None else float(angular_tolerance_deg)
    with StepKernel(Path(path).name, limits or ReadLimits()) as kernel:
        with phase("load the STEP file"):
            loaded, _ = kernel.ask("load", path=str(Path(path).absolute()), name=Path(path).name)
        choice = as_choice(solids)
        entries: tuple[SolidEntry, ...] = ()
        if len(loaded["damage"]) > 1 or choice.has_names:
            entries = _entries(kernel)
        chosen, measured = _select(loaded["damage"], choice.numbered(entries), kernel.name, entries)
        size, arrays = kernel.ask("select", solids=chosen, relative_planarity=RELATIVE_PLANARITY)
        diagonal = size["diagonal_mm"]
        notes = loaded["notes"] + _about_facets(size["faceted"])
        notes += check_fit(size["fits"], chosen, diagonal, gap_mm, Path(path).name)
        chord = (
            diagonal * RELATIVE_CHORD if chord_tolerance_mm is None else float(chord_tolerance_mm)
        )
        try:
            faceted = [
                _facets(i, arrays, planarity_mm, hidden=i not in measured) for i in size["faceted"]
            ]
            if len(chosen) > 1:
                notes += _merge(kernel, chosen, measured, chord, angle_deg)
            n_before = 0
            for attempt in range(_MAX_REFINEMENTS + 1):
                parts = _tessellate(kernel, chord / 4.0**attempt, angle_deg)
                n_facets = sum(len(part.triangles) for part in parts)
                solid = _build(
                    parts + faceted,
                    chord_mm=chord / 4.0**attempt,
                    angle_deg=angle_deg,
                    planarity_mm=planarity_mm,
                    notes=notes,
                    name=name,
                    last=attempt == _MAX_REFINEMENTS or _too_many(n_before, n_facets),
                )
                n_before = n_facets
                if solid is not None:
                    solid.file_solids = _file_solids(chosen, measured, entries, size["n_faces"])
                    return solid
        except SolidError as error:
            if len(chosen) == 1:
                raise
            holds = f"The file holds {len(chosen)} solids: {_chosen_text(entries, chosen)}; "
            holds += "read some of them with, for instance,"
            vars(error).update(_choosing(holds, chosen[:1]))
            raise
    raise AssertionError("the last attempt returns or raises")


def _file_solids(
    chosen: Sequence[int], measured: Sequence[int], entries: tuple[SolidEntry, ...], n_faces: int
) -> FileSolids:
    occluders = tuple(i for i in chosen if i not in measured)
    return FileSolids(tuple(measured), occluders, entries, n_faces)


def list_step(path: Path, *, limits: ReadLimits | None = None) -> tuple[SolidEntry, ...]:
    """Return the solids of a STEP file, without any mesh.

    Parameters
    ----------
    path : Path
        An uncompressed STEP file.
    limits : ReadLimits, optional
        What the kernel may take.

    Raises
    ------
    ReadError
        As `read_step` raises it.
    """
    with StepKernel(Path(path).name, limits or ReadLimits()) as kernel:
        with phase("load the STEP file"):
            kernel.ask("load", path=str(Path(path).absolute()), name=kernel.name)
        return _entries(kernel)


def _entries(kernel: StepKernel) -> tuple[SolidEntry, ...]:
    """Return the solids of the file that a kernel has loaded."""
    rows = kernel.ask("list")[0]["solids"]
    entries = []
    for number, row in enumerate(rows):
        size = row.pop("size_mm")
        size_mm = None if size is None else (size[0], size[1], size[2])
        entries.append(SolidEntry(number, size_mm=size_mm, **row))
    return with_labels(entries)


def _chosen_text(entries: Sequence[SolidEntry], chosen: list[int]) -> str:
    """Return the solids that were read, for an error about them."""
    numbers = set(chosen)
    return list_text([entry for entry in entries if entry.number in numbers])


def _too_many(n_before: int, n_now: int) -> bool:
    """Return whether a finer chord tolerance would give more facets than can be worked with.

    Their number is taken to grow as it did last; the first time, as it does where a surface is bent both ways.
    """
    growth = n_now / n_before if n_before else _REFINED_GROWTH
    return n_now * growth > MOST_REFINED_FACETS


def _merge(
    kernel: StepKernel, chosen: list[int], measured: list[int], chord_mm: float, angle_deg: float
) -> list[str]:
    """Make solids that touch one body; return what was done."""
    answer, _ = kernel.ask("merge", solids=chosen, measured=measured, name=kernel.name)
    occluders = [i for i in chosen if i not in measured]
    notes = (
        [f"{_listed(occluders)} {'is' if len(occluders) == 1 else 'are'} in the way only"]
        if occluders
        else []
    )
    if not answer["merged"]:
        return notes
    before = _tessellate(kernel, chord_mm, angle_deg, merged=False)
    after = _tessellate(kernel, chord_mm, angle_deg)
    # facets leave a curved face by the chord tolerance, before and after; flat ones do not
    allowed = 2.0 * chord_mm * sum(_curved_area(part) for part in (*before, *after))
    volume, merged_volume = (
        sum(signed_volume(part.vertices, part.triangles) for part in parts)
        for parts in (before, after)
    )
    if not abs(merged_volume - volume) <= max(allowed, RELATIVE_VOLUME * volume):
        raise ReadError.of_rule(
            "",
            "solids in contact must keep their volume when they are joined",
            f"{merged_volume:.9g} of {volume:.9g} mm³ for {_listed(chosen)} of {kernel.name}",
            **_choosing("read some of them with, for instance,", chosen[:1]),
        )
    bodies = [_listed(sorted(group)) for group in answer["merged"]]
    return notes + [
        f"{body} touch and are one body; edges inside a contact are gone" for body in bodies
    ]


def _listed(numbers: list[int]) -> str:
    head = numbers[:-1]
    tail = str(numbers[-1])
    return f"solids {', '.join(map(str, head))} and {tail}" if head else f"solid {tail}"


def _curved_area(part: Tessellation) -> float:
    corners = part.vertices[part.triangles[part.curved_patch[part.patch]]]
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return 0.5 * float(np.linalg.norm(doubled, axis=1).sum())


def _tessellate(
    kernel: StepKernel, chord_mm: float, angle_deg: float, merged: bool = True
) -> list[Tessellation]:
    answer, arrays = kernel.ask(
        "tessellate", chord_mm=chord_mm, angle_rad=math.radians(angle_deg), merged=merged
    )
    parts = []
    for k in range(answer["n"]):
        vertices, triangles, patch, curved_patch, chords, *circles, pairs, turns = (
            arrays[f"{k}_{i}"] for i in range(10)
        )
        curved_edges = set(map(tuple, chords.tolist()))
        surface_turns = dict(zip(map(tuple, pairs.tolist()), turns.tolist(), strict=True))
        circular = unpack_circles(*circles)
        parts.append(
            Tessellation(
                vertices, triangles, patch, curved_patch, curved_edges, circular, surface_turns
            )
        )
    return parts


def _facets(
    solid: int, arrays: dict[str, np.ndarray], planarity_mm: float | None, hidden: bool
) -> Tessellation:
    """Return the facets that the file states of a solid, repaired as those of a mesh are."""
    # a face repeats the vertices on its edges and may run either way round; that is no damage, and no news
    facets, _ = repair_facets(
        arrays[f"{solid}_vertices"], arrays[f"{solid}_triangles"], planarity_mm, []
    )
    if hidden:
        # what only stands in the way has no edges to measure
        pairs = np.sort(facets.triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
        facets.curved_edges = set(map(tuple, pairs.tolist()))
    return facets


def _about_facets(solids: list[int]) -> list[str]:
    """Return a note on solids without surfaces."""
    if not solids:
        return []
    have = "has" if len(solids) == 1 else "have"
    return [f"{_listed(solids)} {have} tessellated geometry only; the facets are read like a mesh"]


def _build(
    parts: list[Tessellation],
    *,
    chord_mm: float,
    angle_deg: float,
    planarity_mm: float | None,
    notes: list[str],
    name: str,
    last: bool,
) -> Solid | None:
    """Return the solid, or None if its facets run into each other and a finer chord tolerance could help."""
    curved = any(part.curved_patch.any() for part in parts)
    notes = list(notes)
    if curved:
        notes.append(
            f"curved faces tessellated with a chord tolerance of {chord_mm:.4g} mm and {angle_deg:g} degrees"
        )
    if len(parts) > 1:
        notes.append(f"{len(parts)} solids")
    try:
        return assemble(_concatenate(parts), name=name, planarity_mm=planarity_mm, notes=notes)
    except SolidError:
        if last or not curved:
            raise
        return None


def _concatenate(parts: list[Tessellation]) -> Tessellation:
    first_vertex = np.cumsum([0] + [len(part.vertices) for part in parts]).tolist()
    first_patch = np.cumsum([0] + [len(part.curved_patch) for part in parts]).tolist()
    curved = {
        (a + v, b + v)
        for part, v in zip(parts, first_vertex, strict=False)
        for a, b in part.curved_edges
    }
    turns = {
        (a + v, b + v): turn
        for part, v in zip(parts, first_vertex, strict=False)
        for (a, b), turn in part.surface_turns.items()
    }
    circular = [
        edge._replace(vertices=tuple(a + v for a in edge.vertices))
        for part, v in zip(parts, first_vertex, strict=False)
        for edge in part.circular_edges or ()
    ]
    return Tessellation(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.triangles + v for part, v in zip(parts, first_vertex, strict=False)]),
        np.concatenate([part.patch + p for part, p in zip(parts, first_patch, strict=False)]),
        np.concatenate([part.curved_patch for part in parts]),
        curved,
        None if all(part.circular_edges is None for part in parts) else circular,
        turns,
        {k + p for part, p in zip(parts, first_patch, strict=False) for k in part.faceted_patches},
    )


def _select(
    damage: list[str], choice: SolidChoice, name: str, entries: Sequence[SolidEntry]
) -> tuple[list[int], list[int]]:
    """Return the solids to read, and which of them to measure; a damaged one among them is refused."""
    n = len(damage)
    measured, occluders = choice.split(n)
    chosen = measured + occluders
    range_text = f"some of 0..{n - 1} of {name}" if n > 1 else f"0, the only solid of {name}"
    for parameter, numbers in (("solids", measured), ("occluders", occluders)):
        if any(not 0 <= i < n for i in numbers):
            hint = ""
            if n > 1:
                hint = f"it holds {list_text(entries)}"
            raise ReadError.of_rule(parameter, f"must name {range_text}", str(numbers), hint=hint)
    if not measured:
        parameter = "occluders" if occluders else "solids"
        raise ReadError.of_rule(parameter, "must leave a solid to measure", str(occluders))
    if len(set(chosen)) < len(chosen):
        raise ReadError.of_rule("solids", "must name each solid once", str(chosen))
    for i in chosen:
        if damage[i]:
            whole = [k for k in range(n) if not damage[k]]
            which = f" (solid {i} of 0..{n - 1})" if n > 1 else ""
            raise ReadError.of_rule(
                "",
                "the geometry of a STEP file must be whole",
                f"{name} with {damage[i]}{which}",
                **(_choosing("Ask for the whole ones with", whole) if whole else {}),
            )
    return chosen, measured


def _choosing(words: str, solids: list[int]) -> dict[str, Any]:
    """Return the hint of an error to read these solids, with the argument it mentions."""
    argument = f"solids={solids}"
    return {"hint": f"{words} {argument}", "mentions": (argument,)}
