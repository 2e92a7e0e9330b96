"""Compiling ahead: all loops that a plan needs, by several processes at once, while the program still reads its part.

The file ``loops.json`` lists functions with their argument types, in the order in which a first plan needs them.
A leading process (`leader`) hands them out to others. Whoever needs a loop meanwhile waits for its file.

The list saves time, and no answer depends on it: a loop that is not in it is compiled where it is needed.
``python -m ground.leader`` compiles all of them, for instance in an image of a container.
"""

from __future__ import annotations

import gc
import hashlib
import json
import os
import stat
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

# Folders in which machine code can be kept: beside the source, in the user's cache, or in a
# temporary folder.
#
# Machine code runs when it is read. So no folder is used into which another user could put some,
# see `is_trusted`.


_TEMPORARY = "aspectgraph-loops"
_PRIVATE = 0o700
_READABLE = 0o755


def folders_for(source: Path) -> Iterator[Path]:
    """Yield the folders for the machine code of a source file, the best first; none is made.

    Those into which others could put code are left out. ``NUMBA_CACHE_DIR`` is the first where it is set, and the only
    one where it can be written. Next come ``__pycache__`` beside the source, the user's cache folder and a temporary
    folder of the user.

    Parameters
    ----------
    source : Path
        The file that defines the loops.

    Yields
    ------
    Path
        An absolute path.
    """
    chosen = chosen_folder()
    if chosen is not None and is_trusted(chosen, source):
        folder = chosen / _name_of(source)
        yield folder
        if is_writable(folder):
            return
    user = _user_cache()
    temporary = temporary_folder()
    places = [source.parent / "__pycache__"]
    if user is not None:
        places.append(user / "aspectgraph" / _name_of(source))
    if temporary is not None:
        places.append(temporary / _name_of(source))
    yield from (folder for folder in places if is_trusted(folder, source))


def is_trusted(path: Path, source: Path) -> bool:
    """Return whether nobody else can put machine code into a folder, or replace a file.

    It, all that it is in, and all links to it must belong to this user, to the system, or to whoever owns the source,
    as that runs as well. Others must not write there. In a folder above it they may, if they can rename nothing of
    others there, as in ``/tmp``.

    Parameters
    ----------
    path : Path
        The folder or file; what is not there yet is made by this user.
    source : Path
        The file that defines the loops.
    """
    if not hasattr(os, "getuid"):
        # Windows: the folders that are looked at belong to one user
        return True
    try:
        owners = {0, os.getuid(), Path("/").stat().st_uid, source.stat().st_uid}
    except OSError:
        owners = {0, os.getuid()}
    path = path.absolute()
    try:
        return all(_is_safe(way, owners) for way in {path, path.resolve()})
    except (OSError, RuntimeError):
        # such as a circle of links
        return False


def _is_safe(path: Path, owners: set[int]) -> bool:
    """Return whether only these users can change a path that may have links in it."""
    for place in (path, *path.parents):
        try:
            status = place.lstat()
        except (FileNotFoundError, NotADirectoryError):
            continue
        if status.st_uid not in owners:
            return False
        # who may write to a link is not told by its mode
        is_open = status.st_mode & (stat.S_IWGRP | stat.S_IWOTH) and not stat.S_ISLNK(
            status.st_mode
        )
        is_sticky = place != path and status.st_mode & stat.S_ISVTX
        if is_open and not is_sticky:
            return False
    return True


def chosen_folder() -> Path | None:
    """Return the folder that numba's settings name; before numba is loaded, which takes long, the environment's."""
    config = sys.modules.get("numba.core.config")
    if config is None:
        name = os.environ.get("NUMBA_CACHE_DIR", "")
    else:
        name = str(getattr(config, "CACHE_DIR", ""))
    return Path(name).absolute() if name else None


def temporary_folder() -> Path | None:
    """Return the user's temporary folder for machine code; none where others could write it.

    Machine code runs when it is read, so only a folder that belongs to this user alone will do.
    """
    try:
        parent = Path(tempfile.gettempdir())
    except OSError:
        return None
    if not hasattr(os, "getuid"):
        # Windows: the folder for temporary files belongs to one user
        return parent / _TEMPORARY
    try:
        folder = parent / f"{_TEMPORARY}-{os.getuid()}"
        return folder if is_trusted(folder, folder) and _is_private(folder) else None
    except OSError:
        return None


