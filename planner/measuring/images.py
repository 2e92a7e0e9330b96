"""The images of a plan: which files they are, and everything that is wrong with them before one is measured."""

from __future__ import annotations

import hashlib
import os
import stat
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from errors.checks import percent_text
from ground.short_repr import short_repr
from planner.camera.camera import Camera
from planner.camera.response import LINEAR, Response, stated_in_file
from planner.exceptions import RequestError
from planner.files import name_text
from planner.measuring.samples import CLIPPED_SHARE, MOST_BY_SLOPES_PX, Scans, find_edges, noise_of
from planner.sensor_setting import setting_name

if TYPE_CHECKING:
    from PIL.Image import Image as PillowImage

    from planner.plan import InspectionPlan


# One image as it is measured: grey values, their noise, and the camera.


MOST_CLIPPED = 0.05
"""Share of an image that may be overexposed without a note."""
MOST_PLANNED = 0.3
"""The same of an image that is exposed as a plan says, away from its targets."""
BRIGHT_SHARE = 0.995
"""An image is as bright as this share of its pixels at most."""
BRIGHT_PIXELS = 2_000
"""Or as all but so many pixels, if these are fewer: a part may fill little of a large sensor."""
DARK_SHARE = 0.25
"""Share of white below which an image is dark."""
WELL_EXPOSED = 0.8
"""Share of white that the bright part of an image should have."""
# an image without any light is as if it had one of 255
_DARKEST = 0.004
MOST_BLUR_PX = 2.0
"""Blur across edges from which on an image has a note."""


STATED = "camera"
"""The origin of white that the camera states."""
PLATEAU = "plateau"
"""The origin of white at which the brightest pixels of an image end."""
DEPTH = "depth"
"""The origin of white that is the largest number of as many bits as an image needs: it may be more."""

FILE = "file"
"""The origin of a response that an image file states."""
ASSUMED = "assumed"
"""The origin of a response that nothing states: grey values are taken to be proportional to light."""

_DEPTHS = (8, 10, 12, 14, 16)
# pixels, and their share of the image, that may be brighter than white: hot ones
_FEW = 16
_FEW_SHARE = 1e-5
# levels of grey values below white at least, and levels that it is compared with
_LEAST_LEVELS = 32
_BELOW = 8
# more pixels are white than at each of these levels, times as many; or with equal neighbours, as of no noisy level
_MORE = 2.0
_FAR_MORE = 30.0
_EQUAL = 0.5


def longer(bright: float) -> str:
    """Return for how long to expose an image whose bright part has a share of white."""
    times = WELL_EXPOSED / max(bright, _DARKEST)
    return f"expose for {times:.{1 if times < 10 else 0}f} times as long"


class White(NamedTuple):
    """Full exposure of an image.

    Attributes
    ----------
    level : float
        Its grey value.
    origin : str
        `STATED`, `PLATEAU` or `DEPTH`.
    """

    level: float
    origin: str


def white_of(image: NDArray[np.generic], stated: int | None = None) -> White:
    """Return the grey value of full exposure of an image.

    It is what the camera states. Otherwise it is the level at which the image's brightest pixels end, if a plateau of
    pixels is there. In an image without such a plateau, nothing tells white. Then it is that of the smallest usual
    depth that holds the image. A camera may fill the upper bits, and a program may stretch levels: then values have
    gaps, and the levels before count.

    Parameters
    ----------
    image : array (h, w)
        Grey values: 8 or 16 bits, or floats in [0, 1].
    stated : int, optional
        White of the camera. It does not count for floats.
    """
    if image.dtype.kind == "f":
        levels = np.rint(np.asarray(image, dtype=np.float64) * _most(np.uint16)).astype(np.uint16)
        plateau = _plateau_of(levels)
        return White(1.0, DEPTH) if plateau is None else White(plateau / _most(np.uint16), PLATEAU)
    if stated is not None:
        return White(float(stated), STATED)
    plateau = _plateau_of(image)
    if plateau is not None:
        return White(float(plateau), PLATEAU)
    return White(_depth_white(image), DEPTH)


