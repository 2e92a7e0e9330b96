"""Writing files so that a reader never meets half of one: write beside the target, then rename."""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
import re
import shutil
import socket
import stat
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from planner.exceptions import OutputError, PlanFileError

# Writing files so that a reader never meets half of one: write beside the target, then rename.


# hidden files and folders of a process that writes begin like this, then come its machine and its id
_HIDDEN = ".aspectgraph-"
_OWNED = re.compile(r"\.aspectgraph-([0-9a-f]{8})-(\d+)-")
# what nobody knows the owner of is of a killed process when it is so old
_FORGOTTEN_S = 86_400.0


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a text file in UTF-8; it appears whole or not at all. What is a device or a pipe is written to.

    Raises
    ------
    OutputError
        If the folder does not exist or cannot be written.
    """
    path = Path(path)
    with _writing(path):
        if _is_device(path):
            path.write_bytes(text.encode())
            return
        _check_replaceable(path)
        handle, temporary = _made_beside(path)
        try:
            # lines end as their format says, on every system
            with os.fdopen(handle, "w", encoding="utf-8", newline="") as stream:
                stream.write(text)
            os.chmod(temporary, 0o666 & ~_umask())
            os.replace(temporary, path)
        finally:
            Path(temporary).unlink(missing_ok=True)


# more seconds than that are beyond the year 5138
_SECONDS_DIGITS = 11


def timestamp(environment: Mapping[str, str] | None = None) -> str:
    """Return date and time (UTC) for a file: of ``SOURCE_DATE_EPOCH`` if that is set, otherwise now.

    Parameters
    ----------
    environment : mapping of str to str, optional
        The environment. Default: that of the process.

    Returns
    -------
    str
        In the form of ISO 8601, such as ``"2026-03-01T09:30:00Z"``.
    """
    text = (os.environ if environment is None else environment).get("SOURCE_DATE_EPOCH", "")
    is_seconds = text.isascii() and text.isdigit() and len(text) <= _SECONDS_DIGITS
    seconds = int(text) if is_seconds else time.time()
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(seconds))


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Raise `OutputError` where the system does not let a file be written."""
    try:
        yield
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(
            f"{path} must be a file that can be written. Got: {error.strerror}."
        ) from None


def _made_beside(path: Path) -> tuple[int, str]:
    """Return descriptor and name of a new file in the folder of a file."""
    try:
        return tempfile.mkstemp(prefix=f".{path.name}-", dir=path.parent)
    except UnicodeEncodeError:
        raise OutputError.of_rule(
            "path", "must be the name of a file", f"{str(path)!r} with half a character"
        ) from None
    except OSError as error:
        raise OutputError(
            f"{path} must be in a folder that can be written. Got: {error.strerror}."
        ) from None


def _is_device(path: Path) -> bool:
    # its package takes a second to load, and is there by the time that anything is written
    from aspectgraph.files import is_device

    return is_device(path)


def _check_replaceable(path: Path) -> None:
    from aspectgraph.files import check_replaceable

    check_replaceable(path)


class Kind(NamedTuple):
    """A kind of file that may replace one of its own kind.

    Attributes
    ----------
    name : str
        What a message calls such a file.
    signs : tuple of bytes
        One of them is in the first bytes of each such file.
    """

    name: str
    signs: tuple[bytes, ...]

    def includes(self, path: Path) -> bool:
        """Tell whether a file is of this kind; an empty one holds nothing that could be lost."""
        with open(path, "rb") as stream:
            head = stream.read(_HEAD_BYTES)
        return not head or any(sign in head for sign in self.signs)


# a sign stands behind a title or a heading at most
_HEAD_BYTES = 4096
GRAPHML = Kind("a GraphML file", (b"<graphml",))
PICTURE = Kind("a PNG file", (b"\x89PNG\r\n\x1a\n",))
PICKER = Kind(
    "a page of 'info --picture'", (b'<meta name="generator" content="aspectgraph picker">',)
)
PLAN = Kind("a plan of aspectgraph", (b'"aspectgraph inspection plan"',))
PROGRAM = Kind(
    "a robot program of aspectgraph", (b"Made by aspectgraph on ", b'"aspectgraph robot program"')
)


