"""The command that measures images: values with uncertainties and decisions."""

from __future__ import annotations

import argparse
from pathlib import Path

from errors.measurands import DecisionRule, Localisation
from planner.cli.job import check_same_part, read_part
from planner.cli.process.exit_codes import DONE, INCOMPLETE, NOT_REGISTERED
from planner.exceptions import RequestError
from planner.files import absolute, output_folder, path_text, staged_folder
from planner.measuring.measurer import MeasureOptions, Measurer
from planner.measuring.poses.registration import Registration
from planner.measuring.results import MeasurementResults
from planner.output import terminal_tables
from planner.output.measured_report import measured_html
from planner.output.measured_table import print_results
from planner.plan import read_plan
from planner.records.json_file import print_json

WITH_EDGES = "edges+"
"""Before the file of a board whose pose the part's own edges improve."""
QIF = "results.qif"
"""Only written if asked for; that of an earlier measurement does not stay."""
FILES = ("results.json", "results.csv", QIF, "report.html")

_RULES = {
    "iso": DecisionRule.iso14253(),
    "simple": DecisionRule.simple(),
    "guard": DecisionRule.guard(),
}


def measure(options: argparse.Namespace) -> int:
    """Measure a part in images of a plan's settings."""
    plan = read_plan(options.plan)
    how = MeasureOptions(
        _registration(options),
        _localisation(options),
        coverage=options.coverage,
        rule=_RULES[options.rule],
    )
    out = absolute(options.out)
    names = [name for name in FILES if options.qif or name != QIF]
    parts = _parts(options)
    codes = []
    records = []
    with output_folder(out, FILES, "--out"):
        solid = read_part(options)
        check_same_part(solid, plan, options.part)
        measurer = Measurer(plan, solid)
        for serial, images in parts:
            results = measurer.measure(
                images,
                how,
                serial=serial,
                partial=options.partial,
                allow_lossy=options.allow_lossy,
            )
            _write(results, out / serial if options.parts else out, options.qif)
            codes.append(_code(results, options.exit))
            records.append(results.to_dict())
            if not options.json:
                print_results(results)
    if options.json:
        print_json(records if options.parts else records[0])
    else:
        folders = [out / serial for serial, _ in parts] if options.parts else [out]
        files = [path_text(folder / name) for folder in folders for name in names]
        terminal_tables.print_written(files, path_text(out), files[-1])
    return max(codes)


def _parts(options: argparse.Namespace) -> list[tuple[str, Path]]:
    """Return name and folder of images of each part."""
    folder = Path(options.images)
    if not options.parts:
        return [(options.serial or "", folder)]
    if options.serial is not None:
        raise RequestError.of_rule("serial", "must not be given with --parts", repr(options.serial))
    found = [(path.name, path) for path in sorted(folder.iterdir()) if path.is_dir()]
    if not found:
        got = f"none in {str(folder)!r}"
        raise RequestError.of_rule("images", "must hold a folder for each part", got)
    return found


def _write(results: MeasurementResults, folder: Path, with_qif: bool) -> None:
    with staged_folder(folder, FILES, "--out") as staging:
        if with_qif:
            results.qif(staging / QIF)
        results.write(staging / "results.json")
        results.write_csv(staging / "results.csv")
        (staging / "report.html").write_text(measured_html(results), encoding="utf-8")


def _code(results: MeasurementResults, wanted: str) -> int:
    if results.failed:
        return NOT_REGISTERED
    fine = results.measured if wanted == "measured" else results.conforms
    return DONE if fine else INCOMPLETE


def _localisation(options: argparse.Namespace) -> Localisation | None:
    """Return a localisation with the floor that is asked for; of it, only this counts."""
    if options.floor_px is None:
        return None
    return Localisation.gaussian(floor_px=options.floor_px)


def _registration(options: argparse.Namespace) -> Registration:
    if options.register == "none":
        return Registration.none(options.surfaces_mm)
    if options.register == "edges":
        return Registration.own_edges(options.surfaces_mm)
    path = options.register.removeprefix(WITH_EDGES)
    if path != options.register:
        return Registration.both(path, options.surfaces_mm)
    if Path(path).suffix.lower() == ".toml":
        return Registration.fiducials(path, options.surfaces_mm)
    return Registration.read(Path(options.register), options.surfaces_mm)
