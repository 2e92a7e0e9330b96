"""`read_solid`: one call for every part file."""

from __future__ import annotations

import gzip
import tempfile
import zlib
from collections.abc import Sequence
from pathlib import Path

from aspectgraph.exceptions import PartFileNotFoundError, ReadError
from aspectgraph.mesh import read_mesh
from aspectgraph.solid import Solid
from aspectgraph.step import read_step

STEP_SUFFIXES = (".step", ".stp")
MESH_SUFFIXES = (".stl", ".obj", ".ply", ".off", ".glb")


def read_solid(
    path: str | Path,
    *,
    units: str | None = None,
    chord_tolerance_mm: float | None = None,
    angular_tolerance_deg: float | None = None,
    planarity_mm: float | None = None,
    solids: Sequence[int] | None = None,
) -> Solid:
    """Read a part file as a validated solid in millimetres.

    Parameters
    ----------
    path : str or Path
        A .step, .stp, .stl, .obj, .ply, .off or .glb file; any of them may be compressed as .gz.
    units : {"mm", "cm", "m", "um", "inch", "ft"}, optional
        Unit of a mesh file's coordinates: default "mm", and "m" for .glb, whose standard says so. STEP files carry
        their own unit.
    chord_tolerance_mm, angular_tolerance_deg : float, optional
        How closely curved faces of STEP files are followed; see `read_step`. Default: a thousandth of the bounding box
        diagonal, and 30 degrees.
    planarity_mm : float, optional
        Triangles this close to one plane become one face; see `assemble`.
    solids : sequence of int, optional
        Which solids of a STEP file to read, counted from 0. Default: all.

    Returns
    -------
    Solid
        Its ``notes`` say what was chosen or repaired.

    Raises
    ------
    PartFileNotFoundError
        There is no such file.
    ReadError
        The file is not what its name says, is damaged, or a parameter does not apply to it.
    SolidError
        The surface is open, not manifold, intersects itself, or solids touch.
    """
    path = Path(path)
    if not path.is_file():
        raise PartFileNotFoundError(f"path must name an existing part file. Got {str(path)!r}.")
    packed = path.suffix.lower() == ".gz"
    plain_name = path.stem if packed else path.name
    suffix = Path(plain_name).suffix.lower()
    name = Path(plain_name).stem
    _check_tolerances(chord_tolerance_mm, angular_tolerance_deg, planarity_mm)
    if suffix in STEP_SUFFIXES:
        return _read_step(path, packed, units, chord_tolerance_mm, angular_tolerance_deg, planarity_mm, solids, name)
    if suffix in MESH_SUFFIXES:
        if solids is not None:
            raise ReadError(f"solids applies to STEP files. Got solids={list(solids)} for {path.name}.")
        return read_mesh(_content(path, packed), suffix, units=units, planarity_mm=planarity_mm, name=name)
    known = ", ".join((*STEP_SUFFIXES, *MESH_SUFFIXES))
    raise ReadError(f"a part file must end in one of {known} (or one of these and .gz). Got {path.name!r}.")


def _check_tolerances(chord_tolerance_mm, angular_tolerance_deg, planarity_mm) -> None:
    for value, label in ((chord_tolerance_mm, "chord_tolerance_mm"), (planarity_mm, "planarity_mm")):
        if value is not None and not 0 < value < float("inf"):
            raise ReadError(f"{label} must be positive and finite. Got {value}.")
    if angular_tolerance_deg is not None and not 0 < angular_tolerance_deg <= 90:
        raise ReadError(f"angular_tolerance_deg must be in (0, 90]. Got {angular_tolerance_deg}.")


def _read_step(path, packed, units, chord_tolerance_mm, angular_tolerance_deg, planarity_mm, solids, name) -> Solid:
    if units is not None:
        raise ReadError(
            f"units applies to mesh files; a STEP file states its own. Got units={units!r} for {path.name}."
        )
    options = {
        "chord_tolerance_mm": chord_tolerance_mm,
        "angular_tolerance_deg": 30.0 if angular_tolerance_deg is None else angular_tolerance_deg,
        "planarity_mm": planarity_mm,
        "solids": solids,
        "name": name,
    }
    content = _content(path, packed)
    if not content.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"ISO-10303-21"):
        raise ReadError(f"a STEP file must begin with ISO-10303-21. Got {path.name} without it.")
    if not packed:
        return read_step(path, **options)
    with tempfile.TemporaryDirectory() as folder:
        unpacked = Path(folder) / "part.step"
        unpacked.write_bytes(content)
        return read_step(unpacked, **options)


def _content(path: Path, packed: bool) -> bytes:
    """Return the bytes of a file, unpacked."""
    data = path.read_bytes()
    if packed:
        try:
            data = gzip.decompress(data)
        except (OSError, EOFError, zlib.error) as error:
            raise ReadError(f"a .gz file must be a whole gzip file. Got {path.name}: {error}.") from error
    if not data.strip():
        raise ReadError(f"a part file must not be empty. Got {path.name} with {len(data)} bytes.")
    return data
