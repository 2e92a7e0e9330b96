"""The images of a plan: which files they are, and everything that is wrong with them before one is measured."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from errors.formatting import percent_text
from planner.camera.camera import Camera
from planner.exceptions import RequestError
from planner.measuring.scans import CLIPPED_SHARE, Scans, find_edges, noise_of, white_of
from planner.sensor_setting import setting_name

if TYPE_CHECKING:
    from planner.plan import InspectionPlan


# One image as it is measured: grey values, their noise, and the camera.


MOST_CLIPPED = 0.05
"""Share of an image that may be overexposed without a note."""
BRIGHT_SHARE = 0.995
"""An image is as bright as this share of its pixels at most."""
DARK_SHARE = 0.25
"""Share of white below which an image is dark."""
WELL_EXPOSED = 0.8
"""Share of white that the bright part of an image should have."""
MOST_BLUR_PX = 2.0
"""Blur across edges from which on an image has a note."""


@dataclass(frozen=True)
class Picture:
    """An image.

    Attributes
    ----------
    name : str
        Its name, such as "setting_01.png".
    grey : array (h, w)
        Grey values, float32.
    white : float
        Grey value of full exposure.
    noise : float
        Standard deviation of the noise, in grey values.
    camera : Camera
        The camera.
    """

    name: str
    grey: NDArray[np.float32]
    white: float
    noise: float
    camera: Camera

    @classmethod
    def of(cls, name: str, image: NDArray[np.generic], camera: Camera) -> Picture:
        """Return an image of 8 or 16 bits, or of floats in [0, 1]."""
        grey = np.ascontiguousarray(image, dtype=np.float32)
        return cls(name, grey, white_of(image), noise_of(grey), camera)

    def notes(
        self, blur_px: float, overexposed: Sequence[str] = (), share: float | None = None
    ) -> list[str]:
        """Return what is wrong with the exposure, and with the focus.

        Parameters
        ----------
        blur_px : float
            Blur across edges.
        overexposed : sequence of str
            Targets that are not measured, because light beside their edges is.
        share : float, optional
            For what share of the time to expose, if the image is overexposed and that is known.
        """
        found = []
        bright = float(np.quantile(self.grey[::4, ::4], BRIGHT_SHARE)) / self.white
        shorter = "expose for half of the time or less"
        if share is not None:
            shorter = f"expose for {percent_text(share, 2)} of the time, less if the part is shiny"
        if self.overexposed:
            found.append(f"{100 * self.clipped_share:.0f} % of the image is overexposed: {shorter}")
        elif overexposed:
            found.append(f"overexposed beside {', '.join(overexposed)}: {shorter}")
        elif bright < DARK_SHARE:
            found.append(f"dark: expose for {WELL_EXPOSED / max(bright, 0.004):.1f} times as long")
        if blur_px > MOST_BLUR_PX:
            found.append(f"blurred: edges are spread with a standard deviation of {blur_px:.1f} px")
        return found

    @property
    def overexposed(self) -> bool:
        """Whether so much of the image is overexposed that it has a note."""
        return self.clipped_share > MOST_CLIPPED

    def turned(self) -> Picture:
        """Return the image turned by 180 degrees."""
        return replace(self, grey=np.ascontiguousarray(self.grey[::-1, ::-1]))

    def mirrored(self) -> Picture:
        """Return the image with left and right exchanged."""
        return replace(self, grey=np.ascontiguousarray(self.grey[:, ::-1]))

    @property
    def clipped_share(self) -> float:
        """Share of the pixels that are overexposed."""
        return float(np.mean(self.grey >= CLIPPED_SHARE * self.white))

    def find(
        self,
        centres: NDArray[np.float64],
        across: NDArray[np.float64],
        half_px: float,
        sign: NDArray[np.int64] | None = None,
    ) -> Scans:
        """Scan across edges, see `planner.measuring.scans.find_edges`."""
        return find_edges(
            self.grey, centres, across, half_px, white=self.white, noise=self.noise, sign=sign
        )


Image = NDArray[np.generic]

SUFFIXES = (".png", ".tif", ".tiff", ".bmp", ".npy")
LOSSY = (".jpg", ".jpeg")
# weights of red, green and blue in a grey value (ITU-R BT.601)
_LUMINANCE = np.array([0.299, 0.587, 0.114])
_ORIENTATION = 0x0112
_LISTED = 6
# means of the four positions differ by more than this share only behind a colour filter; unless all is dark
_MOSAIC = 0.05
_FEW = 10_000
_DARK = 0.02


@dataclass(frozen=True)
class Shot:
    """An image that a plan takes.

    Attributes
    ----------
    name : str
        Its name, such as "setting_01".
    setting : int
        Number of its setting, from 0.
    targets : tuple of str
        What is measured in it.
    """

    name: str
    setting: int
    targets: tuple[str, ...]


@dataclass
class ImageSet:
    """The images of one part.

    Attributes
    ----------
    images : dict of str to array (h, w)
        Grey values by the name of the shot.
    notes : list of str
        What was changed or assumed.
    digests : dict of str to str
        SHA-256 of each file, or of the array's bytes.
    """

    images: dict[str, Image] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    digests: dict[str, str] = field(default_factory=dict)


def shots_of(plan: InspectionPlan) -> list[Shot]:
    """Return the images that a plan takes: one for each setting, or several under different lamps."""
    shots = []
    for k, setting in enumerate(plan.settings):
        lit = () if plan.light is None else plan.light.images[k]
        if len(lit) < 2:
            shots.append(Shot(setting_name(k), k, tuple(setting.entities)))
            continue
        for i, image in enumerate(lit):
            targets = tuple(name for name in setting.entities if name in image.contrast)
            shots.append(Shot(setting_name(k, i), k, targets))
    return shots


def read_images(
    source: str | os.PathLike[str] | Mapping[Any, Any],
    shots: list[Shot],
    camera: Camera,
    *,
    partial: bool = False,
    allow_lossy: bool = False,
) -> ImageSet:
    """Read the images of a plan, and check all of them.

    Parameters
    ----------
    source : path or mapping
        A folder of files named like the shots; or a shot's name, or number of its setting from 1, to a file or an
        array.
    shots : list of Shot
        What the plan takes.
    camera : Camera
        The camera.
    partial : bool
        Whether images may be missing.
    allow_lossy : bool
        Whether JPEG files are accepted.

    Returns
    -------
    ImageSet
        The images.

    Raises
    ------
    RequestError
        Names all images that are missing, twice there, unknown or of the wrong size.
    """
    files = _in_folder(source, shots) if isinstance(source, str | os.PathLike) else _by_name(source)
    _check_names(files, shots, partial)
    found = ImageSet()
    wrong = []
    for shot in shots:
        if shot.name not in files:
            found.notes.append(f"{shot.name}: no image")
            continue
        try:
            image, digest, notes = _read(files[shot.name], allow_lossy)
            _check_size(image, camera)
        except RequestError as error:
            wrong.append(f"{shot.name}: {error.rule or error}")
            continue
        found.images[shot.name] = image
        found.digests[shot.name] = digest
        found.notes += [f"{shot.name}: {note}" for note in notes]
    wrong += _twice(found.digests)
    if wrong:
        raise RequestError.of_rule(
            "images", "must be images of the plan's settings", "; ".join(wrong[:_LISTED])
        )
    return found


def _in_folder(source: str | os.PathLike[str], shots: list[Shot]) -> dict[str, Any]:
    """Return the files of a folder by the name of the shot."""
    folder = Path(source)
    if not folder.is_dir():
        raise RequestError.of_rule("images", "must be an existing folder", repr(str(source)))
    files: dict[str, Any] = {}
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() not in SUFFIXES + LOSSY:
            continue
        if path.stem in files:
            got = f"{files[path.stem].name} and {path.name}"
            raise RequestError.of_rule("images", "must hold one file for each image", got)
        files[path.stem] = path
    if not files:
        names = f"{shots[0].name}.png" if shots else "none"
        raise RequestError.of_rule(
            "images",
            f"must hold images named like {names}",
            f"none in {str(source)!r}",
        )
    return files


def _by_name(source: Mapping[Any, Any]) -> dict[str, Any]:
    """Return images by the name of the shot, given by names or numbers of settings."""
    files = {}
    for key, value in source.items():
        is_number = isinstance(key, int | np.integer) and not isinstance(key, bool)
        files[setting_name(int(key) - 1) if is_number else str(key)] = value
    return files


def _check_names(files: Mapping[str, Any], shots: list[Shot], partial: bool) -> None:
    known = [shot.name for shot in shots]
    missing = [name for name in known if name not in files]
    extra = [name for name in files if name not in known]
    parts = []
    if missing and (not partial or len(missing) == len(known)):
        parts.append(f"no {_listed(missing)}")
    if extra:
        parts.append(f"{_listed(extra)}, which the plan does not take")
    if parts:
        hint = "" if extra or partial else "--partial measures what is there"
        raise RequestError.of_rule(
            "images",
            f"must be the {len(known)} images of the plan, {known[0]} to {known[-1]}",
            " and ".join(parts),
            hint=hint,
        )


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return ", ".join(names[:_LISTED]) + more


def _read(item: Any, allow_lossy: bool) -> tuple[Image, str, list[str]]:
    """Return the grey image of a file or array, its digest, and notes."""
    if isinstance(item, str | os.PathLike):
        path = Path(item)
        try:
            digest = hashlib.sha256(path.read_bytes()).hexdigest()
        except OSError as error:
            raise _wrong(f"cannot be read: {error.strerror}") from None
        array, notes = _decoded(path, allow_lossy)
        if array.ndim == 2 and _is_mosaic(array) and not allow_lossy:
            rule = (
                "looks like the mosaic of a colour camera; convert it to grey, or use --allow-lossy"
            )
            raise _wrong(rule)
    else:
        array = np.asarray(item)
        digest = hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()
        notes = []
    image, more = _as_grey(array)
    return image, digest, notes + more


def _decoded(path: Path, allow_lossy: bool) -> tuple[Image, list[str]]:
    suffix = path.suffix.lower()
    if suffix in LOSSY and not allow_lossy:
        raise _wrong(
            "is a JPEG file, whose edges are not those of the sensor; --allow-lossy reads it"
        )
    if suffix == ".npy":
        try:
            return np.load(path, allow_pickle=False), []
        except (OSError, ValueError):
            raise _wrong("is no NumPy file of an array") from None
    from PIL import Image as Pillow

    try:
        with Pillow.open(path) as picture:
            turned = picture.getexif().get(_ORIENTATION, 1)
            array = np.asarray(picture.convert("L") if picture.mode in ("P", "1") else picture)
    except (OSError, ValueError, SyntaxError, Pillow.DecompressionBombError):
        raise _wrong("is no image that can be read") from None
    if turned != 1:
        raise _wrong(f"says that it is turned (EXIF orientation {turned}); store it as taken")
    return array, []


def _as_grey(array: Image) -> tuple[Image, list[str]]:
    """Return grey values of 8 or 16 bits, or floats in [0, 1]."""
    notes = []
    if array.ndim == 3 and array.shape[2] in (2, 4):
        alpha = array[..., -1]
        if not (alpha == alpha.max()).all():
            raise _wrong("has transparent pixels")
        array = array[..., :-1]
    if array.ndim == 3 and array.shape[2] == 1:
        array = array[..., 0]
    if array.ndim == 3 and array.shape[2] == 3:
        if (array == array[..., :1]).all():
            array = array[..., 0]
        else:
            kind = array.dtype
            array = (
                (array @ _LUMINANCE).round().astype(kind)
                if kind.kind == "u"
                else array @ _LUMINANCE
            )
            notes.append("colour image, measured in its luminance")
    if array.ndim != 2:
        raise _wrong(f"has the shape {array.shape}; it must be one grey image")
    if array.dtype.kind == "i" and array.min() >= 0 and array.max() <= np.iinfo(np.uint16).max:
        # 16 bits as Pillow reads them
        array = array.astype(np.uint16)
    if array.dtype not in (np.uint8, np.uint16) and not _is_share(array):
        raise _wrong("must have grey values of 8 or 16 bits, or from 0 to 1")
    if array.dtype == np.uint16 and array.max() <= np.iinfo(np.uint8).max:
        array = array.astype(np.uint8)
        notes.append("16 bits that hold 8")
    elif array.dtype == np.uint16 and array.max() < 4096:
        # what is written for full exposure is not known: cameras of 10 and 12 bits fill the low bits
        bits = 10 if array.max() < 1024 else 12
        array = np.left_shift(array.astype(np.uint16), 16 - bits)
        notes.append(f"16 bits that hold {bits}")
    return array, notes


def _is_mosaic(array: Image) -> bool:
    """Return whether pixels of the four positions in squares of two by two differ as those of a colour filter do."""
    height, width = (size // 2 * 2 for size in array.shape)
    parts = [
        float(array[i:height:2, j:width:2].astype(np.float64).mean())
        for i in range(2)
        for j in range(2)
    ]
    if array.size < _FEW or not np.isfinite(parts).all():
        return False
    return bool(max(parts) - min(parts) > _MOSAIC * max(max(parts), _DARK * _most(array)))


def _most(array: NDArray[Any]) -> float:
    return float(np.iinfo(array.dtype).max) if array.dtype.kind in "ui" else 1.0


def _is_share(array: Image) -> bool:
    """Return whether an array holds floats in [0, 1]."""
    if array.dtype.kind != "f" or not np.isfinite(array).all():
        return False
    return bool(array.min() >= 0 and array.max() <= 1)


def _check_size(image: Image, camera: Camera) -> None:
    height, width = image.shape
    wanted = tuple(camera.resolution)
    if (width, height) == wanted:
        return
    text = f"is {width} × {height} px"
    hint = ""
    if (height, width) == wanted:
        hint = ", turned by 90 degrees"
    elif width and height and wanted[0] / width == wanted[1] / height:
        hint = ", binned or scaled"
    raise _wrong(f"{text}{hint}; the plan's camera has {wanted[0]} × {wanted[1]} px")


def _twice(digests: Mapping[str, str]) -> list[str]:
    """Say which images are the same bytes."""
    first: dict[str, str] = {}
    wrong = []
    for name, digest in digests.items():
        if digest in first:
            wrong.append(f"{name}: is the same image as {first[digest]}")
        first.setdefault(digest, name)
    return wrong


def _wrong(rule: str) -> RequestError:
    """Return an error whose rule is the whole sentence about one image."""
    error = RequestError(rule)
    error.rule = rule
    return error
