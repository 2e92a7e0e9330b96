"""The command line: options, the commands, and exit codes.

Errors are one line on standard error, never a traceback. Commands are imported when they are run, so that
``--help`` is immediate.
"""

from __future__ import annotations

import os
import sys


def start() -> int:
    """Load the command line and run it; an interruption while it loads is one line, too.

    Products of matrices get one thread, unless the environment says otherwise: the matrices are small, and processes
    work side by side.

    Returns
    -------
    int
        The exit code.
    """
    # has to be said before numpy is loaded
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        from planner.cli.main import main
    except KeyboardInterrupt:
        from planner.cli.exit_codes import INCOMPLETE

        print("aspectgraph: interrupted", file=sys.stderr)
        return INCOMPLETE
    return main()