def make_folder(folder: Path) -> None:
    """Make a folder; the temporary one, and what is in it, for this user only.

    Raises
    ------
    OSError
        If it cannot be made, or is the temporary folder and not private.
    """
    temporary = temporary_folder()
    if temporary is not None and temporary in folder.parents:
        temporary.mkdir(mode=_PRIVATE, exist_ok=True)
        # somebody else may have made it meanwhile
        if hasattr(os, "getuid") and not _is_private(temporary):
            raise PermissionError(f"{temporary} must belong to this user only")
        folder.mkdir(mode=_PRIVATE, exist_ok=True)
        return
    for place in (*reversed(folder.parents), folder):
        # whatever the user's mask says: nobody else may write there
        place.mkdir(mode=_READABLE, exist_ok=True)


def is_temporary(folder: Path) -> bool:
    """Return whether a folder is in the temporary one, which the system may empty."""
    return any(parent.name.startswith(_TEMPORARY) for parent in folder.parents)


def is_writable(folder: Path) -> bool:
    """Return whether files can be made in a folder that is there, or that could be made."""
    for place in (folder, *folder.parents):
        if os.path.lexists(place):
            return place.is_dir() and os.access(place, os.W_OK | os.X_OK)
    return False


def can_keep(source: Path) -> bool:
    """Return whether any folder seems to take the machine code of a source file."""
    return any(is_writable(folder) for folder in folders_for(source))


def _name_of(source: Path) -> str:
    """Return a folder name for the folder of a source file: two copies of the sources do not share one."""
    folder = source.absolute().parent
    return f"{folder.name}_{hashlib.sha256(os.fsencode(folder)).hexdigest()[:32]}"


def _user_cache() -> Path | None:
    """Return the user's cache folder; None for a user without a home."""
    from platformdirs import user_cache_dir

    try:
        folder = Path(user_cache_dir())
    except RuntimeError:
        return None
    # earlier versions keep an unknown user's ~, which would be a folder of the current one
    return folder if folder.is_absolute() else None


def _is_private(folder: Path) -> bool:
    """Return whether a folder is not there yet, or is this user's, and no link."""
    try:
        status = folder.lstat()
    except FileNotFoundError:
        return True
    ours = status.st_uid == os.getuid()
    return stat.S_ISDIR(status.st_mode) and ours and not status.st_mode & 0o077


try:
    import fcntl
except ImportError:
    # Windows: every process compiles what it needs
    fcntl = None  # type: ignore[assignment]

# of the files that say how far a run is
PREFIX = f"ahead-{sys.implementation.cache_tag}-"
LISTED = Path(__file__).parent / "loops.json"
# machine code that a wheel brings
SHIPPED = Path(__file__).parent / "shipped"
# more processes end no sooner: the longest chain of loops that need each other takes that long
MOST_PROCESSES = 8
# far longer than any loop takes; no loop was done meanwhile, as if a process were stopped
_SILENCE_S = 300.0
# made since garbage was collected; a loop makes some ten thousand
_MANY_OBJECTS = 300_000
_PROGRAM = """
import sys
sys.path[:] = {path!r}
from ground.leader import lead
lead({handle!r}, {state!r}, {done!r}, {processes!r}, ends_with_starter=True)
"""


class Progress(NamedTuple):
    """How far the processes are: loops done, all loops, and how many of those done had to be compiled."""

    done: int
    total: int
    compiled: int


