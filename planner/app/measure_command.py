"""The commands of images: measure gives values with uncertainties and decisions, render makes images to rehearse it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from aspectgraph import AspectGraphError
from errors.exceptions import MeasurementModelError
from errors.measurands import DecisionRule, Localisation
from ground.convert import from_plain, to_plain
from planner.app.checks import in_words_of_shell
from planner.app.job import check_same_part
from planner.app.options import Measure, Render
from planner.app.part import read_part
from planner.app.process import (
    BAD_INPUT,
    DONE,
    INCOMPLETE,
    INTERNAL,
    NOT_REGISTERED,
    shortage,
    write_error,
    write_fault,
)
from planner.camera.pose import PoseUncertainty
from planner.exceptions import PlanFileError, PlannerError, RequestError
from planner.files import (
    absolute,
    check_set_place,
    file_digest,
    name_text,
    output_folder,
    path_text,
    print_json,
    read_json,
    staged_folder,
    write_text,
)
from planner.identity import PartRecord
from planner.measuring.measure_options import MeasureOptions
from planner.measuring.measurer import Measurer
from planner.measuring.registration import Registration
from planner.measuring.rehearsal import ROUND_SHARE, TRUTH, Rehearsal, Truth, write_images
from planner.measuring.results import COLUMNS, FORMAT, MeasurementResults, table_of_parts
from planner.measuring.task import REPEATABILITY
from planner.plan import read_plan
from planner.progress import report, terminal_progress, visible, work_shown
from planner.report import terminal_tables
from planner.report.measured_report import measured_html, print_results
from planner.request.edge_state import EdgeState
from planner.text_table import count, print_text

if TYPE_CHECKING:
    from aspectgraph import Solid
    from planner.plan import InspectionPlan


WITH_EDGES = "edges+"
"""Before the file of a board whose pose the part's own edges improve."""
QIF = "results.qif"
"""Only written if asked for; that of an earlier measurement does not stay."""
TABLE = "results.csv"
FILES = ("results.json", TABLE, QIF, "report.html")

_RULES = {
    "iso": DecisionRule.iso14253(),
    "simple": DecisionRule.simple(),
    "guard": DecisionRule.guard(),
}


class _Images(NamedTuple):
    """The images of a part, and the folder for its results."""

    serial: str
    images: Path
    out: Path


# the most severe last: what was not measured at all weighs more than any result
_SEVERITY = (DONE, INCOMPLETE, NOT_REGISTERED, BAD_INPUT, INTERNAL)


def measure(options: Measure) -> int:
    """Measure a part in images of a plan's settings."""
    plan = read_plan(options.plan)
    measure_options = MeasureOptions(
        _registration(options),
        _localisation(options),
        coverage=options.coverage,
        rule=_RULES[options.rule],
        white_level=options.white_level,
        response=options.response,
        edge_break_mm=options.edges,
        repeatability=_repeatability(options),
    )
    out = absolute(options.out)
    parts = _parts(options, out)
    with output_folder(options.out, FILES, "--out"):
        solid = read_part(options.part, options)
        check_same_part(solid, plan, options.part)
        if not options.force:
            _check_places(parts, solid)
            if options.parts:
                check_set_place(out, (TABLE,), _other_table, others=FILES[:1])
        # what can be read only once has no digest
        path = Path(options.part)
        digest = file_digest(path) if path.is_file() else ""
        with work_shown(quiet=options.quiet, lines=options.verbose) as progress:
            report(progress, 0, 1, "preparing the part")
            measurer = Measurer(plan, solid, part_file_sha256=digest)
        outcomes = [_measured(measurer, part, measure_options, options) for part in parts]
        reasons = {outcome.serial: outcome for outcome in outcomes if isinstance(outcome, _Reason)}
        folders = [part.out for part in parts if part.serial not in reasons]
        files = [path_text(folder / name) for folder in folders for name in _names(options)]
        if options.parts and files:
            _write_table(outcomes, out / TABLE)
            files.append(path_text(out / TABLE))
    if options.json:
        records = [outcome.to_dict() for outcome in outcomes]
        print_json(records if options.parts else records[0])
    elif files:
        terminal_tables.print_written(files, path_text(out), files[-1])
    if reasons:
        share = f"{len(reasons)} of {len(parts)} parts"
        write_error(visible(f"aspectgraph: {share} not measured: {', '.join(reasons)}"))
    blank = [
        outcome.serial
        for outcome in outcomes
        if not isinstance(outcome, _Reason) and not any(result.measured for result in outcome)
    ]
    if options.parts and blank:
        share = f"{len(blank)} of {len(parts)} parts"
        write_error(visible(f"aspectgraph: {share} without a value: {', '.join(blank)}"))
    codes = [
        outcome.code if isinstance(outcome, _Reason) else _code(outcome, options.exit)
        for outcome in outcomes
    ]
    return max(codes, key=_SEVERITY.index)


