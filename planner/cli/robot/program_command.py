"""The command ``program``: a robot program that takes the images of a plan."""

from __future__ import annotations

import argparse

import numpy as np

from errors.formatting import probability_text
from planner.camera.pose_uncertainty import PoseUncertainty
from planner.cli.job import check_same_part, read_part
from planner.cli.process.exit_codes import DONE, INCOMPLETE
from planner.exceptions import UncertaintyError
from planner.files import PLAN, PROGRAM, check_file_place
from planner.motion.arm_uncertainty import ArmUncertainty
from planner.motion.program_record import FixturedTour, RobotProgram, Stop
from planner.motion.robot_program import robot_program, robot_program_with_other_poses
from planner.output.programs import (
    FORMATS,
    CameraSignals,
    check_program_speed,
    write_program,
)
from planner.plan import read_plan
from planner.progress import terminal_progress
from planner.progress.terminal_text import visible
from planner.progress.text_table import Column, print_table, print_text
from planner.records.json_file import print_json
from planner.robot import Cell
from planner.setting.image_names import image_name


def program(options: argparse.Namespace) -> int:
    """Write a robot program, and print its rounds."""
    out = FORMATS[options.format] if options.out is None else options.out
    check_file_place(out, "--out", PROGRAM)
    if options.plan_out is not None:
        check_file_place(options.plan_out, "--plan-out", PLAN)
    check_program_speed(options.speed, options.format)
    signals = CameraSignals(
        settle_s=options.settle,
        trigger_output=options.trigger_output,
        ready_input=options.ready_input,
    )
    uncertainty = _uncertainty(options)
    plan = read_plan(options.plan)
    solid = read_part(options)
    check_same_part(solid, plan, options.part)
    cell = Cell.from_toml(options.cell)
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
        made.plan.write(options.plan_out)
    path = write_program(made, out, format=options.format, signals=signals)
    if options.json:
        print_json(made.to_dict())
    else:
        _print_program(made)
        print(visible(str(path)))
        if made.plan is not None:
            print(visible(str(options.plan_out)))
    return DONE if made.complete else INCOMPLETE


def _uncertainty(options: argparse.Namespace) -> ArmUncertainty | None:
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
    """Print the rounds, what is not reached, and what to look at."""
    states_p = any(stop.probability for tour in made.tours for stop in tour.stops)
    columns = [
        Column("part lies"),
        Column("setting", right=True),
        Column("image"),
        Column("joints (degrees)"),
        Column("move (s)", right=True),
    ]
    if states_p:
        columns.append(Column("smallest P", right=True))
        columns.append(Column("simulated", right=True))
    rows = [_row(tour, stop, states_p) for tour in made.tours for stop in tour.stops]
    print_table(columns, rows)
    rounds = "1 round" if len(made.tours) == 1 else f"{len(made.tours)} rounds"
    detours = sum(move.is_detour for tour in made.tours for move in tour.moves)
    around = f", {detours} of them around something" if detours else ""
    n_moves = sum(len(tour.moves) for tour in made.tours)
    print_text(
        f"{rounds} from home to home, {n_moves} moves{around}, {made.seconds:.1f} s at "
        f"{100 * made.speed:.3g} % of the joints' speeds; all keep {made.keep_mm:g} mm to "
        "part and obstacles"
    )
    if len(made.coverage) > 1:
        counts = [f"{k}: {count}" for k, count in enumerate(made.coverage, 1)]
        print_text(f"settings reached by the number of fixturings: {', '.join(counts)}")
    for k, text in made.replaced.items():
        print_text(f"setting {k + 1} has another pose that inspects the same: {text}")
    for k, why in made.unreached.items():
        print_text(f"setting {k + 1} is not reached: {why}")
    for text in made.warnings:
        print_text(f"warning: {text}")


def _row(tour: FixturedTour, stop: Stop, states_p: bool) -> tuple[str, ...]:
    degrees = np.round(np.degrees(stop.joints), 1) + 0.0
    turned = "" if tour.turntable is None else f"table {degrees[-1]:g}°: "
    own = degrees if tour.turntable is None else degrees[:-1]
    angles = turned + " ".join(f"{angle:.1f}" for angle in own)
    row = (
        tour.fixturing,
        str(stop.setting_idx + 1),
        image_name(stop.setting_idx),
        angles,
        f"{stop.move.seconds:.1f}",
    )
    if not states_p:
        return row
    frequencies = [rate.frequency for rate in stop.simulated.values()]
    return (
        *row,
        probability_text(min(stop.probability.values(), default=1.0)),
        f"{min(frequencies):.4f}" if frequencies else "",
    )
