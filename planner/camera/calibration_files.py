"""Calibrations of other programs: COLMAP, ROS, OpenCV (YAML, XML, JSON), Kalibr and Autoware.

What a file holds is decided by its content, not by its name. A file says which lens it is of, and
which part of the sensor it delivers, under many names. Those that are known here are read; a name
that is not known may change the meaning of the numbers, so it is refused.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

from planner.argument_kinds import shown
from planner.camera.calibration import check_positive, opencv_fields
from planner.exceptions import CameraError
from planner.files import name_text

# Names that calibration programs give to the same things, and the names that change nothing.
#
# Upper and lower case, underscores and hyphens are left out: ``image_Width`` is ``imagewidth``.


CAMERA_MATRIX = ("cameramatrix", "k", "cameramat", "intrinsicmatrix")
INTRINSICS = ("intrinsics",)
DISTORTION = (
    *("distortioncoefficients", "distortioncoeffs", "d"),
    *("distcoeffs", "distcoeff"),
)
WIDTH = ("imagewidth", "width")
HEIGHT = ("imageheight", "height")
SIZE = ("resolution", "imagesize")
# each may say that the lens is another one than those read here
DISTORTION_MODEL = ("distortionmodel", "distmodel", "distortiontype", "disttype")
CAMERA_MODEL = (
    *("cameramodel", "cameratype", "modeltype", "model", "modelname"),
    *("lensmodel", "lenstype", "projectionmodel", "projectiontype", "projection"),
)
FISHEYE = ("fisheyemodel", "fisheye", "isfisheye", "usefisheye")
BINNING_X = ("binningx",)
BINNING_Y = ("binningy",)
ROI = ("roi",)

# OpenCV's five coefficients; the rational model holds it where its further ones are zero
BROWN_CONRADY = (
    *("plumbbob", "rationalpolynomial", "radtan", "radialtangential"),
    *("brown", "brownconrady", "opencv"),
)
PINHOLE = ("pinhole", "perspective", "standard")
UNDISTORTED = ("none", "nodistortion", "")

# What these say is not of the raw image, or is how the calibration was made. A rectification turns
# the image that a program makes of the raw one; poses and frames of other sensors come with it.
HARMLESS = frozenset(
    (
        # names, times and messages
        *("cameraname", "cameraid", "header", "comment", "rostopic", "calibrationtime"),
        *("calibrationdate", "sensortype", "ratehz", "typeid"),
        # how good the calibration is
        *("avgreprojectionerror", "reprojectionerror", "rms", "rmserror"),
        *("perviewreprojectionerrors", "stddevintrinsics"),
        # how it was made; the matrix holds the ratio and what the flags held fixed
        *("flags", "flagvalue", "aspectratio", "fixaspectratio", "nframes", "nrofframes"),
        *("nroframes", "boardwidth", "boardheight", "boardsize", "squaresize", "markersize"),
        *("imagepoints", "gridpoints", "extrinsicparameters"),
        # of the rectified image, and of other sensors
        *("rectificationmatrix", "projectionmatrix", "r", "p"),
        *("cameraextrinsicmat", "camoverlaps", "tcncnm1", "tcamimu", "tbs"),
        "timeshiftcamimu",
    )
)
READ = frozenset(
    (
        *(*CAMERA_MATRIX, *INTRINSICS, *DISTORTION, *WIDTH, *HEIGHT, *SIZE),
        *(*DISTORTION_MODEL, *CAMERA_MODEL, *FISHEYE, *BINNING_X, *BINNING_Y, *ROI),
    )
)


def plain(name: str) -> str:
    """Return a name without case, blanks, underscores and hyphens."""
    return re.sub(r"[\s_-]", "", name).casefold()


# Text of YAML, JSON and OpenCV's XML as a tree of mappings, lists, numbers and words.
#
# Numbers are what YAML 1.2 and JSON call so: `1e-05` is one, though not in YAML 1.1; `010` is
# none, as it is 8 in one version and 10 in the other. What stands in quotes is a word.


# calibrations have some kilobytes, or some hundred with the points of all images
_MOST_CHARACTERS = 1_000_000
# libyaml, where PyYAML has it, takes a tenth of the time
_PARSER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_NUMBER = re.compile(r"[-+]?(?:(?:0|[1-9]\d*)(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?")
_NOT_FINITE = {".nan": "nan", ".inf": "inf", "+.inf": "inf", "-.inf": "-inf"}
_WORDS = {"true": True, "false": False, "null": None, "~": None, "": None}
_YES_OR_NO = {"yes": True, "no": False, "on": True, "off": False}
# PyYAML knows none of OpenCV's first line, %YAML:1.0
_DIRECTIVE = re.compile(r"\A%YAML[: ][^\n]*")
_MATRIX = "opencv-matrix"
_TAG = "tag:yaml.org,2002:"
# what says no more than the value does; `merge` and `binary` are not among them
_KNOWN_TAGS = {
    _TAG + name
    for name in ("map", "seq", "str", "int", "float", "bool", "null", "timestamp", "value", _MATRIX)
} | {"!"}


def tree_of(path: Path, text: str) -> Any:
    """Return what a text of YAML, JSON or OpenCV's XML holds.

    Parameters
    ----------
    path : pathlib.Path
        The file, for messages.
    text : str
        What it holds.

    Returns
    -------
    dict, list, float, int, bool, str or None
        Mappings as dict. A file that is no YAML mapping gives a list or a word.

    Raises
    ------
    CameraError
        If the text cannot be parsed, holds a key twice, several documents, or is too long or deep.
    """
    if len(text) > _MOST_CHARACTERS:
        raise CameraError(
            f"{path}: a calibration must have at most {_MOST_CHARACTERS} characters. "
            f"Got {len(text)}."
        )
    try:
        if text.lstrip().startswith("<"):
            return _xml_tree(path, text)
        return _yaml_tree(path, text)
    except RecursionError:
        raise CameraError(
            f"{path}: a calibration must not nest its parts so deep. Got too many levels."
        ) from None


def _yaml_tree(path: Path, text: str) -> Any:
    try:
        documents = _YamlReader(path, _DIRECTIVE.sub("", text)).documents()
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f":{mark.line + 1}" if mark is not None else ""
        reason = getattr(error, "problem", None) or getattr(error, "reason", "it cannot be parsed")
        raise CameraError(
            f"{path}{line}: camera file must be a calibration; as YAML it is broken. "
            f"Got: {shown(reason, str)}."
        ) from None
    # what follows a last `---` is a document without anything in it
    full = [document for document in documents if document is not None]
    if len(full) > 1:
        raise CameraError(
            f"{path}: file must hold one camera. Got {len(full)} YAML documents or messages."
        )
    return full[0] if full else None


class _YamlReader:
    """Makes values of YAML's events; an alias is made once, so that no file is larger than its text.

    PyYAML's own composer crashes on deep nesting when libyaml parses.
    """

    def __init__(self, path: Path, text: str) -> None:
        self._path = path
        self._events = yaml.parse(text, Loader=_PARSER)
        self._by_anchor: dict[str, Any] = {}

    def documents(self) -> list[Any]:
        """Return the values of all documents."""
        values = (yaml.NodeEvent, yaml.CollectionStartEvent)
        return [self._value(event) for event in self._events if isinstance(event, values)]

    def _value(self, event: Any) -> Any:
        if isinstance(event, yaml.AliasEvent):
            return self._aliased(event)
        if event.anchor is None:
            return self._made(event)
        # until the value is made, the reader stands for it
        self._by_anchor[event.anchor] = self
        value = self._made(event)
        self._by_anchor[event.anchor] = value
        return value

    def _aliased(self, event: Any) -> Any:
        if event.anchor not in self._by_anchor:
            rule = "an alias must follow what it stands for"
            raise self._error(event, rule, shown(event.anchor, str))
        value = self._by_anchor[event.anchor]
        if value is self:
            raise self._error(event, "an alias must not stand for what it is in", "a cycle")
        return value

    def _made(self, event: Any) -> Any:
        if event.tag is not None and event.tag not in _KNOWN_TAGS:
            tag = event.tag.replace(_TAG, "!!")
            raise self._error(event, "a tag must be !!opencv-matrix", shown(tag, str))
        if isinstance(event, yaml.MappingStartEvent):
            return self._mapping()
        if isinstance(event, yaml.SequenceStartEvent):
            return [self._value(item) for item in self._until(yaml.SequenceEndEvent)]
        return event.value if event.style else plain_value(event.value)

    def _mapping(self) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for event in self._until(yaml.MappingEndEvent):
            if not isinstance(event, yaml.ScalarEvent) or _is_merge(event):
                raise self._error(event, "a key must be a word", "a merge or a structure")
            self._value(event)
            if event.value in values:
                raise self._error(event, "a key must stand once", shown(event.value, str))
            values[event.value] = self._value(next(self._events))
        return values

    def _until(self, end: type) -> Iterator[Any]:
        """Yield the events that begin an item, up to the end of a collection."""
        while not isinstance(event := next(self._events), end):
            yield event

    def _error(self, event: Any, rule: str, value: str) -> CameraError:
        return CameraError(f"{self._path}:{event.start_mark.line + 1}: {rule}. Got {value}.")


def _is_merge(event: Any) -> bool:
    return bool(event.value == "<<" and not event.style)


def plain_value(text: str) -> Any:
    """Return the number, truth value or nothing that a word without quotes stands for, or the word."""
    if _NUMBER.fullmatch(text):
        return int(text) if re.fullmatch(r"[-+]?\d{1,18}", text) else float(text)
    lower = text.casefold()
    if lower in _NOT_FINITE:
        return float(_NOT_FINITE[lower])
    if lower in _WORDS:
        return _WORDS[lower]
    return _YES_OR_NO.get(lower, text)


class _NoDeclarations(ElementTree.TreeBuilder):
    """Refuses a DOCTYPE: its entities may multiply a text, or name other files."""

    def doctype(self, name: str, public_id: str | None, system: str | None) -> None:
        raise CameraError(f"XML must have no DOCTYPE. Got {shown(name, str)}.")


def _xml_tree(path: Path, text: str) -> Any:
    parser = ElementTree.XMLParser(target=_NoDeclarations())
    try:
        # as bytes, or a declared encoding would contradict the text
        root = ElementTree.fromstring(_undeclared(text), parser=parser)
    except ElementTree.ParseError as error:
        raise CameraError(
            f"{path}:{error.position[0]}: camera file must be a calibration; as XML it is broken. "
            f"Got: {error}."
        ) from None
    except CameraError as error:
        raise CameraError(f"{path}: {error}") from None
    if root.tag != "opencv_storage":
        raise CameraError(
            f"{path}: XML must be of OpenCV, an <opencv_storage>. Got <{shown(root.tag, str)}>."
        )
    return _element_value(path, root)


def _undeclared(text: str) -> str:
    """Return XML without the line that declares an encoding, which is decoded by now."""
    return re.sub(r"\A\s*<\?xml[^>]*\?>", "", text)


def _element_value(path: Path, element: ElementTree.Element) -> Any:
    unknown = set(element.attrib) - {"type_id"}
    kind = element.attrib.get("type_id", _MATRIX)
    if unknown or kind not in (_MATRIX, "opencv-nd-matrix", "map", "seq"):
        attribute = next(iter(unknown), f"type_id={kind}")
        raise CameraError(
            f'{path}: <{element.tag}> must be plain or type_id="{_MATRIX}". '
            f"Got {shown(attribute, str)}."
        )
    children = list(element)
    if any(child.tag != "_" for child in children):
        content: dict[str, Any] = {}
        for child in children:
            if child.tag in content:
                raise CameraError(f"{path}: a key must stand once. Got {shown(child.tag, str)}.")
            content[child.tag] = _element_value(path, child)
        return content
    if children:
        return [_element_value(path, child) for child in children]
    words = (element.text or "").strip()
    if words.startswith('"'):
        return words.strip('"')
    values = [plain_value(word) for word in words.split()]
    if element.tag == "data" or len(values) > 1:
        return values
    return values[0] if values else None


# What a reader returns, and the checks that all readers share.


# tangent of half the field of view; lenses of the pinhole model see at most some 160 degrees
_WIDEST_TANGENT = 10.0


class Calibration(NamedTuple):
    """A camera as its calibration states it.

    Attributes
    ----------
    matrix : ndarray of shape (3, 3)
        Camera matrix K in OpenCV's convention, px of the delivered image.
    distortion : list of float or None
        Coefficients in OpenCV's order.
    image_size : tuple of int
        Width and height of the delivered image, px.
    binning : tuple of int
        How many pixels of the sensor make one of the image, across and down.
    """

    matrix: NDArray[np.float64]
    distortion: list[float] | None
    image_size: tuple[int, int]
    binning: tuple[int, int] = (1, 1)


def camera_matrix(fx: float, fy: float, cx: float, cy: float) -> NDArray[np.float64]:
    """Return the camera matrix of two scales and a principal point, px."""
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def check_finite(where: str, values: list[float], names: tuple[str, ...]) -> None:
    """Refuse a number that is NaN or infinite.

    Parameters
    ----------
    where : str
        File and field, as the message names them.
    values : list of float
        The numbers.
    names : tuple of str
        What each of them is.

    Raises
    ------
    CameraError
        If a number is not finite.
    """
    for value, name in zip(values, names, strict=False):
        if not math.isfinite(value):
            raise CameraError(f"{where} must hold finite numbers. Got {value} for {name}.")


def check_pixels(where: str, matrix: NDArray[np.float64], image_size: tuple[int, int]) -> None:
    """Refuse focal lengths that are not in pixels or not there, and a principal point elsewhere.

    Parameters
    ----------
    where : str
        File and field, as the message names them.
    matrix : ndarray of shape (3, 3)
        Camera matrix.
    image_size : tuple of int
        Width and height, px.

    Raises
    ------
    CameraError
        If a focal length is not positive, or so short that the lens would see all of a half space,
        or the principal point is not in the image.
    """
    for focal, size in zip((matrix[0, 0], matrix[1, 1]), image_size, strict=True):
        if not focal > 0.0:
            hint = ": the camera was not calibrated" if focal == 0.0 else ""
            raise CameraError(f"{where} must hold positive focal lengths. Got {focal:g}{hint}.")
        if size > 2.0 * _WIDEST_TANGENT * focal:
            raise CameraError(
                f"{where} must hold focal lengths in pixels. "
                f"Got {focal:g} for an image of {size} pixels."
            )
    if not is_in_image(matrix, image_size):
        raise CameraError(
            f"{where} must hold a principal point in the image of {image_size[0]} x "
            f"{image_size[1]} pixels. Got ({matrix[0, 2]:g}, {matrix[1, 2]:g})."
        )


def is_in_image(matrix: NDArray[np.float64], image_size: tuple[int, int]) -> bool:
    """Tell whether the principal point of a camera matrix is in an image, px."""
    width, height = image_size
    return bool(-0.5 < matrix[0, 2] < width - 0.5 and -0.5 < matrix[1, 2] < height - 0.5)


# The values of one camera, found by any of their names: numbers, sizes and words, checked.


_MATRIX_KEYS = {"rows", "cols", "dt", "data", "typeid"}
# OpenCV's letters for the number types of one channel
_ONE_CHANNEL = ("u", "c", "w", "s", "i", "f", "d", "h")


class NamedValues:
    """Values of a mapping, by plain names; messages name the file and the key as it stands there.

    Parameters
    ----------
    path : pathlib.Path
        The file.
    values : dict
        What it says of one camera.

    Raises
    ------
    CameraError
        If two keys are the same, or a key is not known: it might change the meaning.
    """

    def __init__(self, path: Path, values: dict[str, Any]) -> None:
        self.path = path
        self._values: dict[str, tuple[str, Any]] = {}
        for key, value in values.items():
            name = plain(key)
            if name in self._values:
                other = self._values[name][0]
                raise CameraError(f"{path}: {key} must stand once. Got {other}, too.")
            self._values[name] = (key, value)
        for name, (key, _) in self._values.items():
            if name not in READ and name not in HARMLESS:
                raise CameraError(
                    f"{path}: {shown(key, str)} must be a key that is known here, "
                    "as another may change what the numbers mean. Got an unknown key."
                )

    def error(self, key: str, rule: str, got: object) -> CameraError:
        """Return the error of a value that breaks a rule; names file, key, rule and value."""
        return CameraError(f"{self.path}: {key} {rule}. Got {got}.")

    def key(self, names: tuple[str, ...]) -> str | None:
        """Return the key that is there of several names for one thing, or None.

        Raises
        ------
        CameraError
            If there are two.
        """
        keys = [self._values[name][0] for name in names if name in self._values]
        if len(keys) > 1:
            raise self.error(keys[0], "must stand alone", f"{keys[1]}, too")
        return keys[0] if keys else None

    def entries(self, names: tuple[str, ...]) -> list[tuple[str, Any]]:
        """Return keys and values of all the names that are there."""
        return [self._values[name] for name in names if name in self._values]

    def needed(self, names: tuple[str, ...], usual: str) -> tuple[str, Any]:
        """Return the key and the value of a thing that must be there."""
        key = self.key(names)
        if key is None:
            keys = ", ".join(other for other, _ in self._values.values())
            raise self.error(usual, "must be given", shown(keys, str))
        return self._values[plain(key)]

    def count(self, key: str, value: Any) -> int:
        """Return a whole number that is not negative."""
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not math.isfinite(value)
            or value != int(value)
            or value < 0
        ):
            raise self.error(key, "must be a whole number", shown(value))
        return int(value)

    def numbers(self, key: str, value: Any, names: tuple[str, ...]) -> list[float]:
        """Return the finite numbers of a list, a nested list, or a matrix with rows and cols."""
        shape = None
        if isinstance(value, dict):
            shape, value = self._matrix(key, value)
        flat = self._flat(key, value)
        if shape is not None and shape[0] * shape[1] != len(flat):
            raise self.error(
                key, f"must hold rows x cols numbers, {shape[0]} x {shape[1]}", len(flat)
            )
        square = math.isqrt(len(names))
        if shape is not None and shape != (square, square) and min(shape, default=0) > 1:
            raise self.error(key, "must have rows and cols that fit", f"{shape[0]} x {shape[1]}")
        check_finite(f"{self.path}: {key}", flat, names)
        return flat

    def _matrix(self, key: str, value: dict[str, Any]) -> tuple[tuple[int, int] | None, Any]:
        entries = {plain(name): entry for name, entry in value.items()}
        for name in value:
            if plain(name) not in _MATRIX_KEYS:
                raise self.error(key, "must hold rows, cols, dt and data", shown(name, str))
        if "data" not in entries:
            raise self.error(key, "must hold data", shown(", ".join(value)))
        if entries.get("dt", "d") not in _ONE_CHANNEL:
            raise self.error(
                key,
                "must state one number for each element, such as dt: d",
                f"dt: {shown(entries['dt'], str)}",
            )
        if "rows" not in entries and "cols" not in entries:
            return None, entries["data"]
        rows = self.count(f"rows of {key}", entries.get("rows"))
        cols = self.count(f"cols of {key}", entries.get("cols"))
        return (rows, cols), entries["data"]

    def _flat(self, key: str, value: Any) -> list[float]:
        if not isinstance(value, list):
            raise self.error(key, "must be a list of numbers", shown(value))
        flat: list[float] = []
        for item in value:
            if isinstance(item, list):
                flat += self._row(key, item)
            else:
                flat += self._row(key, [item])
        return flat

    def _row(self, key: str, row: list[Any]) -> list[float]:
        for item in row:
            if isinstance(item, bool) or not isinstance(item, int | float):
                raise self.error(key, "must hold numbers", shown(item))
        return [float(item) for item in row]


# COLMAP's cameras.txt: a line for each camera, of its id, model, width, height and numbers.


# the parameters of each model, in COLMAP's order
_COLMAP = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
    "FULL_OPENCV": (
        *("fx", "fy", "cx", "cy"),
        *("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    ),
}
_COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_CAMERA = re.compile(r"\d+\s+[A-Z][A-Z_0-9]*(\s|$)")
# COLMAP writes this comment above its cameras
_HEADING = re.compile(r"#.*CAMERA_ID,\s*MODEL")
_WHOLE = re.compile(r"\d{1,9}")


def is_colmap(text: str) -> bool:
    """Tell whether a text is COLMAP's: its first line that says something is a camera."""
    for line in text.splitlines():
        if line.strip() and not line.lstrip().startswith("#"):
            return bool(_CAMERA.match(line.lstrip()))
    return bool(_HEADING.search(text))


