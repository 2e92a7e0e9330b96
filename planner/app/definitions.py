"""Options of the commands about the robot."""

from __future__ import annotations

import argparse
from typing import Any, NoReturn

from planner.app.arguments import (
    P_ALONE,
    Options,
    add_again,
    add_asked,
    add_contrast,
    add_entities,
    add_graph_limit,
    add_jobs,
    add_light,
    add_limits,
    add_messages,
    add_part,
    add_promise,
    add_reading,
    add_registration,
    add_seed,
    add_select,
    add_units,
    add_wanted,
    add_workspace,
)
from planner.app.parsing import Help, Parser
from planner.app.quantities import (
    MM,
    PX,
    RAD,
    SECONDS,
    SHARE,
    WHITE,
    lengths,
    memory,
    sigma_pair,
    whole,
)
from planner.executors import usable_cores

# The options of ``measure``.


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
    images.add_argument(
        "--allow-lossy",
        action="store_true",
        help="accept JPEG and WebP files, and the mosaics of colour cameras",
    )
    images.add_argument(
        "--white-level",
        type=WHITE,
        metavar="GREY",
        help="grey value of full exposure, such as 4095 of 12 bits (default: that of the plan's "
        "camera, else where the image's brightest pixels end)",
    )
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


# The commands of the command line, and the options of each.


_DESCRIPTION = """\
Plan camera poses that measure edges and holes of a part: from where each can be
measured with the required accuracy, how probable that is, and how few poses
suffice."""

_EXAMPLES = """\
examples:
  aspectgraph info part.step --picture edges.html
  aspectgraph plan part.step --entities edges.toml --camera camera.toml
  aspectgraph plan part.step --select "length > 20" --camera camera.toml
  aspectgraph plan part.stp --dimensions all --camera camera.toml -o plan
  aspectgraph simulate plan
  aspectgraph reach plan part.step --cell cell.toml
  aspectgraph program plan part.step --cell cell.toml --format rapid
  aspectgraph measure plan images --part part.stp --out results
  aspectgraph optics part.step --select "length > 20" --write camera.toml
  aspectgraph batch parts --camera camera.toml --out plans
  aspectgraph graph part.step --entities 12,15,31 --graphml graph.graphml

An entities file (TOML or JSON) maps names to edge ids, to ids of rims and arcs,
or to two end points:
  top = 17
  bore = "r3"
  slot = [[0, 0, 10], [25, 0, 10]]

A dimensions file adds what is measured, and its tolerance:
  bore = { diameter = "r3", tolerance = [-0.05, 0.05] }

exit codes: 0 done, 1 plan incomplete, 2 bad input
(1 also if the simulation contradicts the plan, a measured part does not
conform, or the work was interrupted; 3 if an image cannot be registered;
70 if the program has a fault: please report it;
141 if a reader such as head closes the pipe early)"""

_COLUMNS = """\
columns:
  turn     angle by which the surface turns over an edge: positive where it is
           convex, negative where it is re-entrant
  ends     corner: another sharp edge leaves; a3: the edge ends in this
           tangent arc, so its length is undefined
  chords   straight edges that stand for a circle
  off by   largest distance of the chords from that circle"""


class _Version(argparse.Action):
    """Prints the version, which is looked up only when it is asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        print(_version())
        parser.exit()


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command line."""
    parser = Parser(
        prog="aspectgraph",
        description=_DESCRIPTION,
        epilog=_EXAMPLES,
        formatter_class=Help,
        allow_abbrev=False,
    )
    parser.add_argument(
        "--version", "-V", action=_Version, nargs=0, help="show the version and exit"
    )
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    _add_plan(commands)
    _add_info(commands)
    _add_dimensions(commands)
    _add_cameras(commands)
    _add_optics(commands)
    _add_simulate(commands)
    _add_reach(commands)
    _add_program(commands)
    add_measure_options(
        _command(
            commands,
            "measure",
            "measure a part in images of a plan's settings, and decide whether it conforms",
            "PLAN IMAGES --part PART --out DIR [options]",
        )
    )
    _add_batch(commands)
    _add_graph(commands)
    _add_completion(commands, parser)
    _add_help(commands, parser)
    return parser


