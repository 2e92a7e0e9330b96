"""The command ``reach``: which settings of a plan a robot reaches, and where the part should lie."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from errors.checks import probability_text
from planner.app.job import check_same_part
from planner.app.options import Program, Reach
from planner.app.part import read_part
from planner.app.process import DONE, INCOMPLETE
from planner.camera.pose import PoseUncertainty
from planner.exceptions import RequestError, UncertaintyError
from planner.files import PLAN, PROGRAM, check_file_place, print_json
from planner.light.area_lights import BACKLIGHT
from planner.plan import InspectionPlan, read_plan
from planner.progress import terminal_progress, visible
from planner.robotcell import Cell, Placement, Reachability
from planner.robotcell.bodies import Grip, standing_bodies
from planner.robotcell.cell_file import laid_cell, moved_cell, toml_lines
from planner.robotcell.laying import POST_HEIGHTS_MM, LaidPart, LayingSearch, Posts, Side
from planner.robotcell.placement import PlacementSearch
from planner.robotcell.urdf import carry, compose, invert
from planner.robotprogram.other_poses import with_reached_settings
from planner.robotprogram.program import FixturedTour, RobotProgram, Stop
from planner.robotprogram.program_steps import (
    CameraSignals,
    check_axes,
    check_program_speed,
    check_signals,
    has_lamps,
    images_of,
)
from planner.robotprogram.program_texts import FORMATS, format_of_file, write_program
from planner.robotprogram.robot_program import (
    ArmUncertainty,
    robot_program,
    robot_program_with_other_poses,
)
from planner.text_table import Column, count, print_table, print_text

if TYPE_CHECKING:
    from aspectgraph import Solid


# The command ``program``: a robot program that takes the images of a plan.

# where neither a format nor a file is named
_USUAL_LANGUAGE: Final = "urscript"


def program(options: Program) -> int:
    """Write a robot program, and print its rounds."""
    out = FORMATS[options.format or _USUAL_LANGUAGE] if options.out is None else options.out
    check_file_place(out, "--out", PROGRAM)
    if options.plan_out is not None:
        check_file_place(options.plan_out, "--plan-out", PLAN)
    language = format_of_file(Path(out), options.format, "--out")
    check_program_speed(options.speed, language)
    signals = CameraSignals(
        settle_s=options.settle,
        trigger_output=options.trigger_output,
        ready_input=options.ready_input,
    )
    check_signals(signals, language)
    uncertainty = _uncertainty(options)
    plan = read_plan(options.plan)
    cell = Cell.from_toml(options.cell)
    # a program may leave out the fixturings on a turntable
    turns = all(fixturing.table is not None for fixturing in cell.fixturings.values())
    check_axes(language, cell.robot.n_joints, turns=turns)
    solid = read_part(options.part, options)
    check_same_part(solid, plan, options.part)
    with terminal_progress(quiet=options.quiet, lines=options.verbose) as progress:
        make = robot_program if options.plan_out is None else robot_program_with_other_poses
        made = make(
            plan,
            solid,
            cell,
            speed=options.speed,
            uncertainty=uncertainty,
            simulate=options.simulate,
            seed=options.seed,
            progress=progress,
        )
    if made.plan is not None:
        made.plan.write(str(options.plan_out))
    path = write_program(made, out, format=language, signals=signals)
    if options.json:
        print_json(made.to_dict())
    else:
        _print_program(made)
        print_lamp_note(plan, cell)
        print(visible(str(path)))
        if made.plan is not None:
            print(visible(str(options.plan_out)))
    return DONE if made.complete else INCOMPLETE


def _uncertainty(options: Program) -> ArmUncertainty | None:
    """Return the uncertainty of the arm, if any of it is given."""
    joints = options.sigma_joints
    hand_eye = _isotropic("sigma_hand_eye", options.sigma_hand_eye)
    part = _isotropic("sigma_part", options.sigma_part)
    if joints is None and hand_eye is None and part is None:
        return None
    return ArmUncertainty(0.0 if joints is None else joints, hand_eye, part)


def _isotropic(name: str, sigmas: tuple[float, float] | None) -> PoseUncertainty | None:
    if sigmas is None:
        return None
    try:
        return PoseUncertainty.isotropic(translation_mm=sigmas[0], rotation_rad=sigmas[1])
    except UncertaintyError as error:
        raise UncertaintyError.of_rule(name, error.rule, error.got) from None


def _print_program(made: RobotProgram) -> None:
    """Print how many settings the program visits, its rounds, and what to look at."""
    total = made.n_stops + len(made.unreached)
    head = f"the program visits {made.n_stops} of {count(total, 'setting')}"
    print_text(f"warning: {head}" if made.unreached else head)
    for k, why in made.unreached.items():
        print_text(f"setting {k + 1} is left out, because the robot does not reach it: {why}")
    states_p = any(stop.probability for tour in made.tours for stop in tour.stops)
    switches = has_lamps(made)
    columns = [
        Column("part lies"),
        Column("setting", right=True),
        Column("image"),
        *([Column("lamp on")] if switches else []),
        Column("joints (degrees)"),
        Column("move (s)", right=True),
    ]
    if states_p:
        columns.append(Column("smallest P", right=True))
        columns.append(Column("simulated", right=True))
    rows = [
        row
        for tour in made.tours
        for stop in tour.stops
        for row in _rows(tour, stop, states_p, switches)
    ]
    print_table(columns, rows)
    rounds = "1 round" if len(made.tours) == 1 else f"{len(made.tours)} rounds"
    detours = sum(move.is_detour for tour in made.tours for move in tour.moves)
    around = f", {detours} of them around something" if detours else ""
    n_moves = sum(len(tour.moves) for tour in made.tours)
    print_text(
        f"{rounds} from home to home, {n_moves} moves{around}, {made.seconds:.1f} s at "
        f"{100 * made.speed:.3g} % of the joints' speeds; all keep {made.keep_mm:g} mm, half "
        "of clearance_mm, to part and obstacles"
    )
    if len(made.coverage) > 1:
        counts = [f"{k}: {count}" for k, count in enumerate(made.coverage, 1)]
        print_text(f"settings reached by the number of fixturings: {', '.join(counts)}")
    for k, text in made.replaced.items():
        print_text(f"setting {k + 1} has another pose that inspects the same: {text}")
    for text in made.warnings:
        print_text(f"warning: {text}")


def print_lamp_note(plan: InspectionPlan, cell: Cell) -> None:
    """Print that lights of a plan are no bodies of the cell; nothing of a ring, or if the cell has a light."""
    light = plan.light
    if light is None or light.kind == "ring" or cell.light is not None:
        return
    if light.area is not None:
        stands = light.area.kind == BACKLIGHT
        table, moves = ("[fixturings.NAME.light]", "part") if stands else ("[light]", "camera")
        print_text(
            f"note: the plan's light is no obstacle of the cell: {light.area}. It moves with the {moves}. "
            f"State it as {table} of the cell"
        )
        return
    held = _are_obstacles(light.lamps, cell)
    places = [
        f"lamp {k} at ({x:.0f}, {y:.0f}, {z:.0f})"
        for k, (x, y, z) in enumerate(light.lamps.tolist(), start=1)
        if not held[k - 1]
    ]
    if not places:
        return
    which = "the plan's lamps are"
    if held.any():
        which = "of the plan's lamps, these are"
    print_text(
        f"note: {which} no obstacles of the cell: {', '.join(places)} mm in the frame of the part, with "
        "which they move. Add them to the obstacles of the fixturing"
    )


_BODY_OF_LAMP_MM = 1.0
"""A lamp that is this near to the box about an obstacle is in it: its position is printed in whole mm."""


def _are_obstacles(lamps: np.ndarray, cell: Cell) -> np.ndarray:
    """Return which lamps (n, 3) are in a body that moves with the part, in every fixturing; (n,) bool."""
    held = np.ones(len(lamps), dtype=bool)
    for fixturing in cell.fixturings.values():
        if isinstance(fixturing, Grip):
            pose = fixturing.part2flange
            bodies = fixturing.gripper
        else:
            pose = fixturing.part2base
            # what stands next to a turntable does not turn with the part
            bodies = fixturing.obstacles
            if fixturing.table is not None:
                bodies = fixturing.turning
        places = carry(pose, lamps)
        here = np.zeros(len(lamps), dtype=bool)
        for body in standing_bodies(bodies, "obstacles"):
            here |= body.distance_bound(places) <= _BODY_OF_LAMP_MM
        held &= here
    return held


def _rows(
    tour: FixturedTour, stop: Stop, states_p: bool, switches: bool
) -> Iterator[tuple[str, ...]]:
    """Yield a row for each image of a stop; where lamps are switched, with those that must be on."""
    degrees = np.round(np.degrees(stop.joints), 1) + 0.0
    turned = "" if tour.turntable is None else f"table {degrees[-1]:g}°: "
    joint_angles = degrees if tour.turntable is None else degrees[:-1]
    angles = turned + " ".join(f"{angle:.1f}" for angle in joint_angles)
    cells = [angles, f"{stop.move.seconds:.1f}"]
    if states_p:
        frequencies = [rate.frequency for rate in stop.simulated.values()]
        cells.append(probability_text(min(stop.probability.values(), default=1.0)))
        cells.append(f"{min(frequencies):.4f}" if frequencies else "")
    for i, step in enumerate(images_of(stop)):
        lamps = [", ".join(map(str, step.lamps))] if switches else []
        # the arm stands still between the images of a stop
        shown_cells = cells if i == 0 else [""] * len(cells)
        yield (tour.fixturing, str(step.setting_idx + 1), step.image, *lamps, *shown_cells)


_SINGULAR = (
    "singular value: the larger the better, and at 0 joints turn fast for a slow camera. Its lengths are divided by "
    "500 mm"
)
_ROWS = 5
# positions that are tried, of the part as it lies and on all its sides
_PLACES = 300
_WAYS = 1500
# each asks for all angles of the table
_WAYS_ON_TURNTABLE = 300
# of the best ways, those whose program is made
_PROGRAMMED = 4
# of the longest reach of the arm, where a part is looked for
_NEAREST = 0.35
_SIDEWAYS = 0.5
_FARTHEST = 0.9


def reach(options: Reach) -> int:
    """Print which settings of a plan a robot reaches."""
    _check_place(options)
    _check_plan_out(options)
    _check_cell_out(options)
    plan = read_plan(options.plan)
    cell = Cell.from_toml(options.cell)
    solid = read_part(options.part, options)
    check_same_part(solid, plan, options.part)
    if options.place and options.table is not None:
        return _laid(options, plan, solid, cell)
    if options.place:
        return _placed(options, plan, solid, cell)
    reachability = cell.reachability(plan, solid)
    if options.json:
        print_json(reachability.to_dict())
        for text in model_notes(cell):
            print(text, file=sys.stderr)
        return DONE if reachability.complete else INCOMPLETE
    _print_reached(reachability, cell)
    print_lamp_note(plan, cell)
    changed = cell.difference(plan.cell)
    if changed:
        print_text(f"note: the cell of the plan differs from the cell given, in {changed}")
    if reachability.complete:
        if options.plan_out is not None:
            print_text(f"{options.plan_out} was not written: all settings are reached as planned")
        return DONE
    return _other_poses(options, plan, solid, cell)


def _check_place(options: Reach) -> None:
    """Refuse options of a search that is not asked for."""
    if options.within is not None and not options.place:
        raise RequestError.of_rule("within", "must be given with --place", "none")
    if options.table is not None and not options.place:
        raise RequestError.of_rule("table", "must be given with --place", repr(options.table))
    if options.table is not None and options.within is not None:
        raise RequestError.of_rule("within", "must not be given with --table", "both")
    if options.post_heights is not None and options.table is None:
        raise RequestError.of_rule("post_heights", "must be given with --table", "none")
    _posts(options)


def _posts(options: Reach) -> Posts:
    """Return the posts that may stand below the part, or raise if a number breaks its rule."""
    heights = POST_HEIGHTS_MM if options.post_heights is None else tuple(options.post_heights)
    return Posts(heights, options.post_width)


def _check_plan_out(options: Reach) -> None:
    if options.plan_out is None:
        return
    if options.place or options.json:
        rule = "must not be given with --place or --json"
        raise RequestError.of_rule("plan_out", rule, repr(options.plan_out))
    check_file_place(options.plan_out, "--plan-out", PLAN)


def _check_cell_out(options: Reach) -> None:
    if options.cell_out is None:
        return
    if not options.place:
        raise RequestError.of_rule("cell_out", "must be given with --place", repr(options.cell_out))
    check_file_place(options.cell_out, "--cell-out")
    if Path(options.cell_out).resolve() == Path(options.cell).resolve():
        rule = "must be another file than that of --cell"
        raise RequestError.of_rule("cell_out", rule, repr(options.cell_out))


def _other_poses(options: Reach, plan: InspectionPlan, solid: Solid, cell: Cell) -> int:
    """Print which settings are reached from other poses, and write the plan with these where that is asked."""
    with terminal_progress(quiet=options.quiet, lines=options.verbose) as progress:
        outcome = with_reached_settings(plan, solid, cell, seed=options.seed, progress=progress)
    if outcome.note:
        print_text(f"no other poses were tried: {outcome.note}")
        return INCOMPLETE
    for k, text in outcome.replaced.items():
        print_text(f"setting {k + 1} is reached from another pose that inspects the same: {text}")
    for k in outcome.unreached:
        print_text(f"setting {k + 1} is reached from no other pose that was tried")
    if outcome.unreached and not plan.cell:
        print_text(
            f"plan for this robot: add --cell {options.cell} to the command plan. It then chooses only poses that the "
            "robot reaches"
        )
    if options.plan_out is None:
        if outcome.replaced:
            print_text("--plan-out FILE writes the plan with these poses")
        return INCOMPLETE
    outcome.plan.write(options.plan_out)
    print(visible(str(options.plan_out)))
    return INCOMPLETE if outcome.unreached else DONE


def _print_reached(reachability: Reachability, cell: Cell) -> None:
    """Print a table of settings and fixturings, and what it says in words."""
    columns = (Column("setting"), *(Column(name) for name in reachability.poses))
    print_table(columns, reachability.rows())
    reached = reachability.reached
    parts = [f"{int(reached[:, k].sum())} in {name!r}" for k, name in enumerate(reachability.poses)]
    total = int(reached.any(axis=1).sum())
    print_text(
        f"{total} of {len(reachability.settings)} settings reached: {', '.join(parts)}. "
        f"Joints in degrees, by {cell.robot.name!r}."
    )
    for name in reachability.poses:
        reason = reachability.most_in_the_way(name)
        if reason and not reachability.reached[:, list(reachability.poses).index(name)].any():
            print_text(f"{name!r} reaches nothing; most often: {reason}")
    _print_first_flange(reachability, cell)
    if cell.pairs_left_out:
        pairs = ", ".join(" and ".join(pair) for pair in cell.pairs_left_out)
        print_text(f"not compared, because the arm is built so: {pairs}")
    for text in model_notes(cell):
        print_text(text)


def model_notes(cell: Cell) -> list[str]:
    """Return what a reader of a table must know of the cell's model, in sentences."""
    warnings = [f"warning: {text}" for text in cell.unchecked]
    constant = [cell.constant_clearance(name) for name in cell.fixturings]
    nearest = min(constant, key=lambda pair: pair.mm)
    always = f"{nearest.first} is always {nearest.mm:.0f} mm from {nearest.second}"
    notes = [*cell.robot.notes, *cell.near_by_mount, *([always] if nearest.first else [])]
    return [*warnings, *(f"note: {text}" for text in notes)]


