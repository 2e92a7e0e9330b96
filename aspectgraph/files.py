"""Files that are written whole or not at all, read up to limits, and digested."""

from __future__ import annotations

import errno
import hashlib
import io
import math
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from numbers import Integral
from pathlib import Path
from typing import IO, Any

from aspectgraph.exceptions import OutputError, ReadError
from ground.short_repr import short_repr

# Files that are written whole or not at all, read up to a limit, and digested.


# Files: written so that a reader never meets half of one, and read only up to a size.


SMALL_FILE_BYTES = 64_000_000
"""Most of a file that people write: names, dimensions, cameras, lamps. These have kilobytes."""
LARGE_FILE_BYTES = 1_000_000_000
"""Most of a file that the package writes: plans, states, graphs. Those of large parts have some ten megabytes."""

DEEPEST = 40
"""Most levels of tables and arrays in a file that people write. These have three."""
# a double has 1024 at most
_MOST_BITS = 1000


def read_text(
    path: str | os.PathLike[str],
    encoding: str = "utf-8",
    *,
    large: bool = False,
    newline: str | None = None,
) -> str:
    """Read a text file of a sensible size; no more of it is ever held.

    Parameters
    ----------
    path : str or os.PathLike
        The file.
    encoding : str, optional
    large : bool, optional
        Allow `LARGE_FILE_BYTES` instead of `SMALL_FILE_BYTES`.
    newline : str, optional
        As `open` takes it: with "", line ends stay as they are in the file.

    Raises
    ------
    OSError
        The file cannot be read, or is larger; `strerror` says so.
    UnicodeDecodeError
        It holds other bytes.
    """
    try:
        os.fsencode(path)
    except UnicodeEncodeError as error:
        raise OSError(errno.EINVAL, "half a character is no name of a file") from error
    with open(path, "rb") as file:
        return io.TextIOWrapper(
            io.BytesIO(up_to_limit(file, large=large)), encoding=encoding, newline=newline
        ).read()


def up_to_limit(file: IO[bytes], *, large: bool) -> bytes:
    """Return what an open file holds, or raise the `OSError` of :func:`read_text` if that is too much."""
    limit = LARGE_FILE_BYTES if large else SMALL_FILE_BYTES
    data = file.read(limit + 1)
    if len(data) > limit:
        raise OSError(errno.EFBIG, f"it has more than {limit / 1e6:g} MB")
    return data