def _command(commands: Any, name: str, what: str, usage: str) -> argparse.ArgumentParser:
    """Add a command; `_finished` adds the options that all commands have."""
    parser: argparse.ArgumentParser = commands.add_parser(
        name,
        help=what,
        description=f"{what[0].upper()}{what[1:]}.",
        formatter_class=Help,
        allow_abbrev=False,
        add_help=False,
        usage=f"%(prog)s {usage}".rstrip(),
    )
    return parser


def _add_plan(commands: Any) -> None:
    plan = _command(
        commands,
        "plan",
        "plan the inspection and write plan, graph, report and poses",
        "PART --entities FILE|IDS   --camera NAME|FILE [options]\n"
        "       %(prog)s PART --select RULE         --camera NAME|FILE [options]\n"
        "       %(prog)s PART --dimensions FILE|all --camera NAME|FILE [options]",
    )
    add_part(plan)
    add_wanted(plan)
    add_asked(plan, "plan")
    add_registration(plan)
    output = _group(plan, "output")
    output.add_argument(
        "--force",
        action="store_true",
        help="replace a plan of another request, and other files, in DIR",
    )
    output.add_argument(
        "--resume", action="store_true", help="continue an interrupted plan from its state in DIR"
    )
    add_again(output)
    add_graph_limit(output, "graph.graphml, the joint graph,", "24; more if it is small")
    add_jobs(_group(plan, "search"), "processes to use, at most one per core", usable_cores())
    add_workspace(_group(plan, "limits"))
    add_plan_cell(_group(plan, "limits"))
    add_light(plan)
    add_reading(plan)
    add_messages(plan)


def _group(parser: argparse.ArgumentParser, title: str) -> Any:
    """Return a group of options by its title."""
    return next(group for group in parser._action_groups if group.title == title)


def _add_info(commands: Any) -> None:
    info = _command(
        commands, "info", "list edges, rims and arcs of a part with their ids", "PART [options]"
    )
    info.epilog = _COLUMNS
    add_part(info)
    choice = info.add_argument_group("choice and picture")
    choice.add_argument(
        "--picture",
        metavar="FILE",
        help="draw the edges with their ids: .png, or .html to pick edges from and save them for "
        "--entities or --dimensions",
    )
    add_select(choice, "list only edges, rims and arcs for which the rule holds", "all")
    choice.add_argument(
        "--min-length", type=MM, default=0.0, metavar="MM", help="leave out shorter edges"
    )
    add_reading(info)
    add_messages(info)


def _add_graph(commands: Any) -> None:
    graph = _command(
        commands,
        "graph",
        "build the entity-based aspect graph and write it",
        "PART --entities FILE|IDS --graphml FILE [options]\n"
        "       %(prog)s PART --select RULE       --graphml FILE [options]",
    )
    add_part(graph)
    add_entities(graph.add_argument_group("entities", "Give one of these options."))
    output = graph.add_argument_group("graph")
    output.add_argument(
        "--graphml", metavar="FILE", required=True, help="GraphML for Gephi, yEd, Cytoscape, igraph"
    )
    output.add_argument(
        "--camera",
        metavar="NAME|FILE",
        help="take the workspace that 'plan' takes for this camera (default: ten diagonals of room "
        "around the part)",
    )
    add_workspace(output)
    output.add_argument(
        "--lamps",
        action="store_true",
        help="build the graph of lamp positions instead of viewpoints: which lamps make edges "
        "visible",
    )
    add_contrast(output, "with --lamps: least contrast")
    output.add_argument(
        "--memory-limit",
        type=memory,
        metavar="GIB",
        help="stop with an estimate if the graph takes more than about this much memory; "
        "like 8, 8GB or 500MB (default: what is free)",
    )
    add_reading(graph)
    add_messages(graph)


def _add_dimensions(commands: Any) -> None:
    dimensions = _command(
        commands,
        "dimensions",
        "list the dimensions of an AP242 file, and how to measure them",
        "PART [options]",
    )
    add_part(dimensions)
    add_reading(dimensions)
    add_messages(dimensions)