def _plateau_of(image: NDArray[Any]) -> int | None:
    """Return the level at which the brightest pixels end, if far more of them lie there than light alone explains.

    Clipped pixels have exactly this value, as have their neighbours. Noise makes neighbours of other levels differ. In
    an image without noise, nothing can be told: a face of one grey value is a plateau, too.
    """
    values = np.flatnonzero(np.bincount(image.ravel()))
    numbers = np.zeros(int(values[-1]) + 1, dtype=np.int64)
    numbers[values] = _numbers_of(values)[0]
    numbered = numbers[image]
    count = np.bincount(numbered.ravel())
    few = max(_FEW, int(_FEW_SHARE * image.size))
    level = len(count) - 1 - int(np.argmax(np.cumsum(count[::-1]) > few))
    if level < _LEAST_LEVELS:
        return None
    below = count[level - _BELOW : level].mean()
    equal = numbered[:, :-1] == numbered[:, 1:]
    noisy = (numbered >= level // 4) & (numbered < level) & (numbered > 0)
    if noisy.sum() <= few or equal[noisy[:, :-1]].mean() > _EQUAL:
        return None
    alike = equal[(numbered == level)[:, :-1]]
    is_area = alike.size > 0 and alike.mean() >= _EQUAL and count[level] >= _MORE * below
    is_many = count[level] > few and count[level] >= _FAR_MORE * max(below, 1.0)
    return int(values[numbers[values] == level][-1]) if is_area or is_many else None


def _numbers_of(values: NDArray[np.int64]) -> tuple[NDArray[np.int64], float]:
    """Return the numbers (n,) of the levels of a converter, and their distance, from the grey values (n,) that occur.

    A program may have stretched the levels: those of 8 bits to 16, or to floats. Then no two values are neighbours. If
    they are not evenly spaced, as after a gamma curve, each value counts as a level. Their distance is 1 then.
    """
    gaps = np.diff(values)
    if not len(gaps) or gaps.min() < 2:
        return values, 1.0
    # stretched levels are rounded
    step = float(gaps[gaps <= gaps.min() + 1].mean())
    numbers = np.concatenate([[0], np.cumsum(np.rint(gaps / step))]).astype(np.int64)
    step = float(values[-1] - values[0]) / numbers[-1]
    if np.abs(values - values[0] - step * numbers).max() > 1.0:
        return np.arange(len(values)), 1.0
    return numbers + round(values[0] / step), step


def _depth_white(image: NDArray[Any]) -> float:
    """Return the largest number of as many bits as an image without a plateau needs, in its upper bits."""
    if image.dtype == np.uint8:
        return _most(np.uint8)
    count = np.bincount(image.ravel())
    values = np.flatnonzero(count)
    numbers, step = _numbers_of(values)
    if step == 1.0:
        numbers = values
    few = max(_FEW, int(_FEW_SHARE * image.size))
    for bits in _DEPTHS:
        white = 2**bits - 1
        # many pixels that are nearly white, and none that is: it is another white
        near = count[values[numbers >= int(CLIPPED_SHARE * white)]].sum()
        if numbers[-1] == white or (numbers[-1] < white and near <= few):
            return _whole(white * step, white / max(numbers[-1], 1))
    return _most(np.uint16)


def _whole(white: float, slack: float) -> float:
    """Return a stretched white as a grey value: the largest of a usual depth that is as near as rounding allows."""
    for bits in _DEPTHS:
        if abs(white - (2**bits - 1)) <= slack:
            return float(2**bits - 1)
    return float(min(round(white), _most(np.uint16)))


def _most(kind: type[np.unsignedinteger[Any]]) -> float:
    return float(np.iinfo(kind).max)


@dataclass(frozen=True)
class Picture:
    """An image.

    Attributes
    ----------
    name : str
        Its name, such as "setting_01.png".
    grey : array (h, w)
        Light, float32, scaled so that full exposure is ``white``: grey values if these are proportional to light.
    white : float
        Grey value of full exposure.
    noise : float
        Standard deviation of the noise, as ``grey``.
    camera : Camera
        The camera.
    white_from : str
        Where ``white`` is from, see `White`.
    response : Response
        How much light a grey value stands for.
    response_from : str
        Where it is from: `STATED`, `FILE`, `ASSUMED`, or the edges.
    levels : array (h, w)
        Grey values as the image has them; those of ``grey`` if not stated.
    power : float
        Power that the light was raised to, see `raised`.
    """

    name: str
    grey: NDArray[np.float32]
    white: float
    noise: float
    camera: Camera
    white_from: str = STATED
    response: Response = LINEAR
    response_from: str = ASSUMED
    levels: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 0), np.float32))
    power: float = 1.0

    def __post_init__(self) -> None:
        if not self.levels.size:
            object.__setattr__(self, "levels", self.grey)

    __repr__ = short_repr

    @classmethod
    def of(
        cls,
        name: str,
        image: NDArray[np.generic],
        camera: Camera,
        in_file: Response | None = None,
    ) -> Picture:
        """Return an image of 8 or 16 bits, or of floats in [0, 1], whose file may state a response."""
        grey = np.ascontiguousarray(image, dtype=np.float32)
        white = white_of(image, camera.white_level)
        picture = cls(name, grey, white.level, noise_of(grey), camera, white.origin)
        if camera.response is not None:
            return picture.under(Response.of(camera.response), STATED)
        return picture if in_file is None else picture.under(in_file, FILE)

    def under(self, response: Response, origin: str) -> Picture:
        """Return the image in the light of a response, and where this is from."""
        grey = response.applied(self.levels, self.white)
        return replace(
            self, grey=grey, noise=noise_of(grey), response=response, response_from=origin
        )

    def raised(self, power: float) -> Picture:
        """Return the image as if its light were this power of it."""
        share = np.maximum(self.grey / np.float32(self.white), np.float32(0.0))
        grey = np.asarray(self.white * share ** np.float32(power), dtype=np.float32)
        return replace(self, grey=grey, noise=noise_of(grey), power=power)

    @property
    def clipped_from(self) -> float:
        """Light from which on it is overexposed; grey values tell, whatever light they stand for."""
        return self.white * float(self.response.light(np.array(CLIPPED_SHARE))) ** self.power

    def notes(
        self,
        blur_px: float,
        overexposed: Sequence[str] = (),
        share: float | None = None,
        *,
        planned: bool = False,
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
        planned : bool
            Whether a plan says what to expose it for. It may then be overexposed away from its targets.
        """
        notes = []
        bright = self.bright_share
        shorter = "expose for half of the time or less"
        if share is not None:
            shorter = f"expose for {percent_text(share, 2)} of the time, less if the part is shiny"
        as_planned = planned and share is None and self.clipped_share <= MOST_PLANNED
        if self.overexposed and not (as_planned and not overexposed):
            notes.append(f"{100 * self.clipped_share:.0f} % of the image is overexposed: {shorter}")
        elif overexposed:
            notes.append(f"overexposed beside {', '.join(overexposed)}: {shorter}")
        elif bright < DARK_SHARE:
            notes.append(f"dark{self._if_white}: {longer(bright)}")
        if blur_px > MOST_BLUR_PX:
            notes.append(f"blurred: edges are spread with a standard deviation of {blur_px:.1f} px")
        return notes

    @property
    def _if_white(self) -> str:
        """What is assumed of white, if nothing states it."""
        if self.white_from != DEPTH or self.white <= _most(np.uint8):
            return ""
        return f", if white is {self.white:.0f} (white_level of the camera states it)"

    @property
    def bright_share(self) -> float:
        """How bright nearly all of the image is at most, as a share of white."""
        share = max(BRIGHT_SHARE, 1 - BRIGHT_PIXELS / self.grey.size)
        return float(np.quantile(self.grey[::4, ::4], share)) / self.white

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
        return float(np.mean(self.levels >= CLIPPED_SHARE * self.white))

    def find(
        self,
        centres: NDArray[np.float64],
        across: NDArray[np.float64],
        half_px: float,
        sign: NDArray[np.int64] | None = None,
        most_by_slopes_px: float = MOST_BY_SLOPES_PX,
    ) -> Scans:
        """Scan across edges, see `planner.measuring.samples.find_edges`."""
        return find_edges(
            self.grey,
            centres,
            across,
            half_px,
            white=self.white,
            noise=self.noise,
            sign=sign,
            clipped=self.clipped_from,
            most_by_slopes_px=most_by_slopes_px,
        )


Image = NDArray[np.generic]

SUFFIXES = (".png", ".tif", ".tiff", ".bmp", ".npy", ".jpg", ".jpeg", ".webp", ".gif", ".pgm")
"""Suffixes of files that are taken for images. What a file is, its content says."""
_USE = "store PNG, TIFF, BMP or NumPy"
_LOSSY = ("JPEG", "MPO", "WEBP")
_LOSSLESS = ("PNG", "TIFF", "BMP", "DIB")
# compressions of TIFF files that lose nothing
_TIFF_LOSSLESS = (
    *("raw", "tiff_raw_16", "packbits", "tiff_lzw", "lzma", "zstd"),
    *("tiff_adobe_deflate", "tiff_deflate"),
)
# how Pillow names grey values and colours that are read as they are
_GREY = ("L", "I;16", "I;16L", "I;16B", "I;16N", "I", "F", "LA")
_COLOURS = ("RGB", "RGBA", "P", "PA")
_NUMPY = b"\x93NUMPY"
_PHOTOMETRIC = 262
_BITS = 258
# weights of red, green and blue in a grey value (ITU-R BT.601)
_LUMINANCE = np.array([0.299, 0.587, 0.114])
_ORIENTATION = 0x0112
# bytes of the first header of BMP files
_OLD_BMP = 12
_NUMBERS = "must have grey values of 8 or 16 bits, or from 0 to 1"
_LISTED = 6
# means of the four positions differ by more than this share only behind a colour filter; unless all is dark
_MOSAIC = 0.05
_IMAGE_FILES_FEW = 10_000
_DARK = 0.02
# share of pixels that may be brighter than white: hot ones, and what a sharpening filter adds
_ABOVE_WHITE = 0.001


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
        What is measured in it as a whole.
    """

    name: str
    setting: int
    targets: tuple[str, ...]

    @property
    def file(self) -> str:
        """Name of its file."""
        return f"{self.name}.png"


@dataclass
class ImageSet:
    """The images of one part.

    Attributes
    ----------
    images : dict of str to array (h, w)
        Grey values by the name of the shot.
    notes : list of str
        What was changed or assumed.
    files : dict of str to str
        Names of the files; an array has none.
    digests : dict of str to str
        SHA-256 of the bytes of each file, which were decoded, or of the array.
    responses : dict of str to Response
        What files state of the light that their grey values stand for.
    """

    images: dict[str, Image] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    files: dict[str, str] = field(default_factory=dict)
    digests: dict[str, str] = field(default_factory=dict)
    responses: dict[str, Response] = field(default_factory=dict)


def shots_of(plan: InspectionPlan) -> list[Shot]:
    """Return the images that a plan takes: one for each setting, or several under different lamps."""
    shots = []
    for k, setting in enumerate(plan.settings):
        lit = () if plan.light is None else plan.light.images[k]
        whole = tuple(name for name in setting.entities if name not in setting.ends)
        if len(lit) < 2:
            shots.append(Shot(setting_name(k), k, whole))
            continue
        for i, image in enumerate(lit):
            targets = tuple(name for name in whole if name in image.contrast)
            shots.append(Shot(setting_name(k, i), k, targets))
    return shots


def read_images(
    source: str | os.PathLike[str] | Mapping[Any, Any],
    shots: list[Shot],
    camera: Camera,
    *,
    partial: bool = False,
    allow_lossy: bool = False,
    stranger: str = "",
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
        Whether JPEG and WebP files, and the mosaics of colour cameras, are accepted.
    stranger : str
        What says that the images are of another plan, if anything does.

    Returns
    -------
    ImageSet
        The images.

    Raises
    ------
    RequestError
        Names all images that are missing, twice there, unknown or of the wrong size.
    """
    if isinstance(source, str | os.PathLike):
        files = _in_folder(source, shots)
    elif isinstance(source, Mapping):
        files = _by_name(source)
    else:
        kind = type(source).__name__
        hint = "write {1: image, 2: image} with the numbers of the settings"
        raise RequestError.of_rule(
            "images", "must be a folder or a mapping", f"an object of type {kind}", hint=hint
        )
    _check_names(files, shots, partial, stranger)
    image_set = ImageSet()
    wrong: dict[str, list[str]] = {}
    for shot in shots:
        if shot.name not in files:
            image_set.notes.append(f"{shot.name}: no image")
            continue
        try:
            image, digest, notes, response = _read(files[shot.name], allow_lossy)
            _check_size(image, camera)
            _check_white(image, camera)
        except RequestError as error:
            wrong.setdefault(str(error.rule or error), []).append(shot.name)
            continue
        image_set.images[shot.name] = image
        image_set.digests[shot.name] = digest
        if isinstance(files[shot.name], str | os.PathLike):
            image_set.files[shot.name] = name_text(Path(files[shot.name]).name)
        if response is not None:
            image_set.responses[shot.name] = response
        image_set.notes += [f"{shot.name}: {note}" for note in notes]
    for name, reason in _twice(image_set.digests).items():
        wrong.setdefault(reason, []).append(name)
    if wrong:
        parts = [
            f"{_listed(names)}, {'each of which' if len(names) > 1 else 'which'} {reason}"
            for reason, names in wrong.items()
        ]
        raise RequestError.of_rule(
            "images", "must be as the plan's camera takes them", "; and ".join(parts[:_LISTED])
        )
    return image_set


def _in_folder(source: str | os.PathLike[str], shots: list[Shot]) -> dict[str, Any]:
    """Return the files of a folder by the name of the shot."""
    folder = Path(source)
    if not folder.is_dir():
        raise RequestError.of_rule("images", "must be an existing folder", repr(str(source)))
    files: dict[str, Any] = {}
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() not in SUFFIXES:
            continue
        if path.stem in files:
            got = f"{files[path.stem].name} and {path.name}"
            raise RequestError.of_rule("images", "must hold one file for each image", got)
        files[path.stem] = path
    if not files:
        names = shots[0].file if shots else "none"
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


# a command line has the option of this name
_PARTIAL = "partial=True"


def _check_names(files: Mapping[str, Any], shots: list[Shot], partial: bool, stranger: str) -> None:
    names = [shot.name for shot in shots]
    missing = [name for name in names if name not in files]
    extra = [name for name in files if name not in names]
    parts = []
    if missing and (not partial or len(missing) == len(names)):
        parts.append(f"no {_listed(missing)}")
    if extra:
        parts.append(f"{_listed(extra)}, which the plan does not take")
    if parts:
        is_rest = not extra and not partial and len(missing) < len(names)
        hint = stranger
        if not stranger and is_rest:
            hint = f"{_PARTIAL} measures what is there"
        elif not stranger and missing and extra:
            hint = "they may be of another plan"
        raise RequestError.of_rule(
            "images",
            f"must be {_all_of(names)}",
            " and ".join(parts),
            hint=hint,
            mentions=(_PARTIAL,),
        )


def _all_of(names: list[str]) -> str:
    """Return what the images must be."""
    if len(names) == 1:
        return f"the image of the plan, {names[0]}"
    return f"the {len(names)} images of the plan, {names[0]} to {names[-1]}"


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return ", ".join(names[:_LISTED]) + more


def _read(item: Any, allow_lossy: bool) -> tuple[Image, str, list[str], Response | None]:
    """Return the grey image of a file or array, its digest, notes, and the response that it states."""
    if isinstance(item, str | os.PathLike):
        content = _content(Path(item))
        digest = hashlib.sha256(content).hexdigest()
        array, notes, response = _decoded(content, allow_lossy)
        image, more = _as_grey(array)
        if array.ndim == 2 and _is_mosaic(image) and not allow_lossy:
            rule = (
                "looks like the mosaic of a colour camera; convert it to grey, or use --allow-lossy"
            )
            raise _wrong(rule)
        return image, digest, notes + more, response
    try:
        array = np.asarray(item)
    except (TypeError, ValueError):
        raise _wrong("is no array of numbers") from None
    image, notes = _as_grey(array)
    digest = hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()
    return image, digest, notes, None


def _content(path: Path) -> bytes:
    """Return the bytes of a file; of a pipe or a device they might never end."""
    try:
        mode = path.stat().st_mode
        content = path.read_bytes() if stat.S_ISREG(mode) else b""
    except FileNotFoundError:
        raise _wrong("is a link to nothing" if path.is_symlink() else "is no file") from None
    except (OSError, ValueError) as error:
        # a name may hold what no file system has
        raise _wrong(f"cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if not stat.S_ISREG(mode):
        kind = "folder" if stat.S_ISDIR(mode) else "pipe or device"
        raise _wrong(f"is a {kind}; it must be a file")
    return content


def _decoded(content: bytes, allow_lossy: bool) -> tuple[Image, list[str], Response | None]:
    """Return the array of an image file, notes, and its response; what it is, its bytes say.

    The decoders of files that are not what they say raise errors of all kinds.
    """
    if content.startswith(_NUMPY):
        try:
            return np.asarray(np.load(BytesIO(content), allow_pickle=False)), [], None
        except Exception:
            raise _wrong("is no NumPy file of an array") from None
    from PIL import Image as Pillow

    with warnings.catch_warnings():
        # what is odd but readable, and large images
        warnings.simplefilter("ignore")
        try:
            with Pillow.open(BytesIO(content)) as picture:
                notes = _check_picture(picture, content, allow_lossy)
                response = stated_in_file(picture.info, picture.getexif())
                with _without_stderr(picture.format == "TIFF"):
                    return _array_of(picture), notes, response
        except RequestError:
            raise
        except Exception:
            raise _wrong("is no image that can be read") from None


@contextmanager
def _without_stderr(wanted: bool) -> Iterator[None]:
    """Drop what is written to the standard error meanwhile: libtiff writes there what it finds odd."""
    if not wanted:
        yield
        return
    sys.stderr.flush()
    before = os.dup(2)
    nothing = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nothing, 2)
        yield
    finally:
        os.dup2(before, 2)
        os.close(nothing)
        os.close(before)


def _check_picture(picture: PillowImage, content: bytes, allow_lossy: bool) -> list[str]:
    """Raise an error unless an image file holds the grey values of the sensor; return notes."""
    kind = str(picture.format)
    in_tiff = str(picture.info.get("compression", "raw")) if kind == "TIFF" else "raw"
    lossy = kind in _LOSSY or in_tiff not in _TIFF_LOSSLESS
    if kind not in _LOSSY + _LOSSLESS:
        raise _wrong(f"is a {kind} file; {_USE}")
    if lossy and not allow_lossy:
        name = f"{kind} file" if kind in _LOSSY else f"TIFF file compressed as {in_tiff}"
        raise _wrong(
            f"is a {name}, whose edges are not those of the sensor; --allow-lossy reads it"
        )
    notes = [f"{kind if in_tiff == 'raw' else in_tiff} loses detail of edges"] if lossy else []
    pages = int(getattr(picture, "n_frames", 1))
    if pages > 1 and kind != "MPO":
        raise _wrong(f"holds {pages} images; it must hold one")
    if picture.mode not in _GREY + _COLOURS + ("1",):
        raise _wrong(f"has values of the kind {picture.mode}; it must be grey or RGB")
    bits = _bits_of(picture, content)
    if bits < 8:
        raise _wrong(f"has values of {bits} bit{'s' if bits > 1 else ''}; it must have 8 or 16")
    turned = picture.getexif().get(_ORIENTATION, 1)
    if turned != 1:
        raise _wrong(f"says that it is turned (EXIF orientation {turned}); store it as taken")
    if bits > 8 and picture.mode not in _GREY[:-1]:
        notes.append(f"colours or grey with opacity of {bits} bits, read with 8")
    return notes


def _bits_of(picture: PillowImage, content: bytes) -> int:
    """Return the bits of a value in an image file, as the file says."""
    if picture.mode == "1":
        return 1
    if picture.format == "PNG":
        # the first chunk holds width, height and this
        return content[24]
    if picture.format in ("BMP", "DIB"):
        header = 14 if picture.format == "BMP" else 0
        size = int.from_bytes(content[header : header + 4], "little")
        at = header + (10 if size == _OLD_BMP else 14)
        of_pixel = int.from_bytes(content[at : at + 2], "little")
        return of_pixel if of_pixel < 8 else 8
    if picture.format == "TIFF":
        tags = picture.tag_v2  # type: ignore[attr-defined]
        return int(min(np.atleast_1d(tags.get(_BITS, 1))))
    return 8


def _array_of(picture: PillowImage) -> Image:
    """Return the values of an image file."""
    if picture.mode in ("P", "PA"):
        is_clear = picture.mode == "PA" or "transparency" in picture.info
        return np.asarray(picture.convert("RGBA" if is_clear else "RGB"))
    array = np.asarray(picture)
    is_tiff = picture.format == "TIFF"
    if is_tiff and picture.tag_v2.get(_PHOTOMETRIC) == 0:  # type: ignore[attr-defined]
        # black is the largest value; Pillow turns that of 8 bits only
        if picture.mode in ("I", "F"):
            raise _wrong("has white as 0 and values of 32 bits; store black as 0")
        if picture.mode != "L":
            return np.asarray(np.iinfo(np.uint16).max - array.astype(np.uint16))
    return array


def _as_grey(array: Image) -> tuple[Image, list[str]]:
    """Return grey values of 8 or 16 bits, or floats in [0, 1]."""
    notes = []
    if array.dtype.kind not in "uif" or not array.size:
        text = f"values of the kind {array.dtype}" if array.size else "no values"
        raise _wrong(f"has {text}; it must have grey values")
    # files may have the other order of bytes
    array = array.astype(array.dtype.newbyteorder("="), copy=False)
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        raise _wrong(_NUMBERS)
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
            array = _luminance(array)
            notes.append("colour image, measured in its luminance")
    if array.ndim != 2:
        raise _wrong(f"has the shape {array.shape}; it must be one grey image")
    if array.dtype.kind in "ui" and array.dtype != np.uint8:
        if array.min() < 0 or array.max() > np.iinfo(np.uint16).max:
            raise _wrong(_NUMBERS)
        array = array.astype(np.uint16)
    if array.dtype.kind == "f" and not (array.min() >= 0 and array.max() <= 1):
        raise _wrong(_NUMBERS)
    return array, notes


def _luminance(array: Image) -> Image:
    grey = array @ _LUMINANCE
    return np.asarray(grey if array.dtype.kind == "f" else grey.round().astype(array.dtype))


def _is_mosaic(array: Image) -> bool:
    """Return whether pixels of the four positions in squares of two by two differ as those of a colour filter do."""
    if array.size < _IMAGE_FILES_FEW or min(array.shape) < 2:
        return False
    height, width = (size // 2 * 2 for size in array.shape)
    parts = [
        float(array[i:height:2, j:width:2].astype(np.float64).mean())
        for i in range(2)
        for j in range(2)
    ]
    return bool(max(parts) - min(parts) > _MOSAIC * max(max(parts), _DARK * _most_of(array)))


def _most_of(array: NDArray[Any]) -> float:
    return float(np.iinfo(array.dtype).max) if array.dtype.kind in "ui" else 1.0


def _check_size(image: Image, camera: Camera) -> None:
    height, width = image.shape
    size = tuple(camera.resolution)
    if (width, height) == size:
        return
    text = f"is {width} × {height} px"
    hint = ""
    if (height, width) == size:
        hint = ", turned by 90 degrees"
    elif width and height and size[0] / width == size[1] / height:
        hint = ", binned or scaled"
    raise _wrong(f"{text}{hint}; the plan's camera has {size[0]} × {size[1]} px")


def _check_white(image: NDArray[Any], camera: Camera) -> None:
    """Raise an error if the camera's white is not that of an image of 8 or 16 bits."""
    white = camera.white_level
    if white is None or image.dtype.kind == "f":
        return
    largest = int(np.iinfo(image.dtype).max)
    if white > largest:
        raise _wrong(f"has 8 bits; the camera's white_level is {white}")
    share = float(np.mean(image > white))
    if share > _ABOVE_WHITE:
        raise _wrong(
            f"has grey values up to {image.max()}; the camera's white_level is {white}, "
            f"and {100 * share:.2g} % are brighter"
        )


def _twice(digests: Mapping[str, str]) -> dict[str, str]:
    """Say of images that they are the same bytes as another one."""
    first: dict[str, str] = {}
    wrong = {}
    for name, digest in digests.items():
        if digest in first:
            wrong[name] = f"is the same image as {first[digest]}"
        first.setdefault(digest, name)
    return wrong


def _wrong(rule: str) -> RequestError:
    """Return an error whose rule is the whole sentence about one image."""
    error = RequestError(rule)
    error.rule = rule
    return error
