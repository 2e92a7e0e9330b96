"""Options of the commands about the robot."""

from __future__ import annotations

import argparse

from planner.cli.arguments import Options, add_messages, add_part, add_reading, add_seed
from planner.cli.parsing.quantities import MM, RAD, SECONDS, SHARE, sigma_pair, whole


def add_cell(parser: argparse.ArgumentParser) -> None:
    """Add the plan, its part, and the robot's cell."""
    parser.add_argument("plan", metavar="PLAN", help="plan.json, or the folder it is in")
    add_part(parser)
    parser.add_argument(
        "--cell",
        metavar="FILE",
        required=True,
        help="TOML file with the robot, the hand-eye calibration, fixturings and obstacles",
    )


def add_plan_cell(parser: Options) -> None:
    """Add the cell that a plan is made for."""
    parser.add_argument(
        "--cell",
        metavar="FILE",
        help="TOML file of a robot cell: the robot must reach every setting (default: no robot)",
    )


def add_reach(reach: argparse.ArgumentParser) -> None:
    """Add the options of `reach`."""
    add_cell(reach)
    placing = reach.add_argument_group("placement")
    placing.add_argument(
        "--place",
        action="store_true",
        help="draw other positions of the part, and print those from which the robot reaches most",
    )
    placing.add_argument(
        "--within",
        type=MM,
        nargs=6,
        metavar=("X0", "Y0", "Z0", "X1", "Y1", "Z1"),
        help="with --place: opposite corners of the box for the middle of the part, in the base of "
        "the robot, mm (default: before the robot, at the height of the cell file)",
    )
    placing.add_argument(
        "--draws", type=whole, default=300, metavar="N", help="with --place: positions to try"
    )
    placing.add_argument(
        "--cell-out",
        metavar="FILE",
        help="with --place: write the cell with the best position, as it was evaluated; one that "
        "exists is replaced (default: print its fixturings only)",
    )
    add_seed(placing, "same seed, same positions and other poses")
    reach.add_argument(
        "--plan-out",
        metavar="FILE",
        help="write the plan with other poses that inspect the same for settings that are not "
        "reached; one that exists is replaced (default: say only which there are)",
    )
    add_reading(reach)
    add_messages(reach)


def add_program(program: argparse.ArgumentParser) -> None:
    """Add the options of `program`."""
    add_cell(program)
    output = program.add_argument_group("program")
    output.add_argument(
        "--format",
        choices=("urscript", "rapid", "krl", "ros", "csv", "json"),
        default="urscript",
        help="language of the controller; ros: trajectories as JSON, json: all data",
    )
    output.add_argument(
        "--out",
        "-o",
        metavar="FILE",
        help="file to write; one that exists is replaced (default: inspection.script, .mod, .src, "
        ".csv, inspection_ros.json or program.json)",
    )
    output.add_argument(
        "--speed",
        type=SHARE,
        default=0.5,
        metavar="S",
        help="share of the joints' largest speeds, like 0.5 or 50%%",
    )
    output.add_argument(
        "--settle", type=SECONDS, default=0.5, metavar="S", help="wait before each image, s"
    )
    output.add_argument(
        "--trigger-output",
        type=whole,
        default=1,
        metavar="N",
        help="digital output that triggers the camera",
    )
    output.add_argument(
        "--ready-input",
        type=whole,
        default=1,
        metavar="N",
        help="digital input at which the camera says that the image is taken",
    )
    output.add_argument(
        "--plan-out",
        metavar="FILE",
        help="use other poses that inspect the same for settings that are not reached or hard to "
        "drive, and write the plan with these; its images must be measured with it",
    )
    add_seed(output, "same seed, same ways around obstacles")
    _add_arm(program)
    add_reading(program)
    add_messages(program)


def _add_arm(program: argparse.ArgumentParser) -> None:
    """Add the uncertainty of the arm."""
    arm = program.add_argument_group(
        "uncertainty of the arm", "With one of these, the program states P for each setting."
    )
    arm.add_argument(
        "--sigma-joints",
        type=RAD,
        metavar="RAD",
        help="standard deviation of each joint, like 0.1mrad (default: none)",
    )
    arm.add_argument(
        "--sigma-hand-eye",
        type=sigma_pair,
        metavar="MM,RAD",
        help="standard deviations of the hand-eye calibration per axis, like 0.05mm,0.5mrad "
        "(default: none)",
    )
    arm.add_argument(
        "--sigma-part",
        type=sigma_pair,
        metavar="MM,RAD",
        help="standard deviations of the part's registration about its origin, per axis "
        "(default: none)",
    )
    arm.add_argument(
        "--simulate",
        type=whole,
        default=10_000,
        metavar="N",
        help="check P with this many displaced poses per setting",
    )
