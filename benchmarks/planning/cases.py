"""Parts, cameras and entity sets that the comparisons of optimisers and planners share.

The two blocks are the objects of Tables I and II of Yang and Ciarallo (2001), reconstructed: the drawings have no
dimensions. They are inspected with the paper's variances and pixel pitch; focal length, resolution and focus are ours.
NIST's CTC-01 is inspected by the example camera on a coarse arm (0.5 mm, 0.02 rad) with an accuracy of 99 %: with a
good arm nearly every pose reaches P = 1 and there would be nothing to compare.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from aspectgraph import compute_regions, read_entities, read_solid
from planner import Camera, PoseUncertainty
from planner.request.camera_limits import default_workspace

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"

PAPER_CAMERA = Camera(
    25.0, (0.01, 0.013), (640, 480), 8.0, 300.0, largest_blur_mm=0.03, name="paper"
)
PAPER_UNCERTAINTY = PoseUncertainty(np.diag([0.03] * 3 + [0.003] * 3))
COARSE_ARM = PoseUncertainty.isotropic(translation_mm=0.5, rotation_rad=0.02)


@dataclass(frozen=True)
class Setup:
    """A part, what to inspect on it, and with what.

    Attributes
    ----------
    part, entities : str
        File names in the examples.
    camera : callable
        Returns the camera.
    pose_uncertainty : PoseUncertainty
        How far the real pose may be from the planned one.
    accuracy : float
        Required accuracy A.
    field_margin_px : float
        Strip of the image to keep free.
    """

    part: str
    entities: str
    camera: Callable[[], Camera]
    pose_uncertainty: PoseUncertainty
    accuracy: float
    field_margin_px: float


SETUPS = {
    "block": Setup(
        "two_pocket_block.off",
        "two_pocket_block_entities.toml",
        lambda: PAPER_CAMERA,
        PAPER_UNCERTAINTY,
        0.98,
        0.0,
    ),
    "slotted": Setup(
        "slotted_block.off",
        "slotted_block_entities.toml",
        lambda: PAPER_CAMERA,
        PAPER_UNCERTAINTY,
        0.98,
        0.0,
    ),
    "ctc": Setup(
        "nist_ctc_01_ap242.stp",
        "nist_ctc_01_entities.toml",
        lambda: Camera.from_toml(EXAMPLES / "camera.toml"),
        COARSE_ARM,
        0.99,
        20.0,
    ),
}

TABLE_IV = [
    ("e1", "e2"),
    ("e1", "e2", "e3"),
    ("e1", "e2", "e3", "e4", "e5"),
    ("e1", "e2", "e4", "e5"),
]
"""The four sets of the paper's Table IV."""

CASES = [
    *(("block", names) for names in TABLE_IV),
    ("block", ("e1", "e2", "e3", "e4", "e5", "e6")),
    ("block", ("e3",)),
    ("block", ("e3", "e6")),
    ("block", ("e4", "e5", "e6")),
    ("slotted", ("e1", "e2")),
    ("slotted", ("e2", "e3")),
    ("slotted", ("e1", "e4")),
    ("ctc", ("web_back", "boss_top_left")),
    ("ctc", ("boss_top_left", "boss_top_right", "web_back")),
    ("ctc", ("boss_top_left", "boss_top_right", "boss_corner_front")),
    ("ctc", ("slot_front", "slot_back", "ear_front_left")),
    ("ctc", ("slot_back", "ear_back_left")),
    ("ctc", ("window_left", "window_back")),
    ("ctc", ("window_left", "window_back", "ear_front_right")),
    ("ctc", ("chamfer_back_right", "window_back")),
    ("ctc", ("plate_left", "ear_front_left")),
]
"""Twenty sets of entities, each as (setup, names)."""

FEW = [CASES[i] for i in (0, 2, 7, 8, 12, 16)]
"""Six of them, for comparisons over several seeds."""


@cache
def regions(setup: str):
    """Return the visibility regions of a set-up's part for all its entities."""
    chosen = SETUPS[setup]
    solid = read_solid(
        EXAMPLES / chosen.part, **({"units": "mm"} if chosen.part.endswith(".off") else {})
    )
    entities = read_entities(EXAMPLES / chosen.entities, solid)
    return compute_regions(solid, entities, workspace=default_workspace(solid, chosen.camera()))


def case_name(case) -> str:
    """Return a short label of a case."""
    setup, names = case
    return f"{setup}: {', '.join(names)}"
