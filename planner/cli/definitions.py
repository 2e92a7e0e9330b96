"""The commands of the command line, and the options of each."""

from __future__ import annotations

import argparse
from typing import Any, NoReturn

from planner.cli.arguments import (
    P_ALONE,
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
from planner.cli.measuring.options import add_measure_options
from planner.cli.parsing.parser import Help, Parser
from planner.cli.parsing.quantities import MM, lengths, memory, whole
from planner.cli.robot.definitions import add_plan_cell, add_program, add_reach
from planner.executors import usable_cores

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