def _print_first_flange(reachability: Reachability, cell: Cell) -> None:
    """Print the pose of the flange in the first setting that is reached, to compare with the pendant."""
    for number, setting in enumerate(reachability.settings):
        for name, poses in reachability.poses.items():
            if poses[number].reached:
                flange = cell.robot.forward(poses[number].joints[0])
                frame = "the base"
                if cell.robot.pendant is not None:
                    flange = compose(invert(cell.robot.pendant), flange)
                    frame = "the link 'base'"
                position = " ".join(f"{x:.1f}" for x in flange[:3, 3])
                print_text(
                    f"{setting} in {name!r}: {cell.robot.tip} at ({position}) mm in {frame}, to compare "
                    "with the pendant"
                )
                return


def _placed(options: Reach, plan: InspectionPlan, solid: Solid, cell: Cell) -> int:
    """Print positions of the part."""
    with terminal_progress(quiet=options.quiet, lines=options.verbose) as progress:
        search = PlacementSearch(plan, solid, cell, _ranges(options.within, cell))
        placements = search.run(options.draws or _PLACES, options.seed, progress)
    if options.json:
        print_json([placement.to_dict() for placement in placements])
    else:
        _print_places(placements, len(plan.settings), cell, options.cell)
        print_lamp_note(plan, cell)
    if options.cell_out is not None and placements:
        _write_cell(options, placements[0])
    return DONE if placements and placements[0].n_reached == len(plan.settings) else INCOMPLETE