def check_plain(value: object) -> None:
    """Refuse what no file of names or numbers needs, and what code that walks or prints values would fail at.

    Parameters
    ----------
    value : object
        What a TOML or JSON file holds. The walk does not recurse.

    Raises
    ------
    ValueError
        Tables or arrays are nested deeper than `DEEPEST`, or a whole number exceeds every floating-point number; the
        message is the reason alone.
    """
    level = [value]
    for _ in range(DEEPEST):
        below: list[object] = []
        for item in level:
            if isinstance(item, dict):
                below += item.values()
            elif isinstance(item, list):
                below += item
            elif isinstance(item, int) and item.bit_length() > _MOST_BITS:
                raise ValueError("it holds a number of too many digits")
        if not below:
            return
        level = below
    raise ValueError("it is nested too deep")


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Provide a path to write to; what is there moves to `path` when the block ends without an exception.

    What is no file, such as ``/dev/stdout``, is written to and stays what it is. Of a symbolic link, the link is
    replaced; the file it leads to stays as it is.

    Raises
    ------
    OutputError
        The folder does not exist, or the file cannot be written.
    """
    path = Path(path)
    written_to = is_device(path)
    try:
        check_replaceable(path)
        with tempfile.TemporaryDirectory() if written_to else nullcontext(path.parent) as folder:
            beside = Path(folder) / f".{path.name}.{os.getpid()}.part"
            try:
                yield beside
                if written_to:
                    pour(beside, path)
                else:
                    os.replace(beside, path)
            finally:
                with suppress(OSError):
                    beside.unlink()
    except OSError as error:
        reason = error.strerror or error
        raise OutputError.of_rule(
            "path", "must be a file that can be written", f"{str(path)!r}: {reason}"
        ) from error


def is_device(path: str | os.PathLike[str]) -> bool:
    """Tell whether a path is there, but neither a file nor a folder: a device or a pipe, which no file may replace."""
    try:
        kind = os.stat(path).st_mode
    except (OSError, ValueError):
        return False
    return not (stat.S_ISREG(kind) or stat.S_ISDIR(kind))


def check_replaceable(path: str | os.PathLike[str]) -> None:
    """Refuse a file that is there and may not be replaced; a renaming would not ask, or fail after the work.

    Raises
    ------
    OSError
        Nobody may write it, as it is marked read-only, or as it is on a read-only mount or immutable.
    """
    # of a link what it is, and not what it leads to, is replaced
    if os.path.islink(path) or not os.path.isfile(path):
        return
    if not os.stat(path).st_mode & (stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH):
        raise PermissionError(errno.EACCES, "it is marked read-only", str(path))
    try:
        # nothing is written, and no time changes
        os.close(os.open(path, os.O_WRONLY))
    except OSError as error:
        # who owns a folder may replace what others own in it
        if error.errno in (errno.EROFS, errno.EPERM):
            raise


def pour(source: str | os.PathLike[str], device: str | os.PathLike[str]) -> None:
    """Write what is in a file to a device or a pipe."""
    with open(source, "rb") as ours, open(device, "wb") as theirs:
        shutil.copyfileobj(ours, theirs)


# A digest of source files: what was computed by other code is told from what this code computes.


@cache
def code_digest(packages: Sequence[str], without: Sequence[str] = ()) -> str:
    """Return a digest of the Python files of packages.

    Parameters
    ----------
    packages : tuple of str
        Names of packages.
    without : tuple of str
        Names of packages or modules in them that decide about no result.

    Returns
    -------
    str
        64 hexadecimal digits. Where the files cannot be read, that of the program's version.
    """
    digest = hashlib.sha256()
    left_out = [name.replace(".", "/") for name in without]
    read = 0
    for package in packages:
        spec = find_spec(package)
        for folder in () if spec is None else map(Path, spec.submodule_search_locations or ()):
            for path in sorted(folder.rglob("*.py")):
                name = f"{package}/{path.relative_to(folder).as_posix()}"
                if any(f"{name[:-3]}/".startswith(f"{place}/") for place in left_out):
                    continue
                digest.update(f"{name}\0".encode())
                digest.update(hashlib.sha256(path.read_bytes()).digest())
                read += 1
    if read == 0:
        digest.update(_version().encode())
    return digest.hexdigest()


def _version() -> str:
    try:
        return version("aspectgraph")
    except PackageNotFoundError:
        return "unknown"


# What reading a part file may cost: a file from anywhere must not take the machine.


@dataclass(frozen=True)
class ReadLimits:
    """Limits of time, memory and size for reading one part file.

    The defaults are far above the needs of real parts. The largest NIST test part (2 MB, 635 faces)
    takes 3 s and 80 MB in the STEP kernel. An STL file of a million facets has 50 MB.

    Attributes
    ----------
    time_s : float
        Largest wall-clock time of the STEP kernel, in seconds.
    memory_mb : float
        Largest memory of the STEP kernel for the file, in MB (10⁶ bytes). If the operating system
        cannot limit it, only the time limit applies.
    file_mb : float
        Largest size of the uncompressed file, in MB.
    triangles : int
        Largest number of triangles of a mesh file, counting each use of a shared mesh.

    Raises
    ------
    ReadError
        A limit is not positive.

    Examples
    --------
    >>> from aspectgraph import ReadLimits, read_solid
    >>> part = read_solid("examples/mfcad_6-11-11-19.step", limits=ReadLimits(time_s=60.0))
    >>> part.name
    'mfcad_6-11-11-19'
    """

    time_s: float = 300.0
    memory_mb: float = 2000.0
    file_mb: float = 256.0
    triangles: int = 5_000_000

    def __post_init__(self) -> None:
        for name in ("time_s", "memory_mb", "file_mb", "triangles"):
            value = getattr(self, name)
            if not 0 < value < math.inf:
                raise ReadError(f"{name} of the limits must be positive and finite. Got {value}.")


def more_of(limit: str) -> dict[str, Any]:
    """Return the hint of an error to raise a limit, with the argument it mentions."""
    argument = f"limits=ReadLimits({limit}=...)"
    return {"hint": f"allow more with {argument}", "mentions": (argument,)}


# The solids of a STEP file, what they are called, and which of them are meant.


@dataclass(frozen=True)
class SolidEntry:
    """A solid in the list of a STEP file.

    Attributes
    ----------
    number : int
        Its number, counted from 0 in the order of the file.
    product : str
        Name of the product that it shapes; its identifier if it has no name.
    instance : str
        Names of the instances in the assembly that lead to it, joined by "/". Empty without names.
    body : str
        Name of the solid itself.
    n_faces : int
        Number of its faces; facets if the file states only these.
    n_placed : int
        How many times the same solid occurs in the file.
    size_mm : tuple of float or None
        Size of its box, in mm. None for a solid that cannot be built.
    label : str
        A text that names this solid alone, such as ``bracket`` or ``bracket:2``. Its number if it
        has no name.

    Examples
    --------
    >>> from aspectgraph import SolidEntry
    >>> SolidEntry(3, product="bracket", instance="frame-1/bracket-2", body="Solid1").names
    ('bracket', 'frame-1/bracket-2', 'bracket-2', 'Solid1')
    """

    number: int
    product: str = ""
    instance: str = ""
    body: str = ""
    n_faces: int = 0
    n_placed: int = 1
    size_mm: tuple[float, float, float] | None = None
    label: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        """All texts that may stand for it: product, instance with and without the way to it, solid."""
        last = self.instance.rpartition("/")[2]
        return tuple(filter(None, (self.product, self.instance, last, self.body)))


def with_labels(entries: Sequence[SolidEntry]) -> tuple[SolidEntry, ...]:
    """Return entries with the label of each."""
    holders: dict[str, list[int]] = {}
    for entry in entries:
        for name in dict.fromkeys(entry.names):
            holders.setdefault(name, []).append(entry.number)
    labelled = []
    for entry in entries:
        names = [name for name in (entry.product, entry.body) if name]
        label = next((name for name in names if len(holders[name]) == 1), "")
        if names and not label:
            label = f"{names[0]}:{holders[names[0]].index(entry.number) + 1}"
            # another solid may have that very name
            if label in holders:
                label = ""
        labelled.append(replace(entry, label=label or str(entry.number)))
    return tuple(labelled)


_MOST_LISTED = 8
_OF_SEVERAL = re.compile(r"(.+):(\d{1,9}|all)", re.DOTALL)


def list_text(entries: Sequence[SolidEntry]) -> str:
    """Return solids for an error: number, name, size and faces of the first ones."""
    texts = []
    for entry in entries[:_MOST_LISTED]:
        name = ""
        if entry.label != str(entry.number):
            name = f" {entry.label!r}"
        size = ""
        if entry.size_mm is not None:
            size = f"{' x '.join(f'{length:.4g}' for length in entry.size_mm)} mm, "
        noun = ("faces", "face")[entry.n_faces == 1]
        texts.append(f"{entry.number}{name} ({size}{entry.n_faces} {noun})")
    more = len(entries) - len(texts)
    return ", ".join(texts) + (f", and {more} more" if more else "")


def numbers_of(parameter: str, name: str, entries: Sequence[SolidEntry]) -> list[int]:
    """Return the numbers of the solids that a name stands for.

    Parameters
    ----------
    parameter : str
        For errors.
    name : str
        A name that stands for one solid, of a product, an instance or the solid itself; or such a name
        of several solids with ``:1``, ``:2`` and so on for one of them in the order of the file, or with ``:all``.
    entries : sequence of SolidEntry
        The solids of the file.

    Raises
    ------
    ReadError
        There is no such solid, or the name stands for several.
    """
    named = [entry.number for entry in entries if name in entry.names]
    if len(named) == 1:
        return named
    if named:
        labels = [_label_among(name, k, entries[number]) for k, number in enumerate(named, start=1)]
        shown = ", ".join(labels[:_MOST_LISTED])
        more = ""
        if len(labels) > _MOST_LISTED:
            more = f" and {len(labels) - _MOST_LISTED} more"
        raise ReadError.of_rule(
            parameter,
            "must name each solid by a name of its own, or by its number",
            f"{name!r}, which stands for {len(named)} solids",
            hint=f"write one of {shown}{more}, or {name}:all",
        )
    match = _OF_SEVERAL.fullmatch(name)
    several = [] if match is None else [e.number for e in entries if match[1] in e.names]
    if match is not None and several:
        if match[2] == "all":
            return several
        if 1 <= int(match[2]) <= len(several):
            return [several[int(match[2]) - 1]]
    # those that are similar first
    part = name.lower()
    nearest = sorted(entries, key=lambda entry: part not in "\n".join(entry.names).lower())
    raise ReadError.of_rule(
        parameter,
        "must name solids of the file, or give their numbers",
        repr(name),
        hint=f"the file holds {list_text(nearest)}",
    )


_OF_SOLIDS = "must be numbers or names of solids"


def _label_among(name: str, k: int, entry: SolidEntry) -> str:
    return f"{name}:{k} ({entry.number})"


@dataclass(frozen=True)
class SolidChoice:
    """A choice of solids of a STEP file: those to measure, and those that occlude them.

    Attributes
    ----------
    measured : int, str, or sequence of them, optional
        Solids whose edges can be entities, by their numbers, counted from 0 in the order of the
        file, or by their names: of a product, an instance or the solid. ``bracket:2`` is the second one
        of several with this name, ``bracket:all`` are all of them. Default: all that are not
        occluders.
    occluders : "all" or sequence of int or str
        Solids that only occlude. Their edges are not entities. ``"all"``: all except the measured
        ones.

    Raises
    ------
    ReadError
        A solid is both, or no solid remains, or one is neither a number nor a name.

    Examples
    --------
    >>> from aspectgraph import SolidChoice
    >>> SolidChoice(measured=(1, "bracket"), occluders="all")
    SolidChoice(measured=(1, 'bracket'), occluders='all')
    """

    measured: Sequence[int | str] | None = None
    occluders: str | Sequence[int | str] = ()

    __repr__ = short_repr

    def __post_init__(self) -> None:
        if self.measured is not None:
            object.__setattr__(self, "measured", listed_solids("solids", self.measured))
        if isinstance(self.occluders, str) and self.occluders != "all":
            raise ReadError.of_rule(
                "occluders", "must be 'all', or a list of numbers or names", repr(self.occluders)
            )
        if self.occluders != "all":
            object.__setattr__(self, "occluders", listed_solids("occluders", self.occluders))
        elif self.measured is None:
            raise ReadError.of_rule(
                "occluders",
                "must be numbers or names where solids does not say which are measured",
                "'all'",
                mentions=("solids",),
            )
        others: Sequence[int | str] = () if self.occluders == "all" else self.occluders
        both = [solid for solid in self.measured or () if solid in others]
        if both:
            raise ReadError(
                f"a solid must be measured or an occluder. Got solid {both[0]!r} as both."
            )

    @property
    def has_names(self) -> bool:
        """Whether it names solids by anything but their numbers."""
        occluders = () if self.occluders == "all" else self.occluders
        return any(isinstance(solid, str) for solid in (*(self.measured or ()), *occluders))

    def numbered(self, entries: Sequence[SolidEntry]) -> SolidChoice:
        """Return the choice with numbers instead of names.

        Parameters
        ----------
        entries : sequence of SolidEntry
            The solids of the file.

        Returns
        -------
        SolidChoice
            Of numbers only.

        Raises
        ------
        ReadError
            There is no solid of a name, or there are several.
        """
        occluders: Any = self.occluders
        if occluders != "all":
            occluders = _in_numbers("occluders", self.occluders, entries)
        if self.measured is None:
            return SolidChoice(None, occluders)
        return SolidChoice(_in_numbers("solids", self.measured, entries), occluders)

    def split(self, n: int) -> tuple[list[int], list[int]]:
        """Return the measured solids and the occluders of a file, without checking numbers.

        Parameters
        ----------
        n : int
            Number of solids in the file.

        Returns
        -------
        measured : list of int
            In the order given.
        occluders : list of int
            Likewise.
        """
        if self.occluders == "all":
            measured = [int(i) for i in self.measured or ()]
            return measured, [i for i in range(n) if i not in measured]
        occluders = [int(i) for i in self.occluders]
        if self.measured is None:
            return [i for i in range(n) if i not in occluders], occluders
        return [int(i) for i in self.measured], occluders


def _in_numbers(
    parameter: str, solids: Sequence[int | str], entries: Sequence[SolidEntry]
) -> list[int | str]:
    numbers: list[int | str] = []
    for solid in solids:
        numbers += numbers_of(parameter, solid, entries) if isinstance(solid, str) else [solid]
    return numbers


def listed_solids(parameter: str, solids: Any) -> tuple[int | str, ...]:
    """Return solids as numbers and names; a single one stands for itself, and text is one name.

    Parameters
    ----------
    parameter : str
        What the caller knows them as.
    solids : int, str, or iterable of these
        The solids.

    Raises
    ------
    ReadError
        One is neither a number nor a name.
    """
    if isinstance(solids, Mapping):
        raise ReadError.of_rule(parameter, _OF_SOLIDS, repr(solids))
    single = isinstance(solids, str | bytes) or not isinstance(solids, Iterable)
    checked: list[int | str] = []
    for solid in (solids,) if single else solids:
        is_number = isinstance(solid, Integral) and not isinstance(solid, bool)
        if not is_number and not isinstance(solid, str):
            raise ReadError.of_rule(parameter, _OF_SOLIDS, repr(solid))
        checked.append(int(solid) if is_number else solid)
    return tuple(checked)


def as_choice(solids: int | str | Sequence[int | str] | SolidChoice | None) -> SolidChoice:
    """Return a choice as a `SolidChoice`."""
    if isinstance(solids, SolidChoice):
        return solids
    return SolidChoice(None if solids is None else listed_solids("solids", solids))
