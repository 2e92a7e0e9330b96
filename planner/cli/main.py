"""The command line: what can be asked, and how errors and exit codes come out.

Results go to standard output, progress and errors to standard error. Exit codes: 0 done, 1 the plan is
incomplete (or was interrupted, or its simulation contradicts it), 2 bad input, 141 nobody reads the output
any more. The imports that take time happen inside the commands, so ``--help`` is immediate.
"""

from __future__ import annotations

import argparse
import os
import sys
import traceback
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from importlib import import_module
from typing import Any, NoReturn

from compiled.ahead import compiling_ahead
from planner.cli.arguments import (
    add_again,
    add_asked,
    add_entities,
    add_light,
    add_limits,
    add_part,
    add_promise,
    add_reading,
    add_wanted,
    add_workspace,
    lengths,
    memory,
)
from planner.cli.checks import check_inputs, check_numbers
from planner.cli.naming import as_typed, in_words_of_shell
from planner.cli.process.exit_codes import BAD_INPUT, INCOMPLETE, NOBODY_READS
from planner.cli.process.shortages import shortage
from planner.cli.process.signals import termination_as_interruption
from planner.cli.process.streams import (
    output_fails,
    prepare_streams,
    settle,
    stop_writing,
    write_error,
)
from planner.executors import usable_cores
from planner.progress.terminal_text import visible, visible_output

_DESCRIPTION = """\
Plan camera poses for the inspection of straight edges of a part: from where can each edge be measured to the required
accuracy, how probable is that, and how few poses suffice?"""

_EXAMPLES = """\
examples:
  aspectgraph info part.step
  aspectgraph info part.step --picture edges.html
  aspectgraph dimensions part.stp
  aspectgraph graph part.step --entities 12,15,31 --graphml graph.graphml
  aspectgraph plan part.step --entities edges.toml --camera basler-acA2440-20gm-25mm --out plan
  aspectgraph plan part.step --select "length > 20 and face = top" --camera camera.toml --out plan
  aspectgraph batch parts --camera camera.toml --out plans
  aspectgraph simulate plan/plan.json
  aspectgraph cameras
  aspectgraph optics part.step --select "length > 20" --body basler-acA2440-20gm

An entities file (TOML or JSON) maps names to edge ids, to ids of rims and arcs, or to two end points:
  top = 17
  bore = "r3"
  slot = [[0, 0, 10], [25, 0, 10]]

exit codes: 0 done, 1 plan incomplete, 2 bad input
(1 also if the simulation contradicts the plan, or the work was interrupted;
141 if a pipe is closed before all is written, as by head)"""


_COLUMNS = """\
columns:
  turn     how far the surface turns over an edge: positive where it is convex, negative where re-entrant
  ends     corner: another sharp edge leaves; tangent: the edge runs on smoothly, so its length has no end to measure to
  chords   straight edges that stand for a circle, of which a tessellated one is off by so much"""


# commands that need nothing that takes long to load
_MODULES = {"cameras": "planner.cli.catalogue_commands", "completion": "planner.cli.completion"}
# commands that need many compiled loops
_COMPILING = ("batch", "graph", "optics", "plan")


class _UsageError(Exception):
    """A command line that does not parse."""


class _Help(argparse.RawDescriptionHelpFormatter):
    """Ends the help of an option with its default, unless it says it itself."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        text = action.help or ""
        plain = isinstance(action.default, int | float | str) and not isinstance(
            action.default, bool
        )
        told = not plain or action.default == argparse.SUPPRESS or "default" in text
        return text if told else f"{text} (default: %(default)s)"


class _Parser(argparse.ArgumentParser):
    """Reports usage errors like all others: one line, and no usage text in front of it."""

    def print_help(self, file: Any = None) -> None:
        """Print all of it, or raise: argparse itself passes over a full disk."""
        print(self.format_help(), end="", file=file)

    def error(self, message: str) -> NoReturn:
        raise _UsageError(f"{self.prog}: {message.rstrip('.')}; see {self.prog} --help")


class _Version(argparse.Action):
    """Prints the version, which is looked up only when it is asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        print(_version())
        parser.exit()


