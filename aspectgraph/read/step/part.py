"""The part of one STEP file, as the kernel's process holds it: what it consists of, and its triangles.

Imports OCP; import this module only in that process.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from aspectgraph.read.step.fit import pack_circles
from aspectgraph.read.step.geometric_tolerances import WITH_TEXTS as TOLERANCES
from aspectgraph.read.step.names import StepNames
from aspectgraph.read.step.solids import Slot, diagonal_mm, edge_map, load_solids, merge_touching
from aspectgraph.read.step.stated_dimensions import LOCATIONS, SIZES, WITH_TEXTS, list_dimensions
from aspectgraph.read.step.text import parse_entities, parse_texts
from aspectgraph.read.step.triangles import measure_gaps, tessellate


class StepPart:
    """Loads a file once and answers what is asked about it."""

    def __init__(self) -> None:
        self.slots: list[Slot] = []
        self.names = StepNames()
        self.shapes: list[Any] = []
        self.bodies: list[Any] = []
        self.measured: Any = None
        self.solids: list[int] = []
        self.flat_mm = 0.0
        self.report: Callable[[int, int, str], None] = lambda done, total, label: None

    def answer(self, do: str, **options: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the answer to a request: JSON values and arrays."""
        requests: dict[str, Callable[..., tuple[dict[str, Any], dict[str, Any]]]]
        requests = {"load": self.load, "select": self.select, "merge": self.merge}
        requests["list"] = self.listing
        requests["tessellate"] = self.tessellate
        requests["dimensions"] = self.dimensions
        return requests[do](**options)

    def load(self, path: str, name: str) -> tuple[dict[str, Any], dict[str, Any]]:
        """Load the file; return what is wrong with which solid."""
        inventory = load_solids(Path(path), name, self.report)
        self.slots = inventory.slots
        self.names = inventory.names
        return {"damage": [slot.damage for slot in inventory.slots], "notes": inventory.notes}, {}

    def listing(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return what every solid is called, and its size."""
        n_placed = Counter(slot.number for slot in self.slots)
        rows = []
        for k, slot in enumerate(self.slots):
            self.report(k, len(self.slots), "list the solids")
            number = -1 if slot.number is None else slot.number
            instance_names = [self.names.occurrences[place].name for place in slot.instances]
            rows.append(
                {
                    "product": self.names.products.get(number, ""),
                    "instance": "/".join(filter(None, instance_names)),
                    "body": self.names.bodies.get(number, ""),
                    "n_faces": slot.n_faces(),
                    "n_placed": 1 if slot.number is None else n_placed[slot.number],
                    "size_mm": slot.size_mm(),
                }
            )
        self.report(len(self.slots), len(self.slots), "list the solids")
        return {"solids": rows}, {}

    def select(
        self, solids: list[int], relative_planarity: float
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Choose the solids to work on; return their size, how closely each fits together, and the stated facets."""
        chosen = [self.slots[i] for i in solids]
        facets = {i: slot.facets for i, slot in zip(solids, chosen, strict=True) if slot.facets}
        self.solids = [i for i in solids if i not in facets]
        self.measured = None
        self.shapes = self.bodies = [self.slots[i].shape for i in self.solids]
        diagonal = diagonal_mm(self.shapes, [part.vertices for part in facets.values()])
        self.flat_mm = diagonal * relative_planarity
        rows = []
        for k, slot in enumerate(chosen):
            self.report(k, len(chosen), "measure gaps")
            gaps = {} if slot.facets else measure_gaps(slot.shape, self.flat_mm)
            widest = {kind: [gap.gap_mm, list(gap.place)] for kind, gap in gaps.items()}
            rows.append({"uncertainty_mm": slot.uncertainty_mm, "gaps": widest})
        self.report(len(chosen), len(chosen), "measure gaps")
        arrays = {f"{i}_vertices": part.vertices for i, part in facets.items()}
        arrays |= {f"{i}_triangles": part.triangles for i, part in facets.items()}
        n_faces = sum(self.slots[i].n_faces() for i in self.solids)
        answer = {"diagonal_mm": diagonal, "fits": rows, "faceted": list(facets)}
        return {**answer, "n_faces": n_faces}, arrays

    def merge(
        self, solids: list[int], measured: list[int], name: str
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Make chosen solids that touch one body, and remember what became of the edges of those to measure."""
        bodies = merge_touching(
            self.shapes,
            self.solids,
            name,
            lambda done: self.report(done, len(self.shapes), "merge solids in contact"),
        )
        self.bodies = bodies.shapes
        if len(measured) < len(solids):
            self.measured = edge_map(
                e
                for k, number in enumerate(self.solids)
                if number in measured
                for e in bodies.edges[k]
            )
        return {"merged": [[self.solids[k] for k in group] for group in bodies.merged]}, {}

    def tessellate(
        self, chord_mm: float, angle_rad: float, merged: bool = True
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Cut the bodies, or the chosen solids as they were before some became one, into triangles."""
        arrays = {}
        shapes = self.bodies if merged else self.shapes
        for k, shape in enumerate(shapes):
            self.report(k, len(shapes), "cut curved faces into facets")
            part = tessellate(shape, chord_mm, angle_rad, self.flat_mm, self.measured)
            chords = np.array(sorted(part.curved_edges), dtype=np.int64).reshape(-1, 2)
            fields: tuple[Any, ...] = (
                part.vertices,
                part.triangles,
                part.patch,
                part.curved_patch,
                chords,
            )
            fields += pack_circles(part.circular_edges or [])
            turns = sorted(part.surface_turns.items())
            fields += (np.array([pair for pair, _ in turns], dtype=np.int64).reshape(-1, 2),)
            fields += (np.array([turn for _, turn in turns], dtype=np.float64),)
            arrays.update({f"{k}_{i}": array for i, array in enumerate(fields)})
        self.report(len(shapes), len(shapes), "cut curved faces into facets")
        return {"n": len(shapes)}, arrays

    def dimensions(self, path: str, name: str) -> tuple[dict[str, Any], dict[str, Any]]:
        """Read the semantic dimensions, as the kernel finds them and as the text states them."""
        # few files are asked for them, and the import takes time
        from aspectgraph.read.step.semantic_dimensions import read_semantic_dimensions

        data = Path(path).read_bytes()
        entities = parse_entities(data)
        texts = parse_texts(data, entities, WITH_TEXTS | TOLERANCES | SIZES | LOCATIONS)
        read = read_semantic_dimensions(Path(path), name, entities, texts)
        return {
            "found": read.dimensions,
            "surfaces": read.surfaces,
            "tolerances": read.tolerances,
            "datums": read.datums,
            "disagreements": read.disagreements,
            "stated": [asdict(stated) for stated in list_dimensions(entities, texts)],
        }, {}
