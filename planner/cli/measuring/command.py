"""The command that measures images: values with uncertainties and decisions."""

from __future__ import annotations

import argparse
from pathlib import Path

from errors.measurands import DecisionRule
from planner.cli.job import check_same_part, read_part
from planner.cli.process.exit_codes import DONE, INCOMPLETE, NOT_REGISTERED
from planner.files import absolute, output_folder, path_text, staged_folder
from planner.measuring.measurer import MeasureOptions, Measurer
from planner.measuring.poses.registration import Registration
from planner.output import terminal_tables
from planner.output.measured_table import print_results
from planner.plan import read_plan
from planner.records.json_file import print_json

FILES = ("results.json", "results.csv")

_RULES = {
    "iso": DecisionRule.iso14253(),
    "simple": DecisionRule.simple(),
    "guard": DecisionRule.guard(),
}


def measure(options: argparse.Namespace) -> int:
    """Measure a part in images of a plan's settings."""
    plan = read_plan(options.plan)
    how = MeasureOptions(
        _registration(options), coverage=options.coverage, rule=_RULES[options.rule]
    )
    out = absolute(options.out)
    with output_folder(out, FILES, "--out"):
        solid = read_part(options)
        check_same_part(solid, plan, options.part)
        results = Measurer(plan, solid).measure(
            options.images,
            how,
            serial=options.serial or "",
            partial=options.partial,
            allow_lossy=options.allow_lossy,
        )
        with staged_folder(out, FILES, "--out") as staging:
            results.write(staging / "results.json")
            results.write_csv(staging / "results.csv")
    if options.json:
        print_json(results.to_dict())
    else:
        print_results(results)
        files = [path_text(out / name) for name in FILES]
        terminal_tables.print_written(files, path_text(out), files[-1])
    if results.failed:
        return NOT_REGISTERED
    fine = results.measured if options.exit == "measured" else results.conforms
    return DONE if fine else INCOMPLETE


def _registration(options: argparse.Namespace) -> Registration:
    if options.register == "none":
        return Registration.none(options.surfaces_mm)
    if options.register == "edges":
        return Registration.own_edges(options.surfaces_mm)
    return Registration.read(Path(options.register), options.surfaces_mm)
