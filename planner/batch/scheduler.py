"""Workers of a Dask cluster as an executor."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from aspectgraph.exceptions import MissingExtraError, how_to_install
from planner.exceptions import RequestError

_ANSWERS_S = 15


@contextmanager
def dask_executor(address: str) -> Iterator[Executor]:
    """Connect to a Dask scheduler; its executor gives every part its own task.

    Parameters
    ----------
    address : str
        Such as ``tcp://host:8786``.

    Raises
    ------
    MissingExtraError
        If Dask is not installed.
    RequestError
        If no scheduler answers there.
    """
    try:
        # its functions have no types
        connect: Any = import_module("distributed").Client
    except ImportError:
        raise MissingExtraError(
            f"a scheduler needs Dask's distributed, which is not installed; {how_to_install('dask')}."
        ) from None
    try:
        client = connect(address, timeout=_ANSWERS_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise RequestError.of_rule(
            "scheduler",
            "must be the address of a Dask scheduler that answers, like tcp://host:8786",
            f"{address!r}: {reason}",
        ) from None
    try:
        # results are small, and a part planned again costs more than a look at its folder
        yield client.get_executor(pure=False)
    finally:
        client.close()
