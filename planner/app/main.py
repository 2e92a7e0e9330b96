"""The command line: what can be asked, and how errors and exit codes come out.

Results go to standard output, progress and errors to standard error. Exit codes: 0 done, 1 the plan is
incomplete (or was interrupted, or its simulation contradicts it, or a part does not conform), 2 bad input, 3 an
image could not be registered, 70 a fault of the program, 141 nobody reads the output any more. The imports that
take time happen inside the commands, so ``--help`` is immediate.
"""

from __future__ import annotations

import _thread
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from importlib import import_module
from types import FrameType

from ground.ahead import compiling_ahead
from planner.app.checks import as_typed, check_inputs, check_numbers, in_words_of_shell
from planner.app.options import Command
from planner.app.parsing import (
    UsageError,
    parse,
)
from planner.app.process import (
    BAD_INPUT,
    DONE,
    INCOMPLETE,
    INTERNAL,
    NOBODY_READS,
    output_fails,
    prepare_streams,
    quiet_libraries,
    settle,
    shortage,
    stop_writing,
    write_error,
    write_fault,
)
from planner.executors import TERMINATING, usable_cores
from planner.progress import loading_shown, visible, visible_output

# Requests to terminate: treated like an interruption from the keyboard, so that what was found
# out is kept.


# compiled loops are handed over to C in functions of this file: an exception there is lost, and the process crashes
_HANDED_OVER = "executionengine.py"
# while this is loaded, an exception becomes another one that says nothing of an interruption
_LOADING = os.path.join("open3d", "__init__.py")
_LATER_S = 0.02


@contextmanager
def termination_as_interruption() -> Iterator[None]:
    """Raise `KeyboardInterrupt` in the block when the process is asked to terminate, or interrupted at the keyboard."""
    before = {}
    # signals are the main thread's; one that is ignored, as after nohup, stays so
    if threading.current_thread() is threading.main_thread():
        before = {number: signal.getsignal(number) for number in (signal.SIGINT, *TERMINATING)}
    ours = [
        number
        for number, now in before.items()
        if now in (signal.SIG_DFL, signal.default_int_handler)
    ]
    try:
        for number in ours:
            signal.signal(number, _interrupt)
        yield
    finally:
        for number in ours:
            signal.signal(number, before[number])


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Raise `KeyboardInterrupt`; where that would not get through, a moment later."""
    while frame is not None:
        file = frame.f_code.co_filename
        name = frame.f_code.co_name
        handed_over = file.endswith(_HANDED_OVER) and name.startswith("_raw_object_cache")
        if handed_over or (file.endswith(_LOADING) and name == "<module>"):
            threading.Timer(_LATER_S, _thread.interrupt_main, (number,)).start()
            return
        frame = frame.f_back
    raise KeyboardInterrupt


# commands with a module of their own
_MODULES = {
    "cameras": "planner.app.catalogue_commands",
    "completion": "planner.app.catalogue_commands",
    "info": "planner.app.part",
    "lights": "planner.app.catalogue_commands",
    "measure": "planner.app.measure_command",
    "render": "planner.app.measure_command",
    "program": "planner.app.robot_commands",
    "reach": "planner.app.robot_commands",
}
# commands that need many compiled loops
_COMPILING = ("batch", "graph", "optics", "plan", "predict")
# commands that may take long before they print
_LONG = (*_COMPILING, "dimensions", "info", "measure", "program", "reach", "render")


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
    with visible_output(), quiet_libraries(arguments):
        try:
            return _run(arguments)
        except Exception as error:
            # whatever nobody foresaw, here and in the handling of errors, is no result
            write_fault(error, arguments)
            return INTERNAL


def _run(arguments: list[str] | None) -> int:
    """Run a command, and report an error in one line."""
    options = Command()
    try:
        if sys.stdout is None:
            return _fail("standard output must be open. Got a closed one.", BAD_INPUT)
        begun = time.monotonic()
        parsed = parse(sys.argv[1:] if arguments is None else arguments)
        if isinstance(parsed, str):
            print(parsed, flush=True)
            return DONE
        options = parsed
        options.begun = begun
        with termination_as_interruption():
            check_numbers(options)
            check_inputs(options)
            with _compiling(options):
                with _loading(options):
                    command = _command_of(options.name())
                code = command(options)
            # what is held back would fail where nobody can catch it
            print(end="", flush=True)
            return code
    except UsageError as error:
        return _fail(str(error), BAD_INPUT)
    except KeyboardInterrupt as interruption:
        # a command that can be resumed says how
        return _fail("; ".join(["interrupted", *map(str, interruption.args)]), INCOMPLETE)
    except Exception as error:
        ending = _ending(error, options)
        if ending is None:
            raise
        return _fail(*ending)
    finally:
        settle()


def _compiling(options: Command) -> AbstractContextManager[None]:
    """Begin to compile loops in other processes, for commands that need many of them."""
    if options.name() not in _COMPILING:
        return nullcontext()
    return compiling_ahead(min(getattr(options, "jobs", usable_cores()), usable_cores()))


def _loading(options: Command) -> AbstractContextManager[None]:
    """Show a line if it takes long to load a command that also takes long."""
    if options.name() not in _LONG or getattr(options, "quiet", False):
        return nullcontext()
    return loading_shown(options.begun)


def _command_of(name: str) -> Callable[[Command], int]:
    """Return the function of a command; it is loaded only now."""
    module = import_module(_MODULES.get(name, "planner.app.plan_commands"))
    command: Callable[[Command], int] = getattr(module, name)
    return command


def _ending(error: Exception, options: Command) -> tuple[str, int] | None:
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
        name = repr(path if len(path) <= 80 else f"{path[:77]}...")
        line = f"{_known_as(path, options)} must be a path that can be used. Got {name}: {error.strerror}."
        return line, BAD_INPUT
    return None


def _known_as(name: str, options: Command) -> str:
    """Return the option that a path was given by."""
    for key, value in vars(options).items():
        if isinstance(value, str) and os.path.abspath(value) == os.path.abspath(name):
            return as_typed(key, vars(options))
    return "path"


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