def _write_cell(options: Reach, best: Placement) -> None:
    """Write the cell with the part where it was evaluated."""
    x, y, z = best.centre_mm
    head = (
        f"the middle of the part at {x:.1f} {y:.1f} {z:.1f} mm, turned "
        f"{best.turn_deg:.1f} degrees; the obstacles of its fixturings moved with it"
    )
    out = Path(str(options.cell_out))
    _write_cell_file(options, moved_cell(options.cell, best.motion, out.parent), head)


def _write_cell_file(options: Reach, content: Mapping[str, Any], head: str) -> None:
    """Write a cell file that says what it was made from."""
    out = Path(str(options.cell_out))
    lines = [f"# from {Path(options.cell).name}: {head}", *toml_lines(content)]
    out.write_text("\n".join(lines), encoding="utf-8")
    if not options.json:
        print(visible(str(out)))


class _Way(NamedTuple):
    """A way to lay the part, and its program; None if that was not tried."""

    laid: LaidPart
    program: RobotProgram | None


def _laid(options: Reach, plan: InspectionPlan, solid: Solid, cell: Cell) -> int:
    """Print ways to lay the part on a table."""
    posts = _posts(options)
    with terminal_progress(quiet=options.quiet, lines=options.verbose) as progress:
        search = LayingSearch(plan, solid, cell, str(options.table), posts)
        draws = _WAYS_ON_TURNTABLE if search.turns else _WAYS
        proposals = search.run(options.draws or draws, options.seed, options.ways, progress)
        ways = _with_programs(proposals, plan, solid, cell)
    if options.json:
        print_json([_way_record(way) for way in ways])
    else:
        _print_layings(ways, search.sides, plan, cell)
        print_lamp_note(plan, cell)
    if options.cell_out is not None and ways:
        out = Path(str(options.cell_out))
        content = laid_cell(options.cell, ways[0].laid.fixturings, out.parent)
        _write_cell_file(options, content, f"laid anew on {options.table!r}")
    return DONE if ways and _is_complete(ways[0], plan) else INCOMPLETE