@dataclass
class AheadRun:
    """Processes that compile ahead.

    Attributes
    ----------
    state : Path
        The file in which they report; the leading one holds a lock on it.
    process : subprocess.Popen, optional
        The leading process, if this process started it.
    is_late : bool
        Whether it was started when a loop was missed already: this process then compiles until it has read its list.
    """

    state: Path
    process: subprocess.Popen[bytes] | None = None
    is_late: bool = False
    _looked_again: set[int] = field(default_factory=set)
    # when the state was last written, and when this process noticed it
    _written_ns: int = -1
    _noticed_s: float = 0.0
    _indices: dict[str, int] | None = None

    def is_active(self) -> bool:
        """Return whether the leading process lives, and loops are still being done."""
        try:
            handle = os.open(self.state, os.O_RDONLY)
        except OSError:
            return False
        try:
            fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return not self.is_silent()
        except OSError:
            return False
        finally:
            os.close(handle)
        return False

    def is_silent(self) -> bool:
        """Return whether no loop was done for minutes, as this process saw it."""
        try:
            written_ns = self.state.stat().st_mtime_ns
        except OSError:
            # removed in the end
            return False
        now = time.monotonic()
        if written_ns != self._written_ns:
            self._written_ns = written_ns
            self._noticed_s = now
        return now - self._noticed_s > _SILENCE_S

    def progress(self) -> Progress | None:
        """Return how far it is; None before it has read its list, or after its end."""
        counts = self._report()[0].split()
        return Progress(*map(int, counts)) if len(counts) == len(Progress._fields) else None

    def expects(self, function: Callable[..., Any], signature: Any) -> bool:
        """Return whether the file of a loop is still to come; if so, it is compiled next.

        Parameters
        ----------
        function : callable
            The Python function.
        signature : numba signature or tuple of types
            Of its arguments.
        """
        if self._indices is None:
            self._indices = {json.dumps(loop): i for i, loop in enumerate(read_list())}
        index = self._indices.get(json.dumps(list_entry(function, signature)))
        if index is None:
            return False
        counts, done = self._report()
        if self.is_late and not counts:
            return False
        if done[index : index + 1] != "1":
            self._wish(index)
            return True
        # its file may have come since it was looked for
        first = index not in self._looked_again
        self._looked_again.add(index)
        return first

    def end(self) -> None:
        """End the processes, if this process started them; what they compiled stays."""
        if self.process is None:
            return
        assert self.process.stdin is not None
        with suppress(OSError):
            self.process.stdin.close()
        # also where it is stopped, when it would not take a milder signal; those it leads notice it
        self.process.kill()
        self.process.wait()

    def _report(self) -> tuple[str, str]:
        try:
            counts, _, done = self.state.read_text().partition("\n")
        except OSError:
            return "", ""
        return counts, done

    def _wish(self, index: int) -> None:
        if self.process is not None and self.process.stdin is not None:
            with suppress(OSError, ValueError):
                os.write(self.process.stdin.fileno(), f"{index}\n".encode())


@dataclass
class _Process:
    """The run this process waits for.

    Attributes
    ----------
    run : AheadRun, optional
        It compiles already.
    processes : int
        How many may compile in a run that begins with the first loop without a file; 0: none begins.
    starter : int
        Id of the process that may begin it. Forked ones join it.
    begun : AheadRun, optional
        As `run`, also when this process no longer waits for it.
    """

    run: AheadRun | None = None
    processes: int = 0
    starter: int = 0
    begun: AheadRun | None = None


_process = _Process()
_beginning = threading.Lock()


def current_run() -> AheadRun | None:
    """Return the processes that compile ahead for this one, if there are any."""
    return _process.run


def may_begin() -> bool:
    """Return whether processes compile ahead for this one, or will if a loop has no file."""
    return _process.run is not None or _process.processes > 0


def is_awaited(function: Callable[..., Any], signature: Any) -> bool:
    """Return whether another process is about to compile a loop.

    Parameters
    ----------
    function, signature
        See `AheadRun.expects`.
    """
    if _process.processes and _is_listed(function, signature):
        _begin(is_late=True)
    run = _process.run
    if run is None:
        return False
    if not run.is_active():
        # one more look, for what it did last
        _process.run = None
        return True
    return run.expects(function, signature)


def _is_listed(function: Callable[..., Any], signature: Any) -> bool:
    return list_entry(function, signature) in read_list()


def _begin(*, is_late: bool) -> None:
    """Begin or join a run; a late one has a first loop without a file as its reason."""
    with _beginning:
        if not _process.processes:
            # another thread has
            return
        run = _begun(_process.processes if _process.starter == os.getpid() else 1)
        if run is not None:
            run.is_late = is_late and run.process is not None
        _process.run = run
        _process.begun = run
        _process.processes = 0


@contextmanager
def compiling_ahead(processes: int) -> Iterator[None]:
    """Compile all listed loops in other processes meanwhile; with one process, leave them to this one.

    Where machine code is kept already, they begin at the first loop that has none: most often there is no such loop.

    Parameters
    ----------
    processes : int
        How many may compile at once.
    """
    _process.processes = min(processes, MOST_PROCESSES)
    _process.starter = os.getpid()
    if not _has_kept():
        _begin(is_late=False)
    try:
        yield
    finally:
        # also a run that this process no longer waits for
        if _process.begun is not None:
            _process.begun.end()
        _process.run = None
        _process.begun = None
        _process.processes = 0