def check_file_place(
    path: str | os.PathLike[str], parameter: str = "path", kind: Kind | None = None
) -> None:
    """Refuse a file that could not be written, before the work and not after it.

    Parameters
    ----------
    path : path
    parameter : str
        What the caller knows the file as.
    kind : Kind, optional
        What is written. A file of another kind, which somebody else made, is not replaced.

    Raises
    ------
    OutputError
        If it is a folder, may not be replaced, or nothing can be written beside it: that is tried.
    """
    path = Path(path)
    check_path_text(path, parameter)
    if path.is_dir():
        raise OutputError.of_rule(
            parameter, "must be a file that can be written", f"'{path}', a folder"
        )
    # what is asked of a file that may be there takes a second to load
    is_reachable = path.parent.is_dir()
    if is_reachable and _is_device(path):
        return
    try:
        if is_reachable:
            _check_replaceable(path)
        if kind is not None and path.is_file() and not kind.includes(path):
            raise OutputError.of_rule(
                parameter, f"must be a new file, or {kind.name}", f"'{path}', which is another file"
            )
    except OutputError:
        raise
    except OSError as error:
        raise OutputError.of_rule(
            parameter, "must be a file that can be written", f"'{path}': {error.strerror}"
        ) from None
    try:
        _try_to_write(path.parent)
    except OSError as error:
        raise OutputError.of_rule(
            parameter,
            "must be in a folder that exists and can be written",
            f"'{path}': {error.strerror}",
        ) from None


def check_path_text(path: Path, parameter: str) -> None:
    """Refuse what no file can be called.

    Raises
    ------
    OutputError
        If it holds half a character, or the sign that ends a name.
    """
    try:
        if b"\0" not in os.fsencode(path):
            return
    except UnicodeEncodeError:
        pass
    raise OutputError.of_rule(parameter, "must be the name of a file", ascii(str(path)))


def check_set_place(
    folder: Path,
    names: Sequence[str],
    stranger: Callable[[Path], str],
    parameter: str = "--out",
    *,
    others: Sequence[str] = (),
    alone: bool = False,
) -> None:
    """Refuse a folder in which a set of files would replace files that are not of such a set.

    Parameters
    ----------
    folder : pathlib.Path
        The folder; it need not be there.
    names : sequence of str
        Files of the set. The first one says whose they are.
    stranger : callable
        Says whose the first file, which is there, is if its set may not be replaced, such as "which is of another
        part"; nothing if it may.
    parameter : str
        What the caller knows the folder as.
    others : sequence of str
        Files by which the folder belongs to another set.
    alone : bool
        Whether a folder of no such set must be empty, but for hidden files.

    Raises
    ------
    OutputError
        Names the file that would be lost.
    """
    for name in others:
        if os.path.lexists(folder / name):
            raise _taken(folder / name, parameter, "")
    mark = folder / names[0]
    if os.path.lexists(mark):
        if reason := stranger(mark):
            raise _taken(mark, parameter, f", {reason}")
        return
    for name in names[1:]:
        if os.path.lexists(folder / name):
            raise _taken(folder / name, parameter, f" without {names[0]}")
    if not alone or not folder.is_dir():
        return
    for path in sorted(folder.iterdir()):
        if not path.name.startswith("."):
            hint = "give a new folder, or write there with --force"
            raise _taken(path, parameter, "", hint)


def _taken(path: Path, parameter: str, what: str, hint: str = "") -> OutputError:
    force = "--force" if parameter.startswith("--") else "--force, in Python replace=True,"
    return OutputError.of_rule(
        parameter,
        "must be a folder without files of others",
        f"{path_text(path)}{what}",
        hint=hint or f"{force} replaces it",
    )


@contextmanager
def output_folder(
    path: str | os.PathLike[str], names: Sequence[str] = (), parameter: str = "output folder"
) -> Iterator[Path]:
    """Make a folder if there is none, and try whether files can be written; forget it if nothing is written.

    Parameters
    ----------
    path : path
    names : sequence of str
        Files to be written later, relative to the folder.
    parameter : str
        What the caller knows the folder as.

    Yields
    ------
    pathlib.Path
        The folder. Folders made for it are removed at the end if they are empty.

    Raises
    ------
    OutputError
        If it is no folder, cannot be made or written, or a folder is in a file's way.
    """
    # errors name it as it was given, the work may not depend on where the process is
    stated_path = Path(path)
    check_path_text(stated_path, parameter)
    path = absolute(stated_path)
    made: list[Path] = []
    try:
        try:
            make_folder(stated_path, made)
            for name in names:
                _check_not_in_the_way(stated_path / name, stated_path)
                _check_replaceable(stated_path / name)
            for folder in dict.fromkeys(
                [stated_path, *((stated_path / name).parent for name in names)]
            ):
                if folder.exists():
                    _try_to_write(folder)
        except OSError as error:
            raise _refused(stated_path, error, parameter) from None
        yield path
    finally:
        _remove_empty(made)