def _is_complete(way: _Way, plan: InspectionPlan) -> bool:
    """Return whether all settings are reached, on free ways where a program was made."""
    if way.program is not None:
        return way.program.complete
    return way.laid.n_reached == len(plan.settings)


def _with_programs(
    proposals: Sequence[LaidPart], plan: InspectionPlan, solid: Solid, cell: Cell
) -> list[_Way]:
    """Return ways with the program of the first ones: a setting that is reached may have no free way to it.

    The first complete one comes first, otherwise that whose program takes most images. A cell without home has none.
    """
    ways = [_Way(laid, None) for laid in proposals]
    if cell.home is None:
        return ways
    for k, laid in enumerate(proposals[:_PROGRAMMED]):
        made = robot_program(plan, solid, cell.with_fixturings(laid.fixturings))
        ways[k] = _Way(laid, made)
        if made.complete:
            break
    return sorted(ways, key=lambda way: 0 if way.program is None else -way.program.n_stops)


def _way_record(way: _Way) -> dict[str, Any]:
    """Return a way as plain values, with what its program does."""
    record = way.laid.to_dict()
    if way.program is not None:
        record["program"] = {"images": way.program.n_stops, "seconds": way.program.seconds}
    return record


def _print_layings(
    ways: Sequence[_Way], sides: Sequence[Side], plan: InspectionPlan, cell: Cell
) -> None:
    """Print the best ways to lay the part, and what must be known of them."""
    if not ways:
        print_text("no way was found: each puts the part or its posts through something")
        return
    columns = (
        Column("part lies"),
        Column("turned", right=True),
        Column("middle at (mm)"),
        Column("tips at", right=True),
        Column("reached", right=True),
        Column("program", right=True),
        Column("singular value", right=True),
    )
    print_table(columns, [row for way in ways[:_ROWS] for row in _laying_rows(way, plan)])
    best = ways[0].laid
    number = next(iter(best.layings.values())).side
    down = " ".join(f"{x:.2f}" for x in np.round(-sides[number - 1].rotation[2], 2) + 0.0)
    print_text(
        f"side {number} has the outward normal ({down}) in the part's frame. Tips at: the tilt of the table at "
        "which the part falls over, unless it is clamped. Clamps are not computed"
    )
    if ways[0].program is None:
        print_text("program: not tried, since the cell file states no home_deg")
    else:
        print_text(
            "program: images that the robot takes without a collision on its way, and the time of its moves"
        )
    print_text(_SINGULAR)
    for k in np.flatnonzero(~best.reachability.reached.any(axis=1)):
        reasons = [poses[k].why for poses in best.reachability.poses.values()]
        print_text(f"setting {k + 1} is not reached in the first row: {'; '.join(reasons)}")
    for text in model_notes(cell.with_fixturings(best.fixturings)):
        print_text(text)