def _has_kept() -> bool:
    """Return whether there is machine code of any loop of this package, kept here or shipped."""
    folders = [*folders_for(Path(__file__)), SHIPPED]
    return any(next(folder.glob("*.nbc"), None) is not None for folder in folders)


def _begun(processes: int) -> AheadRun | None:
    """Start a run, or join the one that another program has started; None where neither is of use."""
    files = state_files()
    if files is None:
        return None
    state, done = files
    try:
        handle = taken(state)
    except OSError:
        # a file system without locks
        return None
    if handle is None:
        return AheadRun(state)
    try:
        if processes < 2:
            state.unlink(missing_ok=True)
            return None
        program = _PROGRAM.format(
            path=sys.path, handle=handle, state=str(state), done=str(done), processes=processes
        )
        process = subprocess.Popen(
            [sys.executable, "-c", program],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=[handle],
            # an interruption from the keyboard is for the program that started it
            start_new_session=True,
        )
        return AheadRun(state, process)
    except OSError:
        return None
    finally:
        # the lock is the leading process's now
        os.close(handle)


def taken(state: Path) -> int | None:
    """Return a descriptor that holds the lock of a state file; None if another process holds it.

    Parameters
    ----------
    state : Path
        Made if it is not there.

    Raises
    ------
    OSError
        If it cannot be made or locked.
    """
    handle = os.open(state, os.O_RDWR | os.O_CREAT, 0o666)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        return None
    except OSError:
        os.close(handle)
        raise
    return handle


def state_files() -> tuple[Path, Path] | None:
    """Return the state file of a run and the file that says it is done; None where a run is of no use."""
    if fcntl is None or os.environ.get("NUMBA_DISABLE_JIT", "0") != "0" or not LISTED.is_file():
        return None
    name = f"{PREFIX}{_digest()}"
    for folder in folders_for(Path(__file__)):
        if (folder / f"{name}.done").exists():
            return None
        try:
            make_folder(folder)
            os.close(os.open(folder / f"{name}.state", os.O_RDWR | os.O_CREAT, 0o666))
        except OSError:
            continue
        return folder / f"{name}.state", folder / f"{name}.done"
    return None


def _digest() -> str:
    """Return a digest of what may ask for other files: sources, versions, settings and the processor."""
    parts = [sys.version]
    parts += [f"{name}={value}" for name, value in sorted(os.environ.items()) if "NUMBA_" in name]
    root = LISTED.parents[1]
    for package in sorted({loop[0].partition(".")[0] for loop in read_list()}):
        for path in sorted((root / package).rglob("*.py")):
            status = path.stat()
            parts.append(f"{path} {status.st_size} {status.st_mtime_ns}")
    parts.append(_processor())
    return hashlib.sha256("\n".join([LISTED.read_text(), *parts]).encode()).hexdigest()[:20]


def _processor() -> str:
    try:
        with open("/proc/cpuinfo") as lines:
            return next((line for line in lines if line.startswith("model name")), "")
    except OSError:
        return ""


def collect_seldom() -> None:
    """Collect garbage if a compiler has made much since the last time, where Python itself is told not to.

    Python looks through all that stays of compiling after every few hundred objects, a quarter of the time. Without
    any collecting, half of what is in memory in the end is garbage.
    """
    if gc.get_count()[0] > _MANY_OBJECTS:
        gc.collect()


def read_list() -> list[list[Any]]:
    """Return the listed loops: the function's address, then plain data of each argument's type."""
    loops: list[list[Any]] = json.loads(LISTED.read_text())
    return loops


def list_entry(function: Callable[..., Any], signature: Any) -> list[Any] | None:
    """Return what the list says of a loop; None if it has no words for it.

    Parameters
    ----------
    function, signature
        See `AheadRun.expects`.
    """
    from ground.loop_code import address_of, encoded

    try:
        kinds = [encoded(kind) for kind in getattr(signature, "args", signature)]
    except (ValueError, ImportError, AttributeError):
        return None
    return [address_of(function), *kinds]
