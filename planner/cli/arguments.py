"""Options that several commands have."""

from __future__ import annotations

import argparse
import re
from typing import Any

from planner.light.background import DEFAULT_STEP

_BYTES = {"mb": 1e6, "gb": 1e9, "tb": 1e12, "mib": 2.0**20, "gib": 2.0**30, "tib": 2.0**40}
# no file has more solids; Python reads no number of more than some thousand digits
_WHOLE = re.compile(r"\d{1,18}", re.ASCII)
_MEMORY = re.compile(r"(\d+(?:\.\d*)?(?:e[+-]?\d+)?) ?([MGT]i?B)?", re.ASCII | re.IGNORECASE)


def add_asked(parser: argparse.ArgumentParser) -> None:
    """Add what is asked of every plan."""
    parser.add_argument(
        "--camera", metavar="NAME|FILE", required=True, help="name of the catalogue, or a TOML file"
    )
    parser.add_argument("--out", metavar="DIR", required=True, help="folder to write to")
    add_promise(parser)
    add_limits(parser)
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="same seed, same plan")
    parser.add_argument(
        "--time-limit",
        type=float,
        metavar="S",
        help="end after so many seconds with the best plan so far",
    )
    parser.add_argument(
        "--gap",
        type=float,
        default=0.0,
        metavar="G",
        help="0.2: end the search when 20%% of the settings are unproven",
    )
    parser.add_argument(
        "--effort",
        choices=("quick", "standard", "thorough"),
        help="how long to search and to prove (default: standard)",
    )
    parser.add_argument(
        "--simulate", type=int, default=10_000, metavar="N", help="displaced poses per setting"
    )


class _Again(argparse.Action):
    """Takes a plan file; what its request says need not be given then."""

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


def add_again(parser: argparse.ArgumentParser) -> None:
    """Add the plan whose request is planned again."""
    parser.add_argument(
        "--again",
        metavar="PLAN",
        action=_Again,
        help="plan the request of a plan.json again, without its options; PART, too, if the part was moved",
    )


def add_wanted(parser: argparse.ArgumentParser) -> None:
    """Add what is to be measured, and how points are found."""
    add_entities(parser).add_argument(
        "--dimensions",
        metavar="FILE|all",
        help="TOML or JSON file of dimensions, or all that the part (AP242) states",
    )
    parser.add_argument(
        "--localisation",
        metavar="MODEL",
        help="how well points are found: rounding, gaussian[:SIGMA] or fit[:SIGMA[:CORRELATION[:FLOOR]]], in px "
        "(default: rounding for entities, gaussian:0.1 for dimensions)",
    )
    parser.add_argument(
        "--share",
        type=float,
        default=0.25,
        metavar="S",
        help="part of a tolerance's half width, permitted as error",
    )


def add_promise(parser: argparse.ArgumentParser) -> None:
    """Add what is to be promised of a measurement, and how far the camera may be from its planned pose."""
    parser.add_argument(
        "--accuracy",
        type=float,
        default=0.98,
        metavar="A",
        help="0.98 permits an error of 2%% of an edge's length, a rim's diameter or an arc's radius",
    )
    parser.add_argument(
        "--probability",
        type=float,
        default=0.9,
        metavar="P",
        help="required probability of it, given a registered image in which the edge is found",
    )
    parser.add_argument(
        "--sigma-mm", type=float, default=0.2, metavar="MM", help="camera position, std. deviation"
    )
    parser.add_argument(
        "--sigma-rad",
        type=float,
        default=0.002,
        metavar="RAD",
        help="camera orientation, std. deviation",
    )


def add_limits(plan: argparse.ArgumentParser) -> None:
    """Add what every setting must satisfy beside the accuracy."""
    limits = plan.add_argument_group(
        "limits", "what every setting must satisfy; plan.json and the report tell them"
    )
    limits.add_argument(
        "--stand-off",
        type=float,
        default=50.0,
        metavar="MM",
        help="smallest distance from the part",
    )
    limits.add_argument(
        "--min-length-px",
        type=float,
        default=20.0,
        metavar="PX",
        help="shortest image of an edge that is measured",
    )
    limits.add_argument(
        "--field-margin-px",
        type=float,
        metavar="PX",
        help="strip along the sensor's sides to keep free (default: four standard deviations of the image's motion)",
    )
    limits.add_argument(
        "--focus-margin-mm",
        type=float,
        metavar="MM",
        help="taken from both ends of the depth of field (default: for each end of an edge three standard deviations "
        "of its depth, at most an eighth of that depth of field but at least 1.645 of them)",
    )
    limits.add_argument(
        "--visibility-radius-mm",
        type=float,
        metavar="MM",
        help="all must be visible from so far around the camera, too (default: three standard deviations)",
    )
    add_showing(plan)


