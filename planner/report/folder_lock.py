"""A folder that one process writes to at a time: another one is refused, and told who has it and since when.

The operating system holds the lock (``flock``) and releases it when the process ends, however it ends: a process that
was killed blocks nobody. A file system without such locks is served by the record in the lock file: who took the lock,
and when. There a lock is stale if its process is of this machine and no longer runs.
"""

from __future__ import annotations

import json
import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from planner.exceptions import OutputError
from planner.files import is_running

try:
    import fcntl
except ImportError:
    # Windows has none
    fcntl = None  # type: ignore[assignment]

LOCK_FILE = ".aspectgraph.lock"
# descriptors of locks that this process holds; a forked worker must not keep a lock alive
_held: set[int] = set()
# how long to wait for a worker that was forked as its parent was killed to close its copy of the lock, s
_ORPHAN_S = 5.0


@dataclass(frozen=True)
class LockOwner:
    """Who holds a lock.

    Attributes
    ----------
    pid : int
        Id of the process.
    host : str
        Name of its machine.
    started : str
        What tells the process from others that had the same id; empty where that is not known.
    since : float
        When it took the lock, seconds since 1970.
    """

    pid: int
    host: str
    started: str
    since: float

    @classmethod
    def this_process(cls) -> LockOwner:
        """Return the record of a lock that this process takes now."""
        return cls(os.getpid(), socket.gethostname(), _start_of(os.getpid()), time.time())

    @property
    def gone(self) -> bool:
        """Whether the process is of this machine and surely no longer runs."""
        if self.host != socket.gethostname():
            return False
        return not is_running(self.pid) or self.started != _start_of(self.pid)

    def __str__(self) -> str:
        """Return process, machine and age."""
        return f"process {self.pid} on {self.host} for {_age(time.time() - self.since)}"


@contextmanager
def folder_lock(folder: Path, parameter: str = "out") -> Iterator[None]:
    """Hold a folder for the block.

    Parameters
    ----------
    folder : Path
        An existing folder.
    parameter : str
        What the caller knows the folder as.

    Raises
    ------
    OutputError
        If another process holds it, or the lock cannot be written.
    """
    path = folder / LOCK_FILE
    try:
        handle = _acquired(path, parameter)
    except OSError as error:
        if isinstance(error, OutputError):
            raise
        raise OutputError.of_rule(
            parameter, "must be a folder that can be written", f"{folder}: {error.strerror}"
        ) from None
    _held.add(handle)
    try:
        yield
    finally:
        _held.discard(handle)
        # the name goes first: whoever opens the file until then sees that it is no longer the lock
        with suppress(OSError):
            if _is_named(handle, path):
                path.unlink()
        os.close(handle)


def _acquired(path: Path, parameter: str) -> int:
    """Return the descriptor of the lock file, which this process holds."""
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
        try:
            _take(handle, path, parameter)
            if _is_named(handle, path):
                _write_owner(handle)
                return handle
        except BaseException:
            # an interruption, too, must leave no descriptor open
            os.close(handle)
            raise
        # the owner before released it meanwhile, with its name
        os.close(handle)


def _take(handle: int, path: Path, parameter: str) -> None:
    """Lock an open file, or raise `OutputError` if another process holds it."""
    hint = ""
    try:
        if _flocked(handle):
            return
        owner = _owner_of(handle)
    except OSError:
        # this file system has no locks
        owner = _owner_of(handle)
        if owner is None or owner.gone:
            return
        hint = f"If that process has ended, delete {path}"
    raise OutputError.of_rule(
        parameter,
        "must be a folder that no other process writes to",
        f"{path.parent}, in use by {owner or 'another process'}",
        hint=hint,
    )


def _flocked(handle: int) -> bool:
    """Lock an open file, unless a process holds it; the workers of one that has ended are waited for.

    Raises
    ------
    OSError
        If this file system has no locks.
    """
    if fcntl is None:
        raise OSError
    end = time.monotonic() + _ORPHAN_S
    while True:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
        except BlockingIOError:
            owner = _owner_of(handle)
        if owner is None or not owner.gone or time.monotonic() > end:
            return False
        time.sleep(0.01)


def _is_named(handle: int, path: Path) -> bool:
    """Tell whether an open file still has its name."""
    try:
        return os.path.samestat(os.fstat(handle), os.stat(path))
    except FileNotFoundError:
        return False


def _write_owner(handle: int) -> None:
    os.ftruncate(handle, 0)
    os.lseek(handle, 0, os.SEEK_SET)
    os.write(handle, (json.dumps(asdict(LockOwner.this_process())) + "\n").encode())


def _owner_of(handle: int) -> LockOwner | None:
    """Return who took a lock, or None if its record cannot be read."""
    os.lseek(handle, 0, os.SEEK_SET)
    try:
        data: Any = json.loads(os.read(handle, 1 << 16))
        return LockOwner(
            int(data["pid"]), str(data["host"]), str(data["started"]), float(data["since"])
        )
    except (ValueError, TypeError, KeyError):
        return None


def _start_of(pid: int) -> str:
    """Return when a process began, in ticks since the machine did; empty where that is not known."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[19]
    except (OSError, IndexError):
        return ""


def _age(seconds: float) -> str:
    """Return a duration as a reader would say it."""
    for unit, size in (("day", 86_400), ("h", 3600), ("min", 60)):
        if seconds >= 2 * size:
            plural = "s" if unit == "day" else ""
            return f"{int(seconds // size)} {unit}{plural}"
    return f"{max(0, int(seconds))} s"


def _forget_in_child() -> None:
    """Close locks in a forked process: they are its parent's."""
    for handle in _held:
        with suppress(OSError):
            os.close(handle)
    _held.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_in_child)