def _laying_rows(way: _Way, plan: InspectionPlan) -> list[tuple[str, ...]]:
    """Return a row for each fixturing of a way; the first one says what is reached together."""
    count = len(plan.settings)
    made = way.program
    together = (
        f"{way.laid.n_reached} of {count}",
        "not tried" if made is None else f"{made.n_stops} of {count}, {made.seconds:.0f} s",
        f"{way.laid.singular_value:.2f}",
    )
    rows: list[tuple[str, ...]] = []
    for place, (name, laying) in enumerate(way.laid.layings.items()):
        x, y = laying.foot_mm
        lies = name if place == 0 else f"and {name}"
        outcome = together if place == 0 else ("",) * len(together)
        turned = f"{laying.turn_deg:.0f}°"
        rows.append((lies, turned, f"{x:.0f} {y:.0f}", f"{laying.tips_at_deg:.0f}°", *outcome))
    return rows


def _print_places(placements: tuple[Placement, ...], count: int, cell: Cell, file: str) -> None:
    """Print the best places, and the first as lines of a cell file, with everything that moved."""
    if not placements:
        print_text(
            "no position was found: each puts the part or its fixture through something, or home is not free"
        )
        return
    columns = (
        Column("middle of the part (mm)"),
        Column("turned", right=True),
        Column("reached", right=True),
        Column("singular value", right=True),
        Column("to limit", right=True),
    )
    rows = [
        (
            " ".join(f"{x:.0f}" for x in placement.centre_mm),
            f"{placement.turn_deg:.0f}°",
            f"{placement.n_reached} of {count}",
            f"{placement.singular_value:.2f}",
            f"{np.degrees(placement.to_limit_rad):.0f}°",
        )
        for placement in placements[:_ROWS]
    ]
    print_table(columns, rows)
    print_text(f"{_SINGULAR}. To limit: the angle of the nearest joint from its limit")
    for text in model_notes(cell):
        print_text(text)
    moving = dict.fromkeys(
        body
        for fixturing in placements[0].fixturings.values()
        for body in (*fixturing.obstacles, *fixturing.turning)
    )
    if moving:
        staying = ", ".join(cell.obstacles)
        print_text(
            f"evaluated: moved with the part: {', '.join(moving)}"
            + (f"; left where they are: {staying}" if staying else "")
        )
    elif cell.obstacles:
        print_text(
            "note: nothing moves with the part, so it may hang in the air at these positions. "
            f"--table NAME lays it on an obstacle of the cell ({', '.join(cell.obstacles)})"
        )
    print_text("the fixturings of the first position, for the cell file:")
    content = moved_cell(file, placements[0].motion, Path(file).parent)
    for line in toml_lines({"fixturings": content["fixturings"]}, digits=6):
        print(line)


def _ranges(corners: Sequence[float] | None, cell: Cell) -> list[tuple[float, float] | None]:
    """Return the ranges of positions along x, y and z; None: the height of the cell file."""
    if corners is not None:
        return [(corners[k], corners[k + 3]) for k in range(3)]
    longest = float(cell.robot.chain.reach_mm()[0])
    sideways = _SIDEWAYS * longest
    return [(_NEAREST * longest, _FARTHEST * longest), (-sideways, sideways), None]