def render(options: Render) -> int:
    """Render the images of a plan, and write the true values beside them."""
    plan = read_plan(options.plan)
    out = absolute(options.out)
    if not options.force:
        check_set_place(out, (TRUTH,), partial(_other_rendering, plan), alone=True)
    with output_folder(options.out, (TRUTH,), "--out"):
        solid = read_part(options.part, options)
        check_same_part(solid, plan, options.part)
        rehearsal = Rehearsal(
            plan,
            solid,
            surfaces_mm=options.surfaces_mm,
            seed=options.seed,
            exact_poses=options.exact_poses,
        )
        if not options.quiet:
            for text in _rendered_texts(rehearsal, plan, options.surfaces_mm):
                write_error(f"aspectgraph: {text}")
        with terminal_progress(
            quiet=options.quiet, lines=options.verbose, waiting=True
        ) as progress:
            files = write_images(rehearsal, out, "--out", progress)
    if options.json:
        print_json(to_plain(rehearsal.truth))
    else:
        terminal_tables.print_written(files, path_text(out), path_text(out / TRUTH))
    return DONE


def _rendered_texts(
    rehearsal: Rehearsal, plan: InspectionPlan, stated_mm: float | None
) -> Iterator[str]:
    """Yield what lights the images, and how far the part in them is off its model."""
    if rehearsal.unlit:
        which = "the light that was requested is not planned yet"
        why = which if plan.light_missing else "the plan has no light"
        yield f"{why}; a lamp on the camera lights the images"
    state = EdgeState.planned(plan.request.edge_break_mm)
    breaks = {name: getattr(target, "edge_break_mm", None) for name, target in plan.targets.items()}
    broken = [name for name, limits in breaks.items() if any(limits or ())]
    if not state.is_sharp:
        yield (
            f"edges are drawn sharp, and the plan states that they are {state}; measure these images with "
            "--edges sharp"
        )
    elif plan.request.edge_break_mm is None and len(broken) < len(breaks):
        yield (
            "edges are drawn sharp; 'measure' counts on small breaks, as of a real part, unless --edges sharp says "
            "that there are none"
        )
    if broken:
        yield (
            f"edges are drawn sharp, and {count(len(broken), 'target')} of the plan, such as {broken[0]}, count on "
            "broken ones; their values are off by about as much"
        )
    sigma = rehearsal.truth.surfaces_mm
    if sigma:
        drawn = f"{sigma:.3g} mm, as --surfaces-mm states"
        if stated_mm is None:
            drawn = (
                f"{sigma:.3g} mm at most, as the plan states of each; --surfaces-mm states another"
            )
        yield (
            f"faces of the part deviate by up to {rehearsal.largest_mm:.2g} mm, drawn with a standard deviation of "
            f"{drawn}; that of radii and axes is {ROUND_SHARE:g} times as large"
        )
    elif stated_mm is None:
        yield (
            "the plan states no deviation of faces, so the part is rendered as designed; --surfaces-mm makes it "
            "deviate"
        )


class _Reason(NamedTuple):
    """Why a part of many is not measured, and the exit code for this."""

    serial: str
    reason: str
    code: int

    def to_dict(self) -> dict[str, str]:
        """Return what ``--json`` prints instead of results."""
        return {"serial": self.serial, "not_measured": self.reason}


def _measured(
    measurer: Measurer, part: _Images, measure_options: MeasureOptions, options: Measure
) -> MeasurementResults | _Reason:
    """Measure a part, write and print its results; of many parts, what is wrong with one is its reason."""
    if options.parts and not options.json:
        print_text(f"{part.serial}:")
    try:
        if not part.images.is_dir():
            kind = "a link that leads nowhere" if part.images.is_symlink() else "a pipe or a device"
            raise RequestError.of_rule("images", "must be an existing folder", kind)
        with work_shown(quiet=options.quiet, lines=options.verbose) as progress:
            results = measurer.measure(
                part.images,
                measure_options,
                serial=part.serial,
                operator=name_text(options.operator or ""),
                partial=options.partial,
                allow_lossy=options.allow_lossy,
                progress=progress,
            )
            report(progress, 0, 1, "writing results")
            _write(results, part.out, options.qif)
    except Exception as error:
        if not options.parts or shortage(error) is not None:
            raise
        reason = _reason_of(error, part.serial, options)
        if not options.json:
            print_text(f"not measured: {reason.reason}")
        return reason
    if not options.json:
        print_results(results)
        if options.parts:
            print_text(f"report: {path_text(part.out / FILES[-1])}")
    return results