def read_colmap(path: Path, text: str) -> Calibration:
    """Read COLMAP's cameras.txt, which must hold one camera.

    Parameters
    ----------
    path : pathlib.Path
        The file, for messages.
    text : str
        What it holds. COLMAP's first pixel has its centre at (0.5, 0.5).

    Returns
    -------
    Calibration
        Of the models SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV and FULL_OPENCV.

    Raises
    ------
    CameraError
        If the file holds none or several cameras, or another model.
    """
    lines = [
        line.split()
        for line in text.splitlines()
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if len(lines) != 1:
        raise CameraError(f"{path}: file must hold one camera. Got {len(lines)}.")
    _, model, *words = lines[0]
    if model not in _COLMAP:
        raise CameraError(
            f"{path}: camera model must be one of {', '.join(_COLMAP)}. Got {shown(model)}."
        )
    names = _COLMAP[model]
    if len(words) < 2 or not all(_WHOLE.fullmatch(size) for size in words[:2]):
        raise CameraError(
            f"{path}: width and height must follow the model. Got {shown(' '.join(words))}."
        )
    size = (int(words[0]), int(words[1]))
    try:
        numbers = [float(number.replace("_", "x")) for number in words[2:]]
    except ValueError:
        raise CameraError(
            f"{path}: numbers must follow the model. Got {shown(' '.join(words))}."
        ) from None
    if len(numbers) != len(names):
        raise CameraError(f"{path}: {model} must have {len(names)} parameters. Got {len(numbers)}.")
    check_finite(f"{path}: {model}", numbers, names)
    value = dict(zip(names, numbers, strict=True))
    fx = value.get("fx", value.get("f", 0.0))
    fy = value.get("fy", value.get("f", 0.0))
    matrix = camera_matrix(fx, fy, value["cx"] - 0.5, value["cy"] - 0.5)
    check_pixels(f"{path}: {model}", matrix, size)
    distortion = [value.get(name, 0.0) for name in _COEFFICIENTS] if "k1" in value else None
    if distortion and any(distortion[5:]):
        raise CameraError(
            f"{path}: {model} must have no coefficients beyond k1, k2, p1, p2, k3. "
            f"Got {shown(distortion)}."
        )
    return Calibration(matrix, distortion, size)


# A calibration of ROS, OpenCV, Kalibr or Autoware, by the names of its values; or COLMAP's file.


_KNOWN = (
    "a calibration of ROS, OpenCV, Kalibr or Autoware (YAML, XML, JSON), or COLMAP's cameras.txt"
)
_CAMERA_OF_SEVERAL = re.compile(r"cam\d+")
_MATRIX_NAMES = ("f_x", "skew", "c_x", "K[1, 0]", "f_y", "c_y", "K[2, 0]", "K[2, 1]", "K[2, 2]")
_INTRINSICS_NAMES = ("f_x", "f_y", "c_x", "c_y")
_COEFFICIENT_NAMES = (
    *("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    *("s1", "s2", "s3", "s4", "tau_x", "tau_y"),
)
# how many OpenCV's functions take
_COEFFICIENT_COUNTS = (0, 4, 5, 8, 12, 14)
_ROI_KEYS = ("x_offset", "y_offset", "width", "height", "do_rectify")


def calibrated_fields(path: str | PathLike[str], lens: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a camera of a calibration file; see `Camera.from_calibration`."""
    path = Path(path)
    calibration = read_calibration(path)
    lens = {"name": name_text(path.stem), **lens}
    if calibration.binning[0] > 1 and "pixel_pitch_mm" in lens:
        # the pitch is the sensor's, as its data sheet states it
        pitch = check_positive("pixel_pitch_mm", lens["pixel_pitch_mm"])
        lens["pixel_pitch_mm"] = pitch * calibration.binning[0]
    return opencv_fields(calibration.matrix, calibration.distortion, calibration.image_size, lens)


def read_calibration(path: Path) -> Calibration:
    """Read the camera of a calibration file.

    Parameters
    ----------
    path : pathlib.Path
        The file; its content decides what it is, not its name.

    Returns
    -------
    Calibration
        Of the raw image as the camera delivers it.

    Raises
    ------
    CameraError
        If the file cannot be read, holds several cameras, another lens model, a key that is not
        known, or lacks something.
    """
    text = _text(path)
    if is_colmap(text):
        return read_colmap(path, text)
    tree = tree_of(path, text)
    if not isinstance(tree, dict) or not tree:
        contents = "text that is neither" if text.strip() else "an empty file"
        raise CameraError(f"{path}: camera file must be {_KNOWN}. Got {contents}.")
    return _camera(NamedValues(path, _of_one_camera(path, tree)))


def _of_one_camera(path: Path, tree: dict[str, Any]) -> dict[str, Any]:
    """Return what is said of the camera, in Kalibr's file under the name of the camera."""
    cameras = [key for key in tree if _CAMERA_OF_SEVERAL.fullmatch(key)]
    if not cameras:
        if not any(plain(key) in READ for key in tree):
            keys = shown(", ".join(tree), str)
            raise CameraError(f"{path}: camera file must be {_KNOWN}. Got the keys {keys}.")
        return tree
    if len(cameras) > 1:
        raise CameraError(
            f"{path}: file must hold one camera; leave the one to be read. "
            f"Got {', '.join(cameras)}."
        )
    others = [key for key in tree if key not in cameras]
    if others:
        raise CameraError(
            f"{path}: {shown(others[0], str)} must be a key of such a file. "
            f"Got an unknown key next to {cameras[0]}."
        )
    values = tree[cameras[0]]
    if not isinstance(values, dict):
        raise CameraError(f"{path}: {cameras[0]} must hold keys. Got {shown(values)}.")
    return values


def _camera(values: NamedValues) -> Calibration:
    is_distorted = _check_model(values)
    size = _size(values)
    matrix, key = _matrix(values)
    check_pixels(f"{values.path}: {key}", matrix, size)
    distortion = _distortion(values, is_distorted)
    return _delivered(values, Calibration(matrix, distortion, size))


def _check_model(values: NamedValues) -> bool:
    """Return whether the lens may distort; refuse every model but Brown and Conrady's and none."""
    is_distorted = True
    for key, model in values.entries(FISHEYE):
        if model is not False and model != 0:
            raise values.error(
                key, "must be 0: fisheye lenses are not known here", shown(model, str)
            )
    for key, model in values.entries(DISTORTION_MODEL):
        word = _word(model)
        if word in UNDISTORTED:
            is_distorted = False
        elif word not in BROWN_CONRADY:
            raise values.error(
                key,
                "must be plumb_bob, radtan or none, the model of Brown and Conrady",
                shown(model, str),
            )
    for key, model in values.entries(CAMERA_MODEL):
        if _word(model) not in (*PINHOLE, *BROWN_CONRADY):
            raise values.error(
                key,
                "must be pinhole, or plumb_bob, the model of Brown and Conrady",
                shown(model, str),
            )
    return is_distorted


def _word(model: Any) -> str:
    """Return the plain name of a model; what is no word is no name."""
    if model is None:
        return ""
    return plain(model) if isinstance(model, str) else shown(model)


def _size(values: NamedValues) -> tuple[int, int]:
    key = values.key(SIZE)
    if key is None:
        width = values.needed(WIDTH, "image_width")
        height = values.needed(HEIGHT, "image_height")
        return _pixels(values, *width), _pixels(values, *height)
    for other in (*WIDTH, *HEIGHT):
        if values.key((other,)) is not None:
            raise values.error(key, "must stand alone", f"{other}, too")
    _, pair = values.needed(SIZE, "resolution")
    if not isinstance(pair, list) or len(pair) != 2:
        raise values.error(key, "must be a width and a height", shown(pair))
    return _pixels(values, key, pair[0]), _pixels(values, key, pair[1])


def _pixels(values: NamedValues, key: str, value: Any) -> int:
    number = values.count(key, value)
    if number == 0:
        raise values.error(key, "must be positive", "0")
    return number


def _matrix(values: NamedValues) -> tuple[NDArray[np.float64], str]:
    """Return the camera matrix, of nine numbers or of Kalibr's four, and its key."""
    key = values.key((*CAMERA_MATRIX, *INTRINSICS))
    if key is not None and plain(key) in INTRINSICS:
        _, value = values.needed(INTRINSICS, "intrinsics")
        four = values.numbers(key, value, _INTRINSICS_NAMES)
        if len(four) != 4:
            raise values.error(key, "must be 4 numbers f_x, f_y, c_x, c_y", len(four))
        return camera_matrix(*four), key
    key, value = values.needed(CAMERA_MATRIX, "camera_matrix")
    nine = values.numbers(key, value, _MATRIX_NAMES)
    if len(nine) != 9:
        raise values.error(key, "must be 9 numbers", len(nine))
    fx, skew, cx, below, fy, cy, *last = nine
    if skew or below:
        raise values.error(key, "must have no skew", f"{skew or below:g}")
    # an uncalibrated camera of ROS has nine zeros, which says more than its last row
    if any(nine) and last != [0.0, 0.0, 1.0]:
        raise values.error(key, "must have the last row 0, 0, 1, row by row", shown(last))
    return camera_matrix(fx, fy, cx, cy), key


def _distortion(values: NamedValues, is_distorted: bool) -> list[float] | None:
    if not is_distorted and values.key(DISTORTION) is None:
        return None
    key, value = values.needed(DISTORTION, "distortion_coefficients")
    if value is None or (isinstance(value, dict) and value.get("data", 0) is None):
        value = []
    coefficients = values.numbers(key, value, _COEFFICIENT_NAMES)
    if any(coefficients[5:]):
        raise values.error(
            key, "must have no coefficients beyond k1, k2, p1, p2, k3", shown(coefficients)
        )
    if len(coefficients) not in _COEFFICIENT_COUNTS:
        raise values.error(key, "must be 4 or 5 numbers k1, k2, p1, p2, k3", len(coefficients))
    if any(coefficients) and not is_distorted:
        model = values.key(DISTORTION_MODEL)
        raise values.error(key, f"must be zero where {model} is none", shown(coefficients))
    return coefficients or None


def _delivered(values: NamedValues, full: Calibration) -> Calibration:
    """Return the camera of the delivered image: ROS cuts out the region, then bins its pixels."""
    column, row, width, height = _region(values, full.image_size)
    across = _binning(values, BINNING_X, width)
    down = _binning(values, BINNING_Y, height)
    # the middle of a binned pixel is the middle of its pixels
    matrix = camera_matrix(
        full.matrix[0, 0] / across,
        full.matrix[1, 1] / down,
        (full.matrix[0, 2] - column + 0.5) / across - 0.5,
        (full.matrix[1, 2] - row + 0.5) / down - 0.5,
    )
    size = (width // across, height // down)
    is_whole = (width, height) == full.image_size
    if not is_in_image(matrix, size):
        raise values.error(
            "roi",
            f"must hold the principal point ({full.matrix[0, 2]:g}, {full.matrix[1, 2]:g})",
            f"{width} x {height} pixels at ({column}, {row})",
        )
    if is_whole and (across, down) == (1, 1):
        return full
    return Calibration(matrix, full.distortion, size, (across, down))


def _binning(values: NamedValues, key_of: tuple[str, ...], size: int) -> int:
    """Return how many pixels make one; ROS's 0 is 1."""
    for key, value in values.entries(key_of):
        number = max(values.count(key, value), 1)
        if number > size:
            raise values.error(key, f"must be at most {size}", number)
        return number
    return 1


def _region(values: NamedValues, image_size: tuple[int, int]) -> tuple[int, int, int, int]:
    """Return left, top, width and height of what is delivered; ROS's zeros are the whole image."""
    whole = (0, 0, *image_size)
    for key, roi in values.entries(ROI):
        if roi is None:
            return whole
        if not isinstance(roi, dict):
            raise values.error(key, "must hold keys", shown(roi))
        for name in roi:
            if name not in _ROI_KEYS:
                raise values.error(key, f"must hold {', '.join(_ROI_KEYS)}", shown(name, str))
        column, row, width, height = (
            values.count(f"{name} of {key}", roi.get(name, 0)) for name in _ROI_KEYS[:4]
        )
        if not (column or row or width or height):
            return whole
        is_inside = column + width <= image_size[0] and row + height <= image_size[1]
        if not (width and height and is_inside):
            raise values.error(
                key,
                f"must be in the image of {image_size[0]} x {image_size[1]} pixels",
                f"{width} x {height} at ({column}, {row})",
            )
        return column, row, width, height
    return whole


def _text(path: Path) -> str:
    from aspectgraph.files import read_text

    try:
        # some editors begin a file with a byte order mark
        return read_text(path, "utf-8-sig")
    except OSError as error:
        raise CameraError(f"{path}: camera file cannot be read: {error.strerror}.") from None
    except UnicodeDecodeError:
        raise CameraError(f"{path}: camera file must be UTF-8 text. Got other bytes.") from None