def _add_batch(commands: Any) -> None:
    batch = _command(
        commands,
        "batch",
        "plan every part of a folder, on many processes",
        "FOLDER --camera NAME|FILE --out DIR [options]",
    )
    batch.add_argument(
        "folder", metavar="FOLDER", help="folder with part files, also in its subfolders"
    )
    what = batch.add_argument_group("what to measure")
    which = what.add_mutually_exclusive_group()
    add_select(which, "entities for which the rule holds", "all sharp straight edges")
    which.add_argument("--all", action="store_true", help="all sharp straight edges, the default")
    add_asked(batch)
    _group(batch, "output").add_argument(
        "--force",
        action="store_true",
        help="replace plans and other files in DIR that no batch wrote",
    )
    add_graph_limit(_group(batch, "output"), "the joint graph of each part", "0")
    search = _group(batch, "search")
    add_jobs(search, "parts to plan at a time, at most one per core", usable_cores())
    search.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="work on a Dask scheduler, like tcp://host:8786 (default: on this machine)",
    )
    add_units(batch.add_argument_group("reading the parts"))
    add_messages(batch)


def _add_simulate(commands: Any) -> None:
    simulate = _command(
        commands, "simulate", "check a plan by drawing displaced poses", "PLAN [options]"
    )
    simulate.add_argument("plan", metavar="PLAN", help="plan.json, or the folder it is in")
    drawing = simulate.add_argument_group("simulation")
    drawing.add_argument(
        "--poses", type=whole, default=100_000, metavar="N", help="displaced poses per setting"
    )
    add_seed(drawing, "same seed, same poses")
    drawing.add_argument(
        "--part",
        metavar="PART",
        help="the part of the plan; the simulation then also counts the displaced images in which "
        "edges can be found (default: not counted)",
    )
    add_reading(simulate)
    add_messages(simulate)


def _add_reach(commands: Any) -> None:
    add_reach(
        _command(
            commands,
            "reach",
            "say which settings of a plan a robot reaches, and where the part should lie",
            "PLAN PART --cell FILE [options]",
        )
    )


def _add_program(commands: Any) -> None:
    add_program(
        _command(
            commands,
            "program",
            "write a robot program that takes the images of a plan",
            "PLAN PART --cell FILE [options]",
        )
    )


def _add_cameras(commands: Any) -> None:
    cameras = _command(
        commands, "cameras", "list the cameras and lenses that --camera knows by name", "[options]"
    )
    listing = cameras.add_argument_group("listing")
    listing.add_argument(
        "--sources",
        action="store_true",
        help="list bodies and lenses with their data sheets instead",
    )
    add_messages(cameras)


def _add_optics(commands: Any) -> None:
    optics = _command(
        commands,
        "optics",
        "rank bodies, lenses, distances and apertures by how well they measure a part",
        "PART --entities FILE|IDS   [options]\n"
        "       %(prog)s PART --select RULE         [options]\n"
        "       %(prog)s PART --dimensions FILE|all [options]",
    )
    add_part(optics)
    add_wanted(optics)
    choice = optics.add_argument_group("optics")
    choice.add_argument(
        "--body",
        action="append",
        metavar="NAME",
        help="try only this body; give it again for more (default: all of 'cameras --sources')",
    )
    choice.add_argument(
        "--distances",
        type=lengths,
        metavar="MM,MM",
        help="working distances to try, from the front nodal point (default: 100 to 1600 in seven "
        "steps)",
    )
    choice.add_argument(
        "--rows", type=whole, default=10, metavar="N", help="print at most this many rows"
    )
    choice.add_argument(
        "--write",
        metavar="FILE",
        help="write the camera of the first row as a TOML file for plan --camera (default: not "
        "written)",
    )
    add_promise(optics.add_argument_group("requirement"), P_ALONE)
    add_limits(optics)
    add_workspace(_group(optics, "limits"))
    add_reading(optics)
    add_messages(optics)


def _add_completion(commands: Any, parser: argparse.ArgumentParser) -> None:
    completion = commands.add_parser(
        "completion",
        help="print the script that completes commands and options in a shell",
        formatter_class=Help,
    )
    completion.add_argument(
        "shell",
        choices=("bash", "zsh", "fish"),
        help='for bash and zsh: eval "$(aspectgraph completion bash)"; '
        "for fish: aspectgraph completion fish | source",
    )
    completion.set_defaults(parser=parser)


def _add_help(commands: Any, parser: argparse.ArgumentParser) -> None:
    helping = commands.add_parser("help", help="show the help of a command", formatter_class=Help)
    helping.add_argument(
        "topic", metavar="COMMAND", nargs="?", help="the command (default: list all of them)"
    )
    helping.set_defaults(parser=parser)


def _version() -> str:
    import planner

    return f"aspectgraph {planner.__version__}"