def _write_table(outcomes: Sequence[MeasurementResults | _Reason], path: Path) -> None:
    """Write the rows of all parts into one table."""
    parts = [outcome for outcome in outcomes if not isinstance(outcome, _Reason)]
    reasons = {
        outcome.serial: outcome.reason for outcome in outcomes if isinstance(outcome, _Reason)
    }
    write_text(path, table_of_parts(parts, reasons))


def _names(options: Measure) -> list[str]:
    """Return the names of the files of a part."""
    return [name for name in FILES if options.qif or name != QIF]


def _reason_of(error: Exception, serial: str, options: Measure) -> _Reason:
    """Return an error as the reason of one part, in the words of the shell."""
    if isinstance(error, AspectGraphError | MeasurementModelError | PlannerError):
        return _Reason(serial, in_words_of_shell(error, vars(options)), BAD_INPUT)
    if isinstance(error, OSError):
        return _Reason(serial, f"{name_text(error.filename or '')}: {error.strerror}", BAD_INPUT)
    write_fault(error)
    return _Reason(serial, f"the program has a fault: {type(error).__name__}", INTERNAL)


def _parts(options: Measure, out: Path) -> list[_Images]:
    """Return name, images and folder of results of each part."""
    folder = Path(options.images)
    if not options.parts:
        return [_Images(name_text(options.serial or ""), folder, out)]
    if options.serial is not None:
        raise RequestError.of_rule("serial", "must not be given with --parts", repr(options.serial))
    # other files may lie there; a link, pipe or device stands for a part
    parts = [
        _Images(name_text(path.name), path, out / path.name)
        for path in sorted(folder.iterdir())
        if not path.is_file()
    ]
    if not parts:
        got = f"none in {str(folder)!r}"
        raise RequestError.of_rule("images", "must hold a folder for each part", got)
    if any(part.serial == TABLE for part in parts):
        rule = "must hold folders with other names than that of the table of all parts"
        raise RequestError.of_rule("images", rule, repr(TABLE))
    return parts


def _check_places(parts: list[_Images], solid: Solid) -> None:
    """Refuse, before the work, folders with results of another part, or with other files."""
    digest = PartRecord.of(solid).digest
    for part in parts:
        stranger = partial(_other_results, part.serial, digest)
        check_set_place(part.out, FILES, stranger, others=("plan.json",))


def _other_table(path: Path) -> str:
    """Say that a file is no table of parts; nothing if it is."""
    heading = ",".join(COLUMNS[:3])
    other = "which 'measure' did not write"
    try:
        with open(path, encoding="utf-8") as table:
            return other * (table.read(len(heading)) != heading)
    except (OSError, UnicodeDecodeError):
        return other


def _other_results(serial: str, digest: str, path: Path) -> str:
    """Say in what a file differs from results of a part; nothing if they are of it."""
    other = "which 'measure' did not write"
    try:
        data = read_json(path, "results")
    except PlanFileError:
        return other
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        return other
    source = data.get("source")
    if not isinstance(source, dict) or source.get("part_digest") != digest:
        return "which is of another part"
    if data.get("serial") == serial:
        return ""
    owner = f"serial {data['serial']!r}" if data.get("serial") else "no serial"
    return f"which is of {owner}{f' and not of {serial!r}' if serial else ', and none is given'}"


def _other_rendering(plan: InspectionPlan, path: Path) -> str:
    """Say that a file is not of a rendering of a plan; nothing if it is."""
    try:
        truth = from_plain(Truth, read_json(path, "file"), PlanFileError)
    except PlanFileError:
        return "which 'render' did not write"
    return "" if truth.plan_digest == plan.digest else "which is of another plan"


def _write(results: MeasurementResults, folder: Path, with_qif: bool) -> None:
    with staged_folder(folder, FILES, "--out") as staging:
        if with_qif:
            results.qif(staging / QIF)
        results.write(staging / "results.json")
        results.write_csv(staging / TABLE)
        write_text(staging / "report.html", measured_html(results))


def _code(results: MeasurementResults, condition: str) -> int:
    if results.failed:
        return NOT_REGISTERED
    fine = results.measured if condition == "measured" else results.conforms
    return DONE if fine else INCOMPLETE


def _repeatability(options: Measure) -> PoseUncertainty:
    """Return by how much the camera moves between images of a setting."""
    if options.repeatability is None:
        return REPEATABILITY
    translation_mm, rotation_rad = options.repeatability
    return PoseUncertainty.isotropic(translation_mm=translation_mm, rotation_rad=rotation_rad)


def _localisation(options: Measure) -> Localisation | None:
    """Return a localisation with the floor that is asked for; of it, only this counts."""
    if options.floor_px is None:
        return None
    return Localisation.gaussian(floor_px=options.floor_px)


def _registration(options: Measure) -> Registration:
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
