"""Options of several commands, in the groups of ``--help``: the most used first."""

from __future__ import annotations

import argparse
from typing import Any

from planner.app.quantities import (
    DEG,
    MM,
    PX,
    RAD,
    SECONDS,
    SHARE,
    all_or_indices,
    indices,
    registration,
    whole,
)
from planner.light.background import DEFAULT_STEP

# a parser, or one of its groups
Options = Any


def add_asked(parser: Options, out: str | None = None) -> None:
    """Add camera, requirement, search and output folder of a plan.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Of the command.
    out : str, optional
        The folder where none is given. Default: one must be given.
    """
    needs = parser.add_argument_group("camera and requirement")
    add_camera(needs)
    add_promise(needs)
    add_output(parser, out)
    search = parser.add_argument_group("search")
    search.add_argument(
        "--effort",
        choices=("quick", "standard", "thorough"),
        help="how long to search and to prove (default: standard)",
    )
    search.add_argument(
        "--time-limit",
        type=SECONDS,
        metavar="S",
        help="end after this many seconds with the best plan so far, like 90, 5min or 1h "
        "(default: no limit)",
    )
    search.add_argument(
        "--gap",
        type=SHARE,
        default=0.0,
        metavar="G",
        help="end the search when at most this share of the settings is unproven, like 20%%",
    )
    add_seed(search, "same seed, same plan")
    search.add_argument(
        "--simulate",
        type=whole,
        default=10_000,
        metavar="N",
        help="check the plan with this many displaced poses per setting",
    )
    add_limits(parser)


def add_seed(parser: Options, help_text: str) -> None:
    """Add the seed of random numbers."""
    parser.add_argument("--seed", type=whole, default=0, metavar="N", help=help_text)


def add_graph_limit(parser: Options, content: str, default: str) -> None:
    """Add the largest number of entities whose joint graph is written; the default is in words."""
    parser.add_argument(
        "--graph-limit",
        type=whole,
        default=int(default) if default.isdigit() else None,
        metavar="N",
        help=f"write {content} for up to this many entities (default: {default})",
    )


def add_camera(parser: Options) -> None:
    """Add the camera."""
    parser.add_argument(
        "--camera",
        metavar="NAME|FILE",
        required=True,
        help="a name that 'aspectgraph cameras' lists, or a TOML file",
    )


def add_output(parser: Options, out: str | None) -> None:
    """Add the output folder."""
    group = parser.add_argument_group("output")
    group.add_argument(
        "--out",
        "-o",
        metavar="DIR",
        required=out is None,
        default=out,
        help="folder to write to; the command refuses to replace a plan of another request",
    )


def add_jobs(parser: Options, help_text: str, default: int) -> None:
    """Add the number of processes."""
    parser.add_argument("--jobs", "-j", type=whole, default=default, metavar="N", help=help_text)