def add_showing(plan: argparse.ArgumentParser) -> None:
    """Add what the image needs so that edges can be found in it."""
    shows = plan.add_argument_group(
        "showing", "what edges need to be found in the image, and 0 where they need not"
    )
    shows.add_argument(
        "--separation-px",
        type=float,
        default=5.0,
        metavar="PX",
        help="no other visible line comes so near to an edge",
    )
    shows.add_argument(
        "--surround-px",
        type=float,
        default=40.0,
        metavar="PX",
        help="so much of the image lies around each end",
    )
    shows.add_argument(
        "--min-corner-deg",
        type=float,
        default=25.0,
        metavar="DEG",
        help="another line leaves each end at this angle",
    )


def add_light(plan: argparse.ArgumentParser) -> None:
    """Add which lamps there are."""
    light = plan.add_argument_group("light", "lamps that make the edges show; matt parts")
    light.add_argument(
        "--light",
        metavar="LAMPS",
        help="ring (on the camera); lamps to be placed in box:X0,Y0,Z0,X1,Y1,Z1 or on dome:X,Y,Z,RADIUS[,LOWEST]; "
        "fixed ones at:X,Y,Z[;X,Y,Z...] or a TOML file with lamps = [[X, Y, Z], ...]; in mm (default: no lamps)",
    )
    light.add_argument(
        "--contrast",
        type=float,
        default=0.1,
        metavar="C",
        help="least contrast of an edge, (I1 - I2) / (I1 + I2)",
    )
    light.add_argument(
        "--grey-step",
        type=float,
        default=DEFAULT_STEP,
        metavar="STEP",
        help="least difference of grey values across an edge, as a share of a face that is lit frontally",
    )
    light.add_argument(
        "--ground",
        choices=("dark", "bright"),
        default="dark",
        help="what is behind the part; bright: a back light",
    )
    light.add_argument(
        "--together",
        action="store_true",
        help="all lamps are on in every image; as few as show all (default: one by one)",
    )


def lengths(text: str) -> list[float]:
    """Return numbers separated by commas."""
    try:
        return [float(number) for number in text.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be numbers like 250,400. Got {text!r}.") from None


def memory(text: str) -> float:
    """Return an amount of memory in bytes; a number alone is in GiB."""
    found = _MEMORY.fullmatch(text.strip())
    if found is None or not float(found[1]) > 0:
        raise argparse.ArgumentTypeError(
            f"must be a positive number of GiB, or like 8GB or 500MB. Got {text!r}."
        )
    return float(found[1]) * _BYTES[(found[2] or "gib").lower()]


def add_part(parser: argparse.ArgumentParser) -> None:
    """Add the part and how its file is read."""
    parser.add_argument("part", metavar="PART", help=".step .stp .stl .obj .ply .off .glb")
    add_reading(parser)


def add_reading(parser: argparse.ArgumentParser) -> None:
    """Add how the file of a part is read."""
    parser.add_argument(
        "--units", metavar="UNIT", help="of a mesh: mm, inch, m, ... (default: mm, m for .glb)"
    )
    parser.add_argument(
        "--solids", type=numbers, metavar="N,N", help="which solids of a STEP file, counted from 0"
    )
    parser.add_argument(
        "--occluders",
        type=all_or_numbers,
        metavar="all|N,N",
        help="solids that only stand in the way; all: those --solids does not name",
    )
    parser.add_argument(
        "--gap-mm",
        type=float,
        metavar="MM",
        help="widest gap between a STEP file's edges and faces",
    )


def numbers(text: str) -> list[int]:
    """Return whole numbers separated by commas."""
    numbers = text.split(",")
    if not all(_WHOLE.fullmatch(number.strip()) for number in numbers):
        raise argparse.ArgumentTypeError(f"must be whole numbers like 0,2. Got {text!r}.")
    return [int(number) for number in numbers]


def all_or_numbers(text: str) -> str | list[int]:
    """Read ``all``, or whole numbers."""
    return text if text == "all" else numbers(text)


def add_entities(parser: argparse.ArgumentParser) -> argparse._MutuallyExclusiveGroup:
    """Add the choice of entities; return the group, of which one is required."""
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument(
        "--entities",
        metavar="FILE|IDS|all",
        help="TOML, JSON or CSV file, ids like 3,17-21,r2, end points like '(0,0,10)-(25,0,10)', or all; "
        "a plan measures an edge's length, a rim's diameter and an arc's radius",
    )
    which.add_argument(
        "--select",
        metavar="RULE",
        help="by conditions joined by 'and': length > 20, turn < 100, convex, reentrant, kind = rim, direction = z, "
        "face = top (bottom, left, right, front, back: of the part's box), near 10,20,30 < 5; edges only unless a kind "
        "is given",
    )
    which.add_argument(
        "--all", dest="entities", action="store_const", const="all", help="all sharp straight edges"
    )
    return which


def add_workspace(parser: argparse.ArgumentParser) -> None:
    """Add the box the camera may be in."""
    parser.add_argument(
        "--workspace",
        type=float,
        nargs=6,
        metavar=("X0", "Y0", "Z0", "X1", "Y1", "Z1"),
        help="opposite corners of the box the camera may be in, mm",
    )
