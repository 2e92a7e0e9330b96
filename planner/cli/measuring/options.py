"""The options of ``measure``."""

from __future__ import annotations

import argparse

from planner.cli.arguments import add_messages, add_reading
from planner.cli.parsing.quantities import MM, PX, SHARE

_CODES = """\
exit codes:
  0  all that has a tolerance conforms (--exit measured: all is measured)
  1  something does not conform, is undecided or is not measured
  2  bad input; with --parts, of at least one part
  3  an image cannot be registered"""


def add_measure_options(measure: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    measure.epilog = _CODES
    measure.add_argument("plan", metavar="PLAN", help="plan.json, or the folder it is in")
    measure.add_argument(
        "images",
        metavar="IMAGES",
        help="folder with setting_01.png and so on: PNG, TIFF, BMP or NumPy, 8 or 16 bits",
    )
    measure.add_argument("--part", metavar="PART", required=True, help="the part of the plan")
    measure.add_argument("--out", "-o", metavar="DIR", required=True, help="folder for the results")
    measure.add_argument(
        "--force",
        action="store_true",
        help="replace results of another part, and other files, in DIR",
    )
    poses = measure.add_argument_group("poses and surfaces")
    poses.add_argument(
        "--register",
        metavar="edges|none|FILE|edges+FILE",
        default="edges",
        help="edges: pose and surfaces are estimated from the part's own edges; none: the poses are "
        "those of the plan; a JSON file: camera poses by setting, such as setting_01, camera to "
        "world; a TOML file: a ChArUco board, with edges+ before it improved by the part's edges",
    )
    poses.add_argument(
        "--surfaces-mm",
        type=MM,
        metavar="MM",
        help="standard deviation of the position of the part's faces along their normals "
        "(default: that of the plan)",
    )
    _add_deciding(measure)
    measure.add_argument(
        "--qif", action="store_true", help="also write results.qif: QIF 3.0, with statuses and u"
    )
    images = measure.add_argument_group("images")
    images.add_argument("--serial", metavar="TEXT", help="name of the measured part, for the files")
    images.add_argument(
        "--parts",
        action="store_true",
        help="IMAGES holds a folder of images for each of many parts, named by their serials; a "
        "part that cannot be measured gets a reason, and the others are measured",
    )
    images.add_argument(
        "--partial", action="store_true", help="measure although images are missing"
    )
    images.add_argument("--allow-lossy", action="store_true", help="accept JPEG files")
    add_reading(measure)
    add_messages(measure)


def _add_deciding(measure: argparse.ArgumentParser) -> None:
    measure.add_argument_group("uncertainty").add_argument(
        "--floor-px",
        type=PX,
        metavar="PX",
        help="error that all points of an edge or rim have in common, standard deviation in pixels "
        "(default: that of the plan); a smaller one needs a measured part of known sizes as proof",
    )
    deciding = measure.add_argument_group("deciding")
    deciding.add_argument(
        "--coverage",
        type=SHARE,
        default=0.8,
        metavar="SHARE",
        help="least share of an edge or rim that must be found; otherwise it is not measured",
    )
    deciding.add_argument(
        "--rule",
        choices=("iso", "simple", "guard"),
        default="iso",
        help="iso: ISO 14253-1, right with 95 %%; simple: no guard bands; guard: guard bands of U",
    )
    deciding.add_argument(
        "--exit",
        choices=("conforms", "measured"),
        default="conforms",
        help="exit with 0 if everything conforms, or if everything is measured",
    )
