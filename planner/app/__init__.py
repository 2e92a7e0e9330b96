"""The command line: options, the commands, and exit codes.

Errors are one line on standard error, and a traceback only of a fault with ``--verbose``. Commands are imported when
they are run, so that ``--help`` is immediate.
"""

from __future__ import annotations

import gc
import os

from planner.app.process import (
    BAD_INPUT,
    INCOMPLETE,
    INTERNAL,
    prepare_streams,
    shortage,
    write_error,
    write_fault,
)


def start() -> int:
    """Load the command line and run it; an interruption while it loads is one line, too.

    Products of matrices get one thread: the matrices are small, and processes work side by side.

    Returns
    -------
    int
        The exit code.
    """
    # has to be said before numpy is loaded
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    prepare_streams()
    try:
        from planner.app.main import main

        return main()
    except KeyboardInterrupt:
        write_error("aspectgraph: interrupted")
        return INCOMPLETE
    except Exception as error:
        # `main` raises nothing: the program, or a library of it, cannot be loaded
        line = shortage(error)
        if line is None:
            write_fault(error)
            return INTERNAL
        write_error(f"aspectgraph: {line}")
        return BAD_INPUT
    finally:
        # when a process ends, Python looks for garbage in all that is loaded and compiled, which takes up to a second
        gc.freeze()
