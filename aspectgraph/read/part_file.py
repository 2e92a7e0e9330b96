"""`read_solid`: one call for every part file."""

from __future__ import annotations

import gzip
import os
import tempfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from numbers import Real
from pathlib import Path
from typing import Any

from aspectgraph.exceptions import PartFileNotFoundError, ReadError
from aspectgraph.files import ReadLimits, SolidChoice, SolidEntry, as_choice, more_of
from aspectgraph.read.mesh import read_mesh
from aspectgraph.read.step.step_file import list_step, read_step
from aspectgraph.solid.solid import Solid, kind_text

STEP_SUFFIXES = (".step", ".stp")
MESH_SUFFIXES = (".stl", ".obj", ".ply", ".off", ".glb")


def read_solid(
    path: str | os.PathLike[str],
    *,
    units: str | None = None,
    chord_tolerance_mm: float | None = None,
    angular_tolerance_deg: float | None = None,
    planarity_mm: float | None = None,
    gap_mm: float | None = None,
    solids: int | str | Sequence[int | str] | SolidChoice | None = None,
    limits: ReadLimits | None = None,
) -> Solid:
    """Read a part file as a validated solid in millimetres.

    Parameters
    ----------
    path : str or os.PathLike
        A .step, .stp, .stl, .obj, .ply, .off or .glb file. Each may be compressed as .gz.
    units : {"mm", "cm", "m", "um", "inch", "ft"}, optional
        Unit of a mesh file's coordinates. Default: "mm", and "m" for .glb by its standard. STEP
        files state their own unit.
    chord_tolerance_mm, angular_tolerance_deg : float, optional
        Largest deviation of facets from the curved faces of STEP files; see `read_step`. Default: a
        thousandth of the bounding box diagonal, and 30 degrees.
    planarity_mm : float, optional
        Triangles this close to one plane become one face; see `assemble`.
    gap_mm : float, optional
        Largest gap between vertices, edges and faces of a STEP file that should meet. Default: the
        uncertainty that the file states, or a gap too small to change the shape; see `step_fit`.
    solids : int, str, sequence of them, or SolidChoice, optional
        Which solids of a STEP file to read: numbers, counted from 0 in the order of the file,
        including damaged ones, or names, see `list_solids`. One string is one name. A `SolidChoice`
        also names solids that only occlude others. Solids that touch become one solid. Default: all, and all must be
        intact.
    limits : ReadLimits, optional
        Limits of time, memory and size for the reading. Default: ``ReadLimits()``.

    Returns
    -------
    Solid
        The solid. Its ``notes`` list choices and repairs.

    Raises
    ------
    PartFileNotFoundError
        There is no such file.
    ReadError
        The content does not match the name, the file is damaged, or a parameter does not apply to
        it.
    SolidError
        The surface is open, not manifold, intersects itself, or solids touch.

    Examples
    --------
    >>> from aspectgraph import read_solid
    >>> solid = read_solid("examples/two_pocket_block.off")
    >>> solid
    <Solid 'two_pocket_block': 24 vertices, 36 edges, 16 faces>
    >>> len(solid.straight_edges(min_length_mm=20))
    28
    """
    if not isinstance(path, str | os.PathLike):
        got = f"an object of type {type(path).__name__}"
        raise ReadError.of_rule("path", "must be a path", got)
    path = Path(path)
    if not path.is_file():
        raise _no_file(path)
    limits = limits or ReadLimits()
    packed = path.suffix.lower() == ".gz"
    plain_name = path.stem if packed else path.name
    suffix = Path(plain_name).suffix.lower()
    # names of files need not be Unicode, but what is written with them must be
    name = os.fsencode(Path(plain_name).stem).decode("utf-8", "backslashreplace")
    _check_tolerances(chord_tolerance_mm, angular_tolerance_deg, planarity_mm, gap_mm)
    if suffix in STEP_SUFFIXES:
        _check_units(units, path)
        options = {
            "chord_tolerance_mm": chord_tolerance_mm,
            "angular_tolerance_deg": angular_tolerance_deg,
            "planarity_mm": planarity_mm,
            "gap_mm": gap_mm,
            "solids": solids,
        }
        return _read_step(
            path, _content(path, packed, limits), packed, options | {"name": name, "limits": limits}
        )
    if suffix in MESH_SUFFIXES:
        _check_no_step_options(as_choice(solids), gap_mm, path.name)
        content = _content(path, packed, limits)
        return read_mesh(
            content, suffix, units=units, planarity_mm=planarity_mm, name=name, limits=limits
        )
    endings = ", ".join((*STEP_SUFFIXES, *MESH_SUFFIXES))
    raise ReadError(
        f"a part file must end in one of {endings} (or one of these and .gz). Got {path.name!r}."
    )