@contextmanager
def staged_folder(
    path: str | os.PathLike[str], names: Sequence[str] = (), parameter: str = "output folder"
) -> Iterator[Path]:
    """Collect files in a hidden folder and move them into place only when the block ends without an exception.

    **Guarantee.** If that fails, the folder is as it was. A reader never finds the first of ``names`` beside files of
    another set: it leaves first and comes last.

    Parameters
    ----------
    path : path
        The folder.
    names : sequence of str
        Files, relative to the folder, that belong to a set: those of an earlier set do not stay, even if no new one
        comes in their place.
    parameter : str
        What the caller knows the folder as.

    Yields
    ------
    pathlib.Path
        The folder to write into. Files already in ``path`` are replaced when their names agree, others stay.

    Raises
    ------
    OutputError
        If the folder cannot be made or written.
    """
    with output_folder(path, names, parameter) as folder:
        try:
            staging = Path(tempfile.mkdtemp(prefix=_own_prefix(), dir=folder))
            try:
                yield staging
                _Exchange(staging, folder).run(names)
            finally:
                shutil.rmtree(staging, ignore_errors=True)
            _remove_leftovers({folder, *((folder / name).parent for name in names)})
        except OSError as error:
            raise _refused(Path(path), error, parameter) from None


def absolute(path: str | os.PathLike[str]) -> Path:
    """Return a path that does not depend on the current folder; the path itself if that is deleted."""
    try:
        return Path(path).absolute()
    except OSError:
        return Path(path)


def path_text(path: Path) -> str:
    """Return a path as the user may type it: relative to the current folder, if the path is inside."""
    try:
        here = Path.cwd()
    except OSError:
        return str(path)
    return os.path.relpath(path, here) if path.is_relative_to(here) else str(path)


def name_text(path: str | os.PathLike[str]) -> str:
    """Return a name of a file as text that can be written; names need not be Unicode."""
    return os.fsencode(path).decode("utf-8", "backslashreplace")