def main(arguments: list[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : list of str, optional
        Default: those the program was started with.

    Returns
    -------
    int
        The exit code.
    """
    prepare_streams()
    with visible_output():
        return _run(arguments)


def _run(arguments: list[str] | None) -> int:
    """Run a command, and report an error in one line."""
    options = argparse.Namespace()
    try:
        if sys.stdout is None:
            return _fail("standard output must be open. Got a closed one.", BAD_INPUT)
        options = _parsed(arguments)
        given = sys.argv[1:] if arguments is None else arguments
        options.typed = {text.partition("=")[0] for text in given if text.startswith("--")}
        with termination_as_interruption():
            check_numbers(options)
            check_inputs(options)
            with _compiling(options):
                code: int = _command_of(options.command)(options)
            # what is held back would fail where nobody can catch it
            print(end="", flush=True)
            return code
    except _UsageError as error:
        return _fail(str(error), BAD_INPUT)
    except KeyboardInterrupt as interruption:
        # a command that can be resumed says how
        return _fail("; ".join(["interrupted", *map(str, interruption.args)]), INCOMPLETE)
    except Exception as error:
        # errors that nobody foresaw are raised again
        ending = _ending(error, options)
        if ending is None:
            raise
        return _fail(*ending)
    finally:
        settle()


def _compiling(options: argparse.Namespace) -> AbstractContextManager[None]:
    """Begin to compile loops in other processes, for commands that need many of them."""
    if options.command not in _COMPILING:
        return nullcontext()
    return compiling_ahead(min(getattr(options, "jobs", usable_cores()), usable_cores()))


def _command_of(name: str) -> Callable[[argparse.Namespace], int]:
    """Return the function of a command; it is loaded only now."""
    module = import_module(_MODULES.get(name, "planner.cli.commands"))
    command: Callable[[argparse.Namespace], int] = getattr(module, name)
    return command


def _parsed(arguments: list[str] | None) -> argparse.Namespace:
    """Return the options; help and version, which end the program, are written before it ends."""
    try:
        return build_parser().parse_args(arguments)
    except SystemExit:
        print(end="", flush=True)
        raise


def _ending(error: Exception, options: argparse.Namespace) -> tuple[str, int] | None:
    """Return the line and the exit code of an error; None of one that nobody foresaw."""
    if isinstance(error, _loaded_errors()):
        if getattr(options, "verbose", False):
            traceback.print_exc()
        from planner.exceptions import InfeasibleError

        message = in_words_of_shell(error, vars(options))
        return message, INCOMPLETE if isinstance(error, InfeasibleError) else BAD_INPUT
    if isinstance(error, BrokenPipeError):
        stop_writing()
        return "", NOBODY_READS
    if (line := shortage(error)) is not None:
        return line, BAD_INPUT
    if isinstance(error, OSError) and output_fails(error):
        return f"standard output must be writable. Got: {error.strerror}.", BAD_INPUT
    if isinstance(error, OSError) and isinstance(error.filename, str):
        path = error.filename
        shown = repr(path if len(path) <= 80 else f"{path[:77]}...")
        line = f"{_known_as(path, options)} must be a path that can be used. Got {shown}: {error.strerror}."
        return line, BAD_INPUT
    return None


def _known_as(name: str, options: argparse.Namespace) -> str:
    """Return the option that a path was given by."""
    for key, value in vars(options).items():
        if isinstance(value, str) and os.path.abspath(value) == os.path.abspath(name):
            typed = as_typed(key, vars(options))
            return f"the {key}" if key in ("plan", "folder") else typed
    return "path"


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command line."""
    parser = _Parser(
        prog="aspectgraph",
        description=_DESCRIPTION,
        epilog=_EXAMPLES,
        formatter_class=_Help,
        allow_abbrev=False,
    )
    parser.add_argument(
        "--version", action=_Version, nargs=0, help="show program's version number and exit"
    )
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    _add_info(commands)
    _add_graph(commands)
    _add_dimensions(commands)
    _add_plan(commands)
    _add_batch(commands)
    _add_simulate(commands)
    _add_cameras(commands)
    _add_optics(commands)
    completion = commands.add_parser(
        "completion",
        help="script that completes commands and options in a shell",
        formatter_class=_Help,
    )
    completion.add_argument(
        "shell", choices=("bash", "zsh"), help='for bash: eval "$(aspectgraph completion bash)"'
    )
    completion.set_defaults(parser=parser)
    return parser


def _command(commands: Any, name: str, what: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        name, help=what, description=what, formatter_class=_Help, allow_abbrev=False
    )
    told = (
        "print records for other programs instead of tables; mm and degrees where no unit is named"
    )
    parser.add_argument("--json", action="store_true", help=told)
    how_much = parser.add_mutually_exclusive_group()
    how_much.add_argument("--quiet", "-q", action="store_true", help="show no progress")
    told = "show progress as lines that stay, and of an error where it arose"
    how_much.add_argument("--verbose", "-v", action="store_true", help=told)
    return parser


def _add_info(commands: Any) -> None:
    info = _command(commands, "info", "edges, rims and arcs of a part, with ids")
    info.epilog = _COLUMNS
    add_part(info)
    info.add_argument(
        "--picture",
        metavar="FILE",
        help="draw the edges with their ids: .png, or .html to pick edges from and save them for --entities",
    )
    info.add_argument(
        "--select",
        metavar="RULE",
        help="only edges, rims and arcs for which it holds; see plan --help",
    )
    info.add_argument(
        "--min-length", type=float, default=0.0, metavar="MM", help="leave out shorter edges"
    )


def _add_graph(commands: Any) -> None:
    graph = _command(commands, "graph", "build and export the entity-based aspect graph")
    add_part(graph)
    add_entities(graph)
    graph.add_argument(
        "--graphml", metavar="FILE", required=True, help="GraphML for Gephi, yEd, Cytoscape, igraph"
    )
    graph.add_argument(
        "--camera",
        metavar="NAME|FILE",
        help="take the workspace 'plan' takes for this camera (default: ten diagonals of room around the part)",
    )
    graph.add_argument(
        "--lamps",
        action="store_true",
        help="of lamp positions instead of viewpoints: under which lamps edges show",
    )
    graph.add_argument(
        "--contrast",
        type=float,
        default=0.1,
        metavar="C",
        help="with --lamps: least contrast, (I1 - I2) / (I1 + I2)",
    )
    graph.add_argument(
        "--memory-limit",
        type=memory,
        metavar="GIB",
        help="end with an estimate if the graph takes more than about so much memory; also like 8GB or 500MB "
        "(default: what is free)",
    )
    add_workspace(graph)


def _add_dimensions(commands: Any) -> None:
    dimensions = _command(
        commands, "dimensions", "dimensions an AP242 file states, and how to measure them"
    )
    add_part(dimensions)


def _add_plan(commands: Any) -> None:
    plan = _command(commands, "plan", "plan the inspection and write plan, graph, report, poses")
    add_part(plan)
    add_again(plan)
    add_wanted(plan)
    add_asked(plan)
    add_light(plan)
    plan.add_argument(
        "--jobs",
        type=int,
        default=usable_cores(),
        metavar="N",
        help="processes to use, at most one per core",
    )
    plan.add_argument(
        "--resume", action="store_true", help="continue an interrupted plan from its state in DIR"
    )
    plan.add_argument(
        "--graph-limit",
        type=int,
        metavar="N",
        help="write graph.graphml, the joint graph, for up to so many entities (default: 24; more if it is small)",
    )
    plan.add_argument(
        "--force", action="store_true", help="replace a plan of another request in DIR"
    )
    add_workspace(plan)


def _add_batch(commands: Any) -> None:
    batch = _command(commands, "batch", "plan every part of a folder, on many processes")
    batch.add_argument("folder", metavar="FOLDER", help="part files, in it or in folders of it")
    which = batch.add_mutually_exclusive_group()
    which.add_argument(
        "--select",
        metavar="RULE",
        help="entities for which it holds, see plan --help (default: all)",
    )
    which.add_argument("--all", action="store_true", help="all sharp straight edges, as without it")
    batch.add_argument(
        "--units", metavar="UNIT", help="of meshes: mm, inch, m, ... (default: mm, m for .glb)"
    )
    add_asked(batch)
    batch.add_argument(
        "--graph-limit",
        type=int,
        default=0,
        metavar="N",
        help="write the joint graph for up to so many entities",
    )
    batch.add_argument(
        "--jobs",
        type=int,
        default=usable_cores(),
        metavar="N",
        help="parts at a time, at most one per core",
    )
    batch.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="of a Dask scheduler, like tcp://host:8786, to work there",
    )


def _add_simulate(commands: Any) -> None:
    simulate = _command(commands, "simulate", "check a plan by drawing displaced poses")
    simulate.add_argument("plan", metavar="PLAN", help="plan.json")
    simulate.add_argument(
        "--poses", type=int, default=100_000, metavar="N", help="displaced poses per setting"
    )
    simulate.add_argument("--seed", type=int, default=0, metavar="N", help="same seed, same poses")
    told = (
        "the plan's part; then it is counted, too, in how many displaced images edges can be found"
    )
    simulate.add_argument("--part", metavar="PART", help=told)
    add_reading(simulate)


def _add_cameras(commands: Any) -> None:
    cameras = _command(commands, "cameras", "the cameras and lenses --camera knows by name")
    told = "list bodies and lenses, and where each one's facts were read"
    cameras.add_argument("--sources", action="store_true", help=told)


def _add_optics(commands: Any) -> None:
    optics = _command(
        commands, "optics", "which body, lens, distance and aperture measure a part, and how well"
    )
    add_part(optics)
    add_wanted(optics)
    told = "only this body; can be given again (default: all of 'cameras --sources')"
    optics.add_argument("--body", action="append", metavar="NAME", help=told)
    told = "working distances to be tried, from the front nodal point (default: 100 to 1600 in seven steps)"
    optics.add_argument("--distances", type=lengths, metavar="MM,MM", help=told)
    optics.add_argument(
        "--rows", type=int, default=10, metavar="N", help="rows of the table, at most"
    )
    add_promise(optics)
    add_limits(optics)
    add_workspace(optics)


def _version() -> str:
    import planner

    return f"aspectgraph {planner.__version__}"


def _loaded_errors() -> tuple[type[Exception], ...]:
    """Return the exception trees of the packages; what is not loaded has raised nothing."""
    roots = {
        "aspectgraph.exceptions": "AspectGraphError",
        "errors.exceptions": "MeasurementModelError",
        "ga.exceptions": "GAError",
        "planner.exceptions": "PlannerError",
    }
    return tuple(
        getattr(sys.modules[module], name)
        for module, name in roots.items()
        if module in sys.modules
    )


def _fail(message: str, code: int) -> int:
    if message:
        line = visible(" ".join(message.split()))
        write_error(line if line.startswith("aspectgraph") else f"aspectgraph: {line}")
    return code


if __name__ == "__main__":
    sys.exit(main())