def list_solids(
    path: str | os.PathLike[str], *, limits: ReadLimits | None = None
) -> tuple[SolidEntry, ...]:
    """List the solids of a STEP file with their names, without a mesh of any.

    Parameters
    ----------
    path : str or os.PathLike
        A .step or .stp file. It may be compressed as .gz.
    limits : ReadLimits, optional
        Limits of time, memory and size for the reading. Default: ``ReadLimits()``.

    Returns
    -------
    tuple of SolidEntry
        In the order of the file, damaged solids included. An instance of an assembly is a solid of
        its own.

    Raises
    ------
    PartFileNotFoundError
        There is no such file.
    ReadError
        The file is not a STEP file, or is damaged in more than single solids.

    Examples
    --------
    >>> from aspectgraph import list_solids
    >>> (solid,) = list_solids("examples/mfcad_6-11-11-19.step")
    >>> solid.number, solid.n_faces, solid.n_placed
    (0, 8, 1)
    """
    plain_path = Path(path)
    packed = plain_path.suffix.lower() == ".gz"
    suffix = Path(plain_path.stem if packed else plain_path.name).suffix.lower()
    if plain_path.is_file() and suffix not in STEP_SUFFIXES:
        raise ReadError.of_rule("path", "must name a STEP file to list solids", repr(str(path)))
    with plain_step_file(plain_path, limits or ReadLimits()) as plain:
        return list_step(plain, limits=limits)


def _check_no_step_options(choice: SolidChoice, gap_mm: float | None, name: str) -> None:
    """Refuse options of STEP files for a mesh."""
    values = {"solids": choice.measured, "occluders": choice.occluders or None, "gap_mm": gap_mm}
    for label, value in values.items():
        if value is not None:
            raise ReadError.of_rule(label, "applies to STEP files", f"{value} for {name}")


def _check_tolerances(
    chord_tolerance_mm: float | None,
    angular_tolerance_deg: float | None,
    planarity_mm: float | None,
    gap_mm: float | None,
) -> None:
    lengths = {
        "chord_tolerance_mm": chord_tolerance_mm,
        "planarity_mm": planarity_mm,
        "gap_mm": gap_mm,
    }
    for label, value in lengths.items():
        if value is not None and not (_is_number(value) and 0 < value < float("inf")):
            raise ReadError.of_rule(label, "must be positive and finite", _number_text(value))
    angle = angular_tolerance_deg
    if angle is not None and not (_is_number(angle) and 0 < angle <= 90):
        got = _number_text(angle)
        raise ReadError.of_rule("angular_tolerance_deg", "must be in (0, 90]", got)


def _is_number(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def _number_text(value: object) -> str:
    """Return a number as users write it, also one of numpy; what is none by its kind."""
    return str(value) if _is_number(value) else kind_text(value)


def _no_file(path: Path) -> PartFileNotFoundError:
    """Return the error of a path that names no file: it may name a folder."""
    got = f"the folder {str(path)!r}" if path.is_dir() else repr(str(path))
    return PartFileNotFoundError.of_rule("path", "must name an existing part file", got)


def _check_units(units: str | None, path: Path) -> None:
    if units is not None:
        raise ReadError.of_rule(
            "units",
            "applies to mesh files; a STEP file states its own",
            f"{units!r} for {path.name}",
        )


def _read_step(path: Path, content: bytes, packed: bool, options: dict[str, Any]) -> Solid:
    with _plain(path, content, packed) as plain:
        return read_step(plain, **options)


@contextmanager
def plain_step_file(path: Path, limits: ReadLimits) -> Iterator[Path]:
    """Provide a STEP file that is not compressed; for use in a ``with`` block.

    Parameters
    ----------
    path : Path
        A .step or .stp file; it may be compressed as .gz.
    limits : ReadLimits
        Of its size.

    Raises
    ------
    PartFileNotFoundError
        There is no such file.
    ReadError
        It cannot be read, is too large, or does not begin like a STEP file.
    """
    if not path.is_file():
        raise _no_file(path)
    packed = path.suffix.lower() == ".gz"
    with _plain(path, _content(path, packed, limits), packed) as plain:
        yield plain


@contextmanager
def _plain(path: Path, content: bytes, packed: bool) -> Iterator[Path]:
    if not content.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"ISO-10303-21"):
        raise ReadError(f"a STEP file must begin with ISO-10303-21. Got {path.name} without it.")
    if not packed:
        yield path
        return
    with tempfile.TemporaryDirectory() as folder:
        unpacked = Path(folder) / Path(path.stem).name
        unpacked.write_bytes(content)
        yield unpacked


def _content(path: Path, packed: bool, limits: ReadLimits) -> bytes:
    """Return the bytes of a file, unpacked; no more of them than the limit are ever held."""
    max_bytes = int(limits.file_mb * 1e6)
    try:
        with gzip.open(path) if packed else open(path, "rb") as file:
            data = file.read(max_bytes + 1)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise ReadError(
            f"a .gz file must be a whole gzip file. Got {path.name}: {error}."
        ) from error
    except OSError as error:
        raise ReadError.of_rule(
            "path", "must name a file that can be read", f"{path.name}: {error.strerror or error}"
        ) from error
    if len(data) > max_bytes:
        raise ReadError.of_rule(
            "",
            f"a part file must have at most file_mb={limits.file_mb:g} MB, unpacked",
            f"{path.name} with more",
            **more_of("file_mb"),
        )
    if not data.strip():
        raise ReadError(f"a part file must not be empty. Got {path.name} with {len(data)} bytes.")
    return data