class _Again(argparse.Action):
    """Takes a plan file; the options that its request holds are not required then."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        """Set the file."""
        setattr(namespace, self.dest, values)
        for action in parser._actions:
            if action.dest in ("part", "camera"):
                action.required = False
        for group in parser._mutually_exclusive_groups:
            group.required = False


def add_again(parser: Options) -> None:
    """Add the plan whose request is planned again."""
    parser.add_argument(
        "--again",
        metavar="PLAN",
        action=_Again,
        help="plan the request of a plan.json, or of its folder, again without its options; "
        "give PART, too, if the part was moved",
    )


def add_wanted(parser: Options) -> None:
    """Add what to measure, and how well points are found in the image."""
    group = parser.add_argument_group("what to measure", "Give one of the first four options.")
    add_entities(group).add_argument(
        "--dimensions",
        metavar="FILE|all",
        help="TOML or JSON file of dimensions with tolerances, or all that the part (AP242) states",
    )
    group.add_argument(
        "--one-per-pattern",
        action="store_true",
        help="with --dimensions all: measure each dimension on one of its features only, such as "
        "one hole of a pattern (default: on each)",
    )
    group.add_argument(
        "--reference-dimensions",
        action="store_true",
        help="with --dimensions all: plan reference dimensions, too, which the model gives for "
        "information only (default: they are listed as not planned)",
    )
    group.add_argument(
        "--no-basic-dimensions",
        action="store_true",
        help="with --dimensions all: leave out basic dimensions, which are theoretically exact and "
        "have no tolerance (default: they are planned to --accuracy)",
    )
    group.add_argument(
        "--share",
        type=SHARE,
        default=0.25,
        metavar="S",
        help="share of a tolerance's half width that is permitted as error of measurement",
    )
    group.add_argument(
        "--localisation",
        metavar="MODEL",
        help="error of points in the image: rounding, gaussian[:SIGMA[:FLOOR]] or "
        "fit[:SIGMA[:CORRELATION[:FLOOR]]], in px; FLOOR does not average out (default: rounding "
        "with --entities, --select and --all, gaussian:0.1:0.05 with --dimensions)",
    )
    group.add_argument(
        "--surfaces-mm",
        type=MM,
        metavar="MM",
        help="standard deviation of the position of the part's faces along their normals, for "
        "dimensions (default: what flatness and profile tolerances of the part "
        "state, else 0.02; with rounding 0)",
    )


_P_ALL = (
    "required P_all of each target: the displaced camera has it in the picture, in focus, unhidden "
    "and apart from other lines, and the error is at most the permitted one"
)
P_ALONE = (
    "required P of each target: the error is at most the permitted one, if the target is found"
)


def add_promise(parser: Options, probability: str = _P_ALL) -> None:
    """Add what is promised of a measurement, and the uncertainty of the camera's pose.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Of the command, or a group.
    probability : str
        What the probability is of.
    """
    parser.add_argument(
        "--accuracy",
        type=SHARE,
        default=0.98,
        metavar="A",
        help="98%% permits an error of 2%% of an edge's length, a rim's diameter or an arc's "
        "radius",
    )
    parser.add_argument(
        "--probability",
        type=SHARE,
        default=0.9,
        metavar="P",
        help=probability,
    )
    parser.add_argument(
        "--sigma-mm",
        type=MM,
        default=0.2,
        metavar="MM",
        help="standard deviation of the camera's position",
    )
    parser.add_argument(
        "--sigma-rad",
        type=RAD,
        default=0.002,
        metavar="RAD",
        help="standard deviation of the camera's orientation, in rad or like 0.1deg",
    )


def add_registration(plan: Options) -> None:
    """Add how poses are known when values are read."""
    group = plan.add_argument_group("registration of images")
    group.add_argument(
        "--register",
        dest="registration",
        type=registration,
        metavar="edges|none|MM,RAD",
        help="how the camera's pose is known when values are read. edges: aspectgraph measure "
        "registers each image to the part's own edges; none: it is the planned pose; a length and "
        "an angle: standard deviations of a pose that something else measures, like "
        "0.02mm,0.1mrad (default: none)",
    )


def add_limits(plan: Options) -> None:
    """Add the conditions that every setting must meet besides the accuracy."""
    limits = plan.add_argument_group(
        "limits", "Conditions of every setting. plan.json and the report list them."
    )
    limits.add_argument(
        "--stand-off",
        type=MM,
        default=50.0,
        metavar="MM",
        help="smallest distance of the camera from the part",
    )
    limits.add_argument(
        "--min-length-px",
        type=PX,
        default=20.0,
        metavar="PX",
        help="shortest image of an edge that is measured",
    )
    limits.add_argument(
        "--field-margin-px",
        type=PX,
        metavar="PX",
        help="strip along the sensor's sides that stays free (default: four standard deviations of "
        "the image's motion)",
    )
    limits.add_argument(
        "--focus-margin-mm",
        type=MM,
        metavar="MM",
        help="distance from both ends of the depth of field (default: for each end of an edge "
        "three standard deviations of its depth, at most an eighth of the depth of field but at "
        "least 1.645 of them)",
    )
    limits.add_argument(
        "--visibility-radius-mm",
        type=MM,
        metavar="MM",
        help="edges stay visible up to this distance around the camera (default: three standard "
        "deviations)",
    )
    limits.add_argument(
        "--give-up",
        type=SHARE,
        metavar="SHARE",
        help="move each setting away from its limits, as long as no probability falls by more than "
        "this; 0 does not move it (default: 0.001)",
    )
    add_showing(plan)


def add_showing(plan: Options) -> None:
    """Add what the image needs so that edges can be found in it."""
    shows = plan.add_argument_group(
        "edges in the image",
        "Conditions for finding edges and dimensions in the image. 0 switches one off.",
    )
    shows.add_argument(
        "--separation-px",
        type=PX,
        default=5.0,
        metavar="PX",
        help="distance from an edge, or a fitted line or circle, to the next visible line",
    )
    shows.add_argument(
        "--surround-px",
        type=PX,
        default=40.0,
        metavar="PX",
        help="distance from the ends of an edge to the border of the image",
    )
    shows.add_argument(
        "--min-corner-deg",
        type=DEG,
        default=25.0,
        metavar="DEG",
        help="angle at which another line leaves each end of an edge",
    )


def add_light(plan: Options) -> None:
    """Add the lamps."""
    light = plan.add_argument_group("light", "Lamps that make the edges of a matt part visible.")
    light.add_argument(
        "--light",
        metavar="LAMPS",
        help="ring (on the camera); places for lamps in box:X0,Y0,Z0,X1,Y1,Z1 or on "
        "dome:X,Y,Z,RADIUS[,LOWEST]; fixed lamps at:X,Y,Z[;X,Y,Z...] or a TOML file with "
        "lamps = [[X, Y, Z], ...]; in mm (default: no lamps)",
    )
    add_contrast(light, "least contrast of an edge")
    light.add_argument(
        "--grey-step",
        type=SHARE,
        default=DEFAULT_STEP,
        metavar="STEP",
        help="least difference of grey values across an edge, as a share of a face that is lit "
        "frontally",
    )
    light.add_argument(
        "--ground",
        choices=("dark", "bright"),
        default="dark",
        help="background behind the part; bright: a back light",
    )
    light.add_argument(
        "--together",
        action="store_true",
        help="switch all lamps on in every image, and use as few as possible (default: one by one)",
    )


def add_contrast(parser: Options, help_text: str) -> None:
    """Add the least contrast of an edge."""
    parser.add_argument(
        "--contrast",
        type=SHARE,
        default=0.1,
        metavar="C",
        help=f"{help_text}, (I1 - I2) / (I1 + I2)",
    )


def add_part(parser: Options) -> None:
    """Add the part."""
    parser.add_argument("part", metavar="PART", help=".step .stp .stl .obj .ply .off .glb")


def add_reading(parser: Options) -> None:
    """Add how the file of a part is read."""
    group = parser.add_argument_group("reading the part")
    add_units(group)
    group.add_argument(
        "--solids",
        type=indices,
        metavar="N,N",
        help="solids of a STEP file to measure, counted from 0 (default: all)",
    )
    group.add_argument(
        "--occluders",
        type=all_or_indices,
        metavar="all|N,N",
        help="solids that only block the view; all: those that --solids does not name",
    )
    group.add_argument(
        "--gap-mm",
        type=MM,
        metavar="MM",
        help="widest gap between the edges and faces of a STEP file",
    )
    group.add_argument(
        "--read-time-limit",
        type=SECONDS,
        metavar="S",
        help="end the reading of a STEP file after so many seconds (default: 300)",
    )


def add_units(parser: Options) -> None:
    """Add the unit of meshes."""
    parser.add_argument(
        "--units",
        metavar="UNIT",
        help="unit of a mesh: mm, cm, m, um, inch or ft (default: mm, m for .glb)",
    )


def add_select(parser: Options, help_text: str, default: str) -> None:
    """Add a rule that selects entities, of a command where it is not required."""
    parser.add_argument(
        "--select",
        metavar="RULE",
        help=f"{help_text}; see plan --help (default: {default})",
    )


def add_messages(parser: Options) -> None:
    """Add the options about what a command prints."""
    group = parser.add_argument_group("messages")
    group.add_argument("--help", "-h", action="help", help="show this help and exit")
    group.add_argument(
        "--json",
        action="store_true",
        help="print records for other programs instead of tables; mm and degrees where no unit "
        "is named",
    )
    which = group.add_mutually_exclusive_group()
    which.add_argument("--quiet", "-q", action="store_true", help="show no progress")
    which.add_argument(
        "--verbose",
        "-v",
        action="store_true",
        help="show progress as lines that stay, and the origin of an error",
    )


def add_entities(parser: Options) -> argparse._MutuallyExclusiveGroup:
    """Add the choice of entities; return the group, of which one is required."""
    which: argparse._MutuallyExclusiveGroup = parser.add_mutually_exclusive_group(required=True)
    which.add_argument(
        "--entities",
        metavar="FILE|IDS|all",
        help="TOML, JSON or CSV file; ids like 3,17-21,r2; end points like "
        "'(0,0,10)-(25,0,10)'; or all. A plan measures an edge's length, a rim's diameter and an "
        "arc's radius",
    )
    which.add_argument(
        "--select",
        metavar="RULE",
        help="conditions joined by 'and': length > 20, radius > 5, turn < 100, convex, reentrant, "
        "kind = rim, direction = z, face = top (bottom, left, right, front, back: of the part's "
        "box), near 10,20,30 < 5. Without kind or radius, only edges are selected",
    )
    which.add_argument(
        "--all", dest="entities", action="store_const", const="all", help="all sharp straight edges"
    )
    return which


def add_workspace(parser: Options) -> None:
    """Add the box the camera may be in."""
    parser.add_argument(
        "--workspace",
        type=MM,
        nargs=6,
        metavar=("X0", "Y0", "Z0", "X1", "Y1", "Z1"),
        help="opposite corners of the box the camera may be in, mm (default: as far around the "
        "part as the lens focuses)",
    )
