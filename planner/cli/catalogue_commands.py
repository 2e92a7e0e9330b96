"""The commands about the catalogue: which cameras there are, and which of their parts suit a request."""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING, Any

from planner.camera.camera import Camera
from planner.camera.catalogue import camera_names, camera_parts
from planner.camera.pose_uncertainty import PoseUncertainty
from planner.cli.process.exit_codes import DONE, INCOMPLETE
from planner.inspection_options import InspectionOptions
from planner.optics.proposal import optics_table
from planner.optics.propose import DISTANCES_MM, propose_optics
from planner.output import terminal_tables
from planner.output.json_records import print_json
from planner.wanted.dimension import Dimension
from planner.wanted.feature_counts import features_text, n_not_planned

if TYPE_CHECKING:
    from collections.abc import Mapping

    from aspectgraph import Solid


def cameras(options: argparse.Namespace) -> int:
    """List the catalogue: its cameras, or where the facts on their parts were read."""
    if options.sources:
        parts = camera_parts()
        if options.json:
            # JSON knows no infinity: an iris that closes fully has no narrowest aperture
            print_json(
                {
                    kind: {name: _finite(one) for name, one in of.items()}
                    for kind, of in parts.items()
                }
            )
        else:
            terminal_tables.print_sources(parts)
        return DONE
    found = [Camera.named(name) for name in camera_names()]
    if options.json:
        print_json([one.to_dict() for one in found])
    else:
        terminal_tables.print_cameras(found)
    return DONE


def rank_optics(
    options: argparse.Namespace, solid: Solid, items: Mapping[str, Any], limits: InspectionOptions
) -> int:
    """Print bodies and lenses, ranked by how well they measure what is wanted; return the exit code."""
    found = propose_optics(
        solid,
        items,
        PoseUncertainty.isotropic(translation_mm=options.sigma_mm, rotation_rad=options.sigma_rad),
        bodies=options.body,
        accuracy=options.accuracy,
        probability=options.probability,
        distances_mm=options.distances or DISTANCES_MM,
        options=limits,
    )
    counts = [item.n_features for item in items.values() if isinstance(item, Dimension)]
    features = {"n": sum(counts), "not_planned": n_not_planned(counts)}
    if options.json:
        shown = [one.to_dict() for one in found[: options.rows]]
        print_json([{**record, "features": features} if counts else record for record in shown])
    else:
        print(optics_table(found, options.rows))
        if features_text(counts):
            print(f"{features_text(counts)}; optics are ranked by one feature of each dimension")
    return DONE if found and len(found[0].able) == len(items) else INCOMPLETE


def _finite(facts: Mapping[str, Any]) -> dict[str, Any]:
    return {key: None if value == math.inf else value for key, value in facts.items()}
