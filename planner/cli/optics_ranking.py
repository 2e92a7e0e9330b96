"""Ranking the parts of the catalogue: which bodies and lenses suit a request."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from planner.camera.pose_uncertainty import PoseUncertainty
from planner.cli.process.exit_codes import DONE, INCOMPLETE
from planner.inspection_options import InspectionOptions
from planner.optics.proposal import OPTICS_COLUMNS, OpticsProposal, optics_rows
from planner.optics.propose import DISTANCES_MM, propose_optics
from planner.progress.text_table import print_table, print_text, words
from planner.records.json_file import print_json
from planner.wanted.dimension import Dimension
from planner.wanted.words.feature_counts import features_text, n_not_planned

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from aspectgraph import Solid


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
        print_table(OPTICS_COLUMNS, optics_rows(found, options.rows))
        if features_text(counts):
            text = f"{features_text(counts)}; optics are ranked by one feature of each dimension"
            print_text(text)
    if options.write is not None:
        _write_best(found, options.write, quiet=options.json)
    return DONE if found and len(found[0].able) == len(items) else INCOMPLETE


def _write_best(found: Sequence[OpticsProposal], path: str, *, quiet: bool) -> None:
    """Write the camera of the first row, unless it measures nothing."""
    if not found or not found[0].able:
        text = (
            f"{path} was not written: no camera measures any target with the required probability"
        )
    else:
        found[0].camera.write(path)
        text = f"wrote {found[0].camera.name} to {path}; give it to plan as --camera {path}"
    if not quiet:
        print_text(words(text, [path]))