def plan_file(path: str | os.PathLike[str]) -> Path:
    """Return the file of a plan: the path itself, or ``plan.json`` in it if it is a folder.

    Parameters
    ----------
    path : path
        The file, or the folder that `plan --out` writes.

    Raises
    ------
    PlanFileError
        If it is no path.
    """
    if not isinstance(path, str | os.PathLike):
        got = f"an object of type {type(path).__name__}"
        raise PlanFileError.of_rule("path", "must be a path", got)
    path = Path(path)
    return path / "plan.json" if path.is_dir() else path


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file, or nothing if it cannot be read."""
    digest = hashlib.sha256()
    try:
        with open(path, "rb") as stream:
            while block := stream.read(1 << 20):
                digest.update(block)
    except OSError:
        return ""
    return digest.hexdigest()


class _Exchange:
    """Moves the files of a staging folder into a folder, all of them or none.

    Every step that others can see is a renaming within one folder: it needs no space, and can be undone.
    """

    def __init__(self, staging: Path, target: Path):
        self.staging = staging
        self.target = target
        self.moved: list[tuple[Path, Path]] = []
        self.made: list[Path] = []

    def run(self, names: Sequence[str]) -> None:
        """Put all new files in place of the old ones, ``names[0]`` last; old ones of these names do not stay."""
        new = [
            path.relative_to(self.staging)
            for path in sorted(self.staging.rglob("*"))
            if not path.is_dir()
        ]
        first = Path(names[0]) if names else None
        new.sort(key=lambda name: name == first)
        old = dict.fromkeys([*map(Path, names), *new])
        hidden: list[Path] = []
        try:
            for name in new:
                hidden.append(self._beside(name, "new"))
                self._bring(name, hidden[-1])
            for name in old:
                if os.path.lexists(self.target / name):
                    self._rename(self.target / name, self._beside(name, "old"))
            for name, path in zip(new, hidden, strict=True):
                self._rename(path, self.target / name)
        except BaseException:
            # an interruption, too, must leave the old files
            self._undo()
            for path in hidden:
                path.unlink(missing_ok=True)
            _remove_empty(self.made)
            raise
        for name in old:
            with suppress(OSError):
                self._beside(name, "old").unlink(missing_ok=True)

    def _beside(self, name: Path, kind: str) -> Path:
        place = self.target / name
        return place.parent / f"{self.staging.name}-{kind}-{place.name}"

    def _bring(self, name: Path, hidden: Path) -> None:
        """Move a file beside its place, where another file system may be mounted."""
        _check_not_in_the_way(self.target / name, self.target)
        make_folder(hidden.parent, self.made)
        source = self.staging / name
        with open(source, "rb") as stream:
            os.fsync(stream.fileno())
        try:
            os.replace(source, hidden)
        except OSError as error:
            if error.errno != errno.EXDEV:
                raise
            shutil.copy(source, hidden)

    def _rename(self, source: Path, place: Path) -> None:
        # noted first: an interruption may come right after the renaming
        self.moved.append((source, place))
        os.replace(source, place)

    def _undo(self) -> None:
        for source, place in reversed(self.moved):
            if not os.path.lexists(source):
                with suppress(OSError):
                    os.replace(place, source)


def make_folder(path: Path, made: list[Path]) -> None:
    """Make a folder and those above it; list what was made, from the top down."""
    nearest = next(p for p in (path, *path.parents) if os.path.lexists(p))
    _check_is_folder(nearest)
    for folder in reversed([path, *path.parents][: len(path.parts) - len(nearest.parts)]):
        folder.mkdir(exist_ok=True)
        made.append(absolute(folder))


def _check_is_folder(path: Path) -> None:
    """Refuse what is there and no folder."""
    try:
        if stat.S_ISDIR(os.stat(path).st_mode):
            return
        kind = "a file"
    except FileNotFoundError:
        kind = "a link that leads nowhere"
    except OSError as error:
        if error.errno != errno.ELOOP:
            raise
        kind = "a link that leads back to itself"
    raise NotADirectoryError(errno.ENOTDIR, f"{path} is {kind}")


def _try_to_write(folder: Path) -> None:
    try:
        with tempfile.NamedTemporaryFile(prefix=_own_prefix(), dir=folder) as stream:
            stream.write(b"some text")
            stream.flush()
            os.fsync(stream.fileno())
    except OSError as error:
        # which folder it is, and not which hidden file
        error.filename = str(folder)
        raise


def _check_not_in_the_way(place: Path, folder: Path) -> None:
    if place.is_dir():
        raise IsADirectoryError(errno.EISDIR, f"{place} is a folder")
    if os.path.lexists(place.parent):
        _check_is_folder(place.parent)
    # a link in a file's place is replaced; through one in a folder's place, files elsewhere would be
    for between in place.parents:
        if between == folder:
            break
        if between.is_symlink():
            raise NotADirectoryError(errno.ENOTDIR, f"{between} is a link to another folder")


def _remove_empty(folders: Sequence[Path]) -> None:
    for folder in reversed(folders):
        with suppress(OSError):
            folder.rmdir()


def _own_prefix() -> str:
    """Return how names of hidden files of this process begin."""
    return f"{_HIDDEN}{_this_host()}-{os.getpid()}-"


def _this_host() -> str:
    return hashlib.sha256(socket.gethostname().encode()).hexdigest()[:8]


def is_running(pid: int) -> bool:
    """Tell whether a process of this machine runs, or may run."""
    if os.name != "posix":
        # elsewhere a signal cannot be sent to find out
        return True
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True


def _is_abandoned(path: Path) -> bool:
    """Tell whether a hidden file is of a process that was killed, and not of one that writes now."""
    owner = _OWNED.match(path.name)
    if owner is not None and owner[1] == _this_host() and not is_running(int(owner[2])):
        return True
    try:
        return time.time() - path.lstat().st_mtime > _FORGOTTEN_S
    except OSError:
        return False


def _remove_leftovers(folders: Iterable[Path]) -> None:
    """Remove what a process left that was killed while it wrote; of one that still runs nothing."""
    for folder in folders:
        for path in filter(_is_abandoned, folder.glob(f"{_HIDDEN}*")):
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path, ignore_errors=True)
            else:
                with suppress(OSError):
                    path.unlink()


def _refused(path: Path, error: OSError, parameter: str) -> OutputError:
    # an error of ours says where, which is a hidden file here; the one behind it says why
    while error.strerror is None and isinstance(error.__context__, OSError):
        error = error.__context__
    rule = (
        "a folder"
        if isinstance(error, NotADirectoryError | FileExistsError)
        else "a folder that can be written"
    )
    reason = error.strerror or error
    if isinstance(error.filename, str) and not Path(error.filename).name.startswith(_HIDDEN):
        inside = absolute(error.filename)
        folder = absolute(path)
        # which file it is that cannot be replaced
        reason = f"{reason} ({inside.relative_to(folder)})" if folder in inside.parents else reason
    return OutputError.of_rule(parameter, f"must be {rule}", f"{path}: {reason}")


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


# Reading JSON strictly: whatever the bytes are, the outcome is plain values or one clear line.
#
# Beyond what Python's reader refuses, a key may not come twice, the nesting must be shallow, and
# every text must be writable as UTF-8. NaN and numbers too large for a float pass as such: the
# schema refuses them and can say where.


# files of this package are nested seven deep at most
_DEEPEST = 40


def read_json(path: str | os.PathLike[str], what: str) -> Any:
    """Return what a JSON file holds.

    Parameters
    ----------
    path : path
    what : str
        What the file is called in messages, such as "plan file".

    Raises
    ------
    PlanFileError
        If the file cannot be read or is not JSON in UTF-8; the message names the file and, for malformed JSON, line and
        column.
    """
    from aspectgraph.files import read_text

    path = Path(path)
    try:
        text = read_text(path, large=True)
        data = json.loads(text, object_pairs_hook=_different_keys)
        _check_depth_and_text(data)
        return data
    except OSError as error:
        raise PlanFileError(f"{path}: {what} must be readable. Got: {error.strerror}.") from None
    except UnicodeDecodeError:
        raise PlanFileError(f"{path}: {what} must be UTF-8 text. Got other bytes.") from None
    except json.JSONDecodeError as error:
        received = f": {error.msg}" if text.strip() else " an empty file"
        raise PlanFileError(
            f"{path}:{error.lineno}:{error.colno}: {what} must be JSON. Got{received}."
        ) from None
    except RecursionError:
        raise PlanFileError(
            f"{path}: {what} must be nested at most {_DEEPEST} deep. Got more."
        ) from None
    except _Refused as error:
        raise PlanFileError(f"{path}: {what} {error}") from None
    except ValueError:
        # Python reads no integer of more than some thousand digits
        raise PlanFileError(
            f"{path}: {what} must hold numbers of a sensible length. Got a longer one."
        ) from None


def encoded(value: object) -> Any:
    """Replace numbers JSON has no notation for, such as the margin of a constraint that was not set."""
    if isinstance(value, Mapping):
        return {key: encoded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [encoded(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return {"not finite": str(value)}
    return value


def print_json(record: Any) -> None:
    """Print plain values as JSON; numbers that are not finite as in plan files."""
    text = json.dumps(encoded(record), indent=1, allow_nan=False)
    # the one control character that JSON writes as it is
    print(text.replace("\x7f", "\\u007f"))


class _Refused(Exception):
    """What is wrong with values that are JSON."""


def _different_keys(pairs: list[tuple[str, object]]) -> dict[str, Any]:
    data = dict(pairs)
    if len(data) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise _Refused(f"must hold every key of an object once. Got {ascii(twice)[:60]} twice.")
    return data


def _check_depth_and_text(data: Any) -> None:
    """Walk through all values without recursion, so that depth cannot hurt."""
    level = [data]
    depth = 0
    while level:
        depth += 1
        if depth > _DEEPEST:
            raise _Refused(f"must be nested at most {_DEEPEST} deep. Got more.")
        below = []
        for value in level:
            if isinstance(value, dict):
                below += [*value, *value.values()]
            elif isinstance(value, list):
                below += value
            elif isinstance(value, str) and not value.isascii():
                _check_text(value)
        level = below


def _check_text(text: str) -> None:
    try:
        text.encode()
    except UnicodeEncodeError:
        raise _Refused(
            f"must hold text of whole characters. Got half of one in {ascii(text)[:60]}."
        ) from None


# The program: a digest of the code that decides about plans, and its version.


_PACKAGES = ("aspectgraph", "errors", "ga", "planner")
# these show plans, and decide about none
_SHOW_ONLY = (
    "aspectgraph.plot",
    "planner.app",
    "planner.optics",
    "planner.report",
)


def program_digest() -> str:
    """Return a digest of all source files that a plan depends on, 64 hexadecimal digits."""
    from aspectgraph.files import code_digest

    return code_digest(_PACKAGES, _SHOW_ONLY)
