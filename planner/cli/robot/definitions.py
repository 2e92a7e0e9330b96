"""Options of the commands about the robot."""

from __future__ import annotations

import argparse

from planner.cli.arguments import Options, add_messages, add_part, add_reading, add_seed
from planner.cli.parsing.quantities import MM, whole


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
    add_seed(placing, "same seed, same positions")
    add_reading(reach)
    add_messages(reach)
