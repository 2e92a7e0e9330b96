"""Camera poses that exist, from files: plans, OpenCV, ROS, robot programs and tables.

What a file holds is decided by its content. What it leaves open, such as
its unit of length, must be given: nothing is guessed. An error names file, line, field, rule and value.

============= =================================== ================== ==========================
file          what it holds                       pose               length
============= =================================== ================== ==========================
plan          settings of a plan                  camera to part     mm
OpenCV        rvec and tvec, or R and t           part to camera     that of the board: given
ROS           position, orientation (x y z w)     camera to part     metres (REP 103)
robot program stops at which images are taken     joints             by the cell
table         x y z, and qx qy qz qw or rx ry rz  camera to part     in its header, or given
============= =================================== ================== ==========================

The axes of the camera are x right, y down, z forward everywhere: those of OpenCV and of the optical
frame of ROS (REP 103).
"""

from __future__ import annotations

import csv
import json
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from aspectgraph.files import read_text
from ground.notebook import NotebookTable, NotebookView, ShownInNotebook
from ground.short_repr import short_repr
from planner.argument_kinds import shown, suggests_names
from planner.camera.calibration_files import plain, plain_value, tree_of
from planner.camera.pose import GivenPose
from planner.exceptions import CameraError, PoseFileError
from planner.files import name_text
from planner.plan import read_plan
from planner.plan_file import FORMAT as PLAN_FORMAT
from planner.robotprogram.stops import SUFFIXES, is_program, read_stops
from planner.sensor_setting import setting_name
from planner.text_table import count

if TYPE_CHECKING:
    from planner.robotcell import Cell

UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3, "in": 25.4, "inch": 25.4, "ft": 304.8}
"""Units of poses, in mm."""

# a rotation that is written with few digits is put right; one that is farther off is none
_OFF_ROTATION = 1e-3
_OFF_QUATERNION = 1e-2
_FARTHEST_MM = 1e9
_DEEPEST = 40
_FIRST_LINE = re.compile(r"\A%YAML[: ][^\n]*")
_TABS = re.compile(r"^[\t ]+", re.MULTILINE)
_HINT = "give units, such as units='mm'"


@dataclass(frozen=True)
class PoseFile(ShownInNotebook):
    """The camera poses of a file.

    Attributes
    ----------
    poses : tuple of GivenPose
        In the order of the file, with different names.
    source : str
        What the file holds, and how it was understood, in words.
    frame : str
        Name of the frame that the file gives the poses in; empty if it names none.
    light : str
        What kind of light a plan has, see `LightPlan.kind`; empty if it has none.

    Examples
    --------
    >>> from planner import read_poses
    >>> read_poses("examples/two_pocket_block_poses.yaml").frame
    'part'
    """

    poses: tuple[GivenPose, ...]
    source: str
    frame: str = ""
    light: str = ""

    __repr__ = short_repr

    def _notebook_view(self) -> NotebookView:
        rows = []
        for pose in self.poses:
            place = "{:.1f}, {:.1f}, {:.1f}".format(*pose.cam2world[:3, 3])
            axis = "{:.2f}, {:.2f}, {:.2f}".format(*pose.cam2world[:3, 2])
            rows.append((pose.name, place, axis))
        lines = [f"Read as {self.source}."]
        if self.frame:
            lines.append(f"The file gives them in the frame {self.frame}.")
        table = NotebookTable(("pose", "camera at, mm", "looks along"), rows)
        return NotebookView(count(len(self.poses), "pose"), lines, table)


@suggests_names
def read_poses(
    path: str | os.PathLike[str], *, units: str | None = None, cell: Cell | None = None
) -> PoseFile:
    """Read camera poses from a file of another program, or of this one.

    Parameters
    ----------
    path : path
        A plan or its folder. Views of OpenCV's FileStorage (YAML, JSON, XML). Messages of ROS (YAML,
        JSON): Pose, PoseStamped, PoseArray, Path, or several of them. A program that `write_program`
        wrote. A table (CSV) with a header.
    units : str, optional
        Unit of lengths: mm, cm, m, um, in, inch or ft. Default: what the file states. Messages of
        ROS are in metres.
    cell : Cell, optional
        Robot cell of a robot program. It turns the joints of a stop into a pose of the camera.

    Returns
    -------
    PoseFile
        With the poses of the camera in the part's frame.

    Raises
    ------
    PoseFileError
        If the file cannot be read, is none of these, states no unit, or a field breaks its rule.
    PlanFileError
        If it is a plan or a program file that contradicts itself.
    RequestError
        If the unit is not known, or a robot program is given without its cell.

    Examples
    --------
    >>> from planner import read_poses
    >>> of_plan = read_poses("examples/two_pocket_block_plan.json")
    >>> of_plan.poses[0].name, of_plan.source
    ('setting_01', 'settings of a plan')
    """
    path = Path(path)
    if units is not None and units not in UNITS_MM:
        raise PoseFileError.of_rule(
            "units", f"must be one of {', '.join(UNITS_MM)}", shown(units, str)
        )
    if path.is_dir():
        return _of_plan(path)
    text = _text(path)
    suffix = path.suffix.lower()
    data = _as_json(text)
    if isinstance(data, Mapping) and data.get("format") == PLAN_FORMAT:
        return _of_plan(path)
    if suffix in SUFFIXES or is_program(text, data):
        poses = read_stops(path, text, data, cell)
        result = PoseFile(poses, "stops of a robot program, by the kinematics of the cell")
    elif suffix in (".csv", ".tsv", ".txt"):
        result = _of_table(path, text, units)
    else:
        result = _of_tree(path, text, units)
    _check_names(path, result.poses)
    return result


def _of_plan(path: Path) -> PoseFile:
    plan = read_plan(path)
    poses = [GivenPose(setting_name(k), item.cam2world) for k, item in enumerate(plan.settings)]
    if not poses:
        raise PoseFileError(f"{path}: the plan must have a setting. Got none.")
    light = "" if plan.light is None else plan.light.kind
    return PoseFile(tuple(poses), "settings of a plan", "part", light)


def _text(path: Path) -> str:
    try:
        return read_text(path, large=True)
    except OSError as error:
        raise PoseFileError(
            f"{path}: file of poses must be readable. Got: {error.strerror}."
        ) from None
    except UnicodeDecodeError:
        raise PoseFileError(f"{path}: file of poses must be UTF-8 text. Got other bytes.") from None


def _as_json(text: str) -> Any:
    """Return what a text of JSON holds; None if it is none."""
    if not text.lstrip().startswith(("{", "[")):
        return None
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None


def _check_names(path: Path, poses: Sequence[GivenPose]) -> None:
    if not poses:
        raise PoseFileError(f"{path}: file must hold a pose. Got none.")
    names = [pose.name for pose in poses]
    for name in names:
        if names.count(name) > 1:
            raise PoseFileError(f"{path}: names of poses must be different. Got {name!r} twice.")


# A tree of fields, each with its line: YAML and JSON alike, and OpenCV's XML without lines.


@dataclass(frozen=True, eq=False)
class _Field:
    """A value in a file: its path in words, the line, and what it holds."""

    path: Path
    line: int
    name: str
    value: Any

    def refuse(self, rule: str, got: str) -> NoReturn:
        """Raise the error of this field."""
        place = f"{self.path}:{self.line}" if self.line else str(self.path)
        subject = f"{self.name} " if self.name else ""
        raise PoseFileError(f"{place}: {subject}{rule}. Got {got}.")

    def get(self, *names: str) -> _Field | None:
        """Return the field of a mapping by one of its names, without case and underscores; None without it."""
        if not isinstance(self.value, dict):
            return None
        fields = [field for key, field in self.value.items() if plain(key) in names]
        if len(fields) > 1:
            rule = "must be stated once"
            fields[1].refuse(rule, f"also {fields[0].name}")
        return fields[0] if fields else None

    def numbers(self, *counts: int) -> NDArray[np.float64]:
        """Return the numbers of a list, of nested lists, or of a matrix of OpenCV, as one row."""
        data = self.get("data")
        field = self if data is None else data
        values = np.array([item.number() for item in field.leaves()])
        if counts and len(values) not in counts:
            rule = f"must hold {' or '.join(map(str, counts))} numbers"
            field.refuse(rule, str(len(values)))
        return values

    def leaves(self) -> Iterator[_Field]:
        """Yield the fields that are no lists, in their order."""
        if not isinstance(self.value, list):
            yield self
            return
        for item in self.value:
            yield from item.leaves()

    def number(self) -> float:
        """Return a finite number."""
        value = self.value
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.refuse("must be a number", _kind(value))
        if not np.isfinite(value):
            self.refuse("must be finite", f"{value:g}")
        return float(value)

    def word(self) -> str:
        """Return a text; a number is taken as it is written."""
        if isinstance(self.value, dict | list) or self.value is None:
            self.refuse("must be a text", _kind(self.value))
        return str(self.value)


def _kind(value: Any) -> str:
    if isinstance(value, dict):
        names = ", ".join(list(value)[:6])
        return f"a mapping with {names}" if names else "an empty mapping"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    return "nothing" if value is None else shown(value)


def _documents(path: Path, text: str) -> list[_Field]:
    """Return the documents of a file."""
    if text.lstrip().startswith("<"):
        try:
            return [_of_plain(path, "", tree_of(path, text))]
        except CameraError as error:
            raise PoseFileError(str(error).replace("camera file", "file of poses")) from None
    text = _FIRST_LINE.sub("", text)
    if text.lstrip().startswith(("{", "[")):
        # YAML takes no tabs before JSON's keys
        text = _TABS.sub(lambda match: " " * len(match[0]), text)
    try:
        nodes = [
            node for node in yaml.compose_all(text, Loader=yaml.SafeLoader) if node is not None
        ]
        fields = [_of_node(path, "", node, 0) for node in nodes]
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f":{mark.line + 1}" if mark is not None else ""
        reason = getattr(error, "problem", None) or "it cannot be parsed"
        raise PoseFileError(
            f"{path}{line}: file of poses must be YAML, JSON, XML of OpenCV, CSV, or a robot program. "
            f"Got: {shown(reason, str)}."
        ) from None
    except RecursionError:
        raise PoseFileError(
            f"{path}: file of poses must not nest so deep. Got more levels."
        ) from None
    # what follows a last `---` holds nothing
    return [field for field in fields if field.value is not None]


def _of_node(path: Path, name: str, node: Any, depth: int) -> _Field:
    line = node.start_mark.line + 1
    if depth > _DEEPEST:
        raise RecursionError
    if isinstance(node, yaml.MappingNode):
        fields: dict[str, _Field] = {}
        for key_node, value_node in node.value:
            key = str(key_node.value)
            inner = f"{name}.{key}" if name else key
            field = _of_node(path, inner, value_node, depth + 1)
            if key in fields:
                field.refuse("must stand once", "it twice")
            fields[key] = field
        return _Field(path, line, name, fields)
    if isinstance(node, yaml.SequenceNode):
        items = [
            _of_node(path, f"{name}[{k}]", item, depth + 1) for k, item in enumerate(node.value)
        ]
        return _Field(path, line, name, items)
    return _Field(path, line, name, node.value if node.style else plain_value(node.value))


def _of_plain(path: Path, name: str, value: Any) -> _Field:
    if isinstance(value, dict):
        inner = {
            key: _of_plain(path, f"{name}.{key}" if name else key, item)
            for key, item in value.items()
        }
        return _Field(path, 0, name, inner)
    if isinstance(value, list):
        items = [_of_plain(path, f"{name}[{k}]", item) for k, item in enumerate(value)]
        return _Field(path, 0, name, items)
    return _Field(path, 0, name, value)


# Views of OpenCV and messages of ROS.


_LISTS = ("poses", "settings", "views", "frames", "images")
_RVEC = ("rvec", "rotationvector", "rotvec")
_MATRIX = ("r", "rotationmatrix", "rmat")
_TVEC = ("tvec", "translationvector", "transvec", "t")
_NAMES = ("name", "image", "imagename", "filename", "file")
_NUMBERED = re.compile(r"(rvec|tvec)[_\s-]*0*(\d+)", re.IGNORECASE)
_UNIT_NAMES = ("unit", "units", "lengthunit", "lengthunits")


def _of_tree(path: Path, text: str, units: str | None) -> PoseFile:
    documents = _documents(path, text)
    if not documents:
        raise PoseFileError(f"{path}: file must hold a pose. Got none.")
    first = documents[0]
    views = _whole_views(first) if len(documents) == 1 else None
    if views is None:
        items = list(_items(documents))
        if items and _is_view(items[0]):
            views = [_view(item, k) for k, item in enumerate(items)]
        else:
            return _of_messages(path, documents, items, units)
    scale, words = _unit_of_views(first, units)
    poses = tuple(
        GivenPose(view.name, _inverse(view.field, view.rotation, scale * view.translation))
        for view in views
    )
    return PoseFile(poses, f"views of OpenCV, part to camera, {words}")


@dataclass(frozen=True, eq=False)
class _View:
    """A view of OpenCV: x_cam = R x_part + t."""

    name: str
    field: _Field
    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]


def _items(documents: Sequence[_Field]) -> Iterator[_Field]:
    """Yield the fields that hold a pose each."""
    for document in documents:
        inside = next(
            (
                field
                for name in _LISTS
                if (field := document.get(name)) is not None and isinstance(field.value, list)
            ),
            document,
        )
        if isinstance(inside.value, list):
            yield from inside.value
        else:
            yield inside


def _is_view(field: _Field) -> bool:
    return any(field.get(*names) is not None for names in (_RVEC, _MATRIX, _TVEC))


def _whole_views(root: _Field) -> list[_View] | None:
    """Return the views of a file that holds all of them in one or two matrices, or numbered; None if it does not."""
    six = root.get("extrinsicparameters", "extrinsics")
    if six is not None:
        rows = six.numbers()
        if len(rows) == 0 or len(rows) % 6:
            six.refuse("must hold six numbers for each view, rvec and tvec", str(len(rows)))
        return _views_of(six, rows.reshape(-1, 6)[:, :3], rows.reshape(-1, 6)[:, 3:])
    turns = root.get("rvecs", "rotationvectors")
    shifts = root.get("tvecs", "translationvectors")
    if turns is not None or shifts is not None:
        if turns is None or shifts is None:
            root.refuse("must hold rvecs and tvecs", _kind(root.value))
        return _views_of(turns, _triples(turns), _triples(shifts))
    if not isinstance(root.value, dict):
        return None
    numbered: dict[int, dict[str, _Field]] = {}
    for key, field in root.value.items():
        if match := _NUMBERED.fullmatch(key):
            numbered.setdefault(int(match[2]), {})[match[1].lower()] = field
    views = []
    for number, pair in sorted(numbered.items()):
        for missing in {"rvec", "tvec"} - set(pair):
            next(iter(pair.values())).refuse(f"must stand with {missing}_{number}", "it alone")
        turn = Rotation.from_rotvec(pair["rvec"].numbers(3)).as_matrix()
        name = f"pose_{number:02d}"
        views.append(_View(name, pair["rvec"], turn, pair["tvec"].numbers(3)))
    return views or None


def _triples(field: _Field) -> NDArray[np.float64]:
    """Return rows of three: of a matrix (n, 3), of one (n, 1) with three channels, or of matrices (3, 1)."""
    if isinstance(field.value, list):
        return np.array([item.numbers(3) for item in field.value]).reshape(-1, 3)
    values = field.numbers()
    if len(values) == 0 or len(values) % 3:
        field.refuse("must hold three numbers for each view", str(len(values)))
    return values.reshape(-1, 3)


def _views_of(
    field: _Field, turns: NDArray[np.float64], shifts: NDArray[np.float64]
) -> list[_View]:
    if len(turns) != len(shifts):
        field.refuse(
            "must have as many rows as the translations", f"{len(turns)} and {len(shifts)}"
        )
    rotations = Rotation.from_rotvec(turns).as_matrix()
    return [
        _View(f"pose_{k + 1:02d}", field, rotation, shift)
        for k, (rotation, shift) in enumerate(zip(rotations, shifts, strict=True))
    ]


def _view(field: _Field, k: int) -> _View:
    """Return the view that a mapping of rvec and tvec, or of R and t, holds."""
    shift = field.get(*_TVEC)
    matrix = field.get(*_MATRIX)
    vector = field.get(*_RVEC)
    if shift is None or (matrix is None and vector is None):
        field.refuse("must hold rvec and tvec", _kind(field.value))
    if vector is not None:
        rotation = Rotation.from_rotvec(vector.numbers(3)).as_matrix()
        if matrix is not None:
            stated = matrix.numbers(9).reshape(3, 3)
            if np.abs(stated - rotation).max() > _OFF_ROTATION:
                matrix.refuse("must be the rotation of rvec", "another one")
            # a matrix holds all digits
            rotation = stated
    else:
        assert matrix is not None
        values = matrix.numbers(9, 3)
        small = len(values) == 3
        rotation = Rotation.from_rotvec(values).as_matrix() if small else values.reshape(3, 3)
    return _View(_name_of(field, k), field, rotation, shift.numbers(3))


def _name_of(field: _Field, k: int) -> str:
    name = field.get(*_NAMES)
    if name is None:
        return f"pose_{k + 1:02d}"
    # names of images are known without their suffix
    return name_text(re.sub(r"\.(png|jpe?g|tiff?|bmp|npy)\Z", "", name.word(), flags=re.IGNORECASE))


def _unit_of_views(root: _Field, units: str | None) -> tuple[float, str]:
    """Return the unit of a file of views in mm, and how it is known."""
    stated = root.get(*_UNIT_NAMES)
    convention = root.get("convention")
    word = None
    if stated is not None:
        word = _unit(stated, stated.word())
    elif convention is not None and "millimetres" in convention.word():
        word = "mm"
    if word is None and units is None:
        rule = "must state the unit of its lengths, because OpenCV takes that of the board"
        raise PoseFileError.of_rule(f"{root.path}: file", rule, "none", hint=_HINT)
    if word is not None and units is not None and UNITS_MM[word] != UNITS_MM[units]:
        rule = f"must be {word}, as the file states"
        raise PoseFileError.of_rule("units", rule, units)
    unit = word or units
    assert unit is not None
    return UNITS_MM[unit], f"{unit}, {'as stated' if word else 'as given'}"


def _unit(field: _Field, word: str) -> str:
    names = {"millimetre": "mm", "millimeter": "mm", "metre": "m", "meter": "m", "inches": "in"}
    unit = word.strip().lower()
    unit = names.get(unit.removesuffix("s"), names.get(unit, unit))
    if unit not in UNITS_MM:
        field.refuse(f"must be one of {', '.join(UNITS_MM)}", shown(word, str))
    return unit


def _of_messages(
    path: Path, documents: Sequence[_Field], items: Sequence[_Field], units: str | None
) -> PoseFile:
    """Return the poses of messages of ROS."""
    scale = UNITS_MM[units or "m"]
    frames: dict[str, _Field] = {}
    poses = []
    for field in (*documents, *items):
        header = field.get("header")
        frame = None if header is None else header.get("frameid")
        if frame is not None and str(frame.value or ""):
            frames.setdefault(frame.word(), frame)
    for k, item in enumerate(items):
        message = item
        # PoseStamped, and with a covariance once more
        while (inner := message.get("pose")) is not None:
            message = inner
        place = message.get("position")
        turn = message.get("orientation")
        if place is None or turn is None:
            rule = "must hold position and orientation, or rvec and tvec"
            message.refuse(rule, _kind(message.value))
        poses.append(GivenPose(_name_of(item, k), _from_message(place, turn, scale)))
    if len(frames) > 1:
        first, second = list(frames.values())[:2]
        second.refuse(f"must be that of all poses, {first.value!r}", repr(second.value))
    lengths = f"{units}, as given" if units else "metres (REP 103)"
    frame_name = next(iter(frames), "")
    return PoseFile(
        tuple(poses), f"poses of ROS, optical frame (z forward) to part, {lengths}", frame_name
    )


def _from_message(place: _Field, turn: _Field, scale: float) -> NDArray[np.float64]:
    parts = []
    for field, names in ((place, "xyz"), (turn, "xyzw")):
        for name in names:
            number = field.get(name)
            if number is None:
                field.refuse(f"must hold {', '.join(names)}", _kind(field.value))
            parts.append(number.number())
    return _pose(turn.refuse, np.array(parts[3:]), scale * np.array(parts[:3]))


_Refuse = Callable[[str, str], NoReturn]


def _pose(
    refuse: _Refuse, quaternion: NDArray[np.float64], position: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return a pose (4, 4) from a quaternion x y z w and a position, mm."""
    norm = float(np.linalg.norm(quaternion))
    if abs(norm - 1.0) > _OFF_QUATERNION:
        refuse("must have the length 1, in the order x y z w", f"{norm:.4g}")
    cam2world = np.eye(4)
    cam2world[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    cam2world[:3, 3] = position
    return _near(refuse, cam2world)


def _inverse(
    field: _Field, rotation: NDArray[np.float64], shift: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return camera to part (4, 4) from x_cam = R x_part + t."""
    off = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if off > _OFF_ROTATION or np.linalg.det(rotation) < 0:
        field.refuse("must hold a rotation", f"a matrix that is off one by {off:.2g}")
    first, _, last = np.linalg.svd(rotation)
    exact = rotation if off < 1e-12 else first @ last
    cam2world = np.eye(4)
    cam2world[:3, :3] = exact.T
    cam2world[:3, 3] = -exact.T @ shift
    return _near(field.refuse, cam2world)


def _near(refuse: _Refuse, cam2world: NDArray[np.float64]) -> NDArray[np.float64]:
    farthest = float(np.abs(cam2world[:3, 3]).max())
    if not farthest <= _FARTHEST_MM:
        refuse(f"must be within {_FARTHEST_MM:g} mm", f"{farthest:g} mm")
    return cam2world


# Tables: a header that names the columns, and a pose in each row.


_COLUMN = re.compile(
    r"(?P<name>.*?)[\s_]*[\[(]?(?P<unit>mm|cm|m|um|in|inch|ft|deg|degrees|rad)?[\])]?",
    re.IGNORECASE,
)
_AXES = {
    **{prefix + axis: axis for axis in "xyz" for prefix in ("", "t", "p", "pos", "position")},
    **{prefix + axis: "q" + axis for axis in "xyzw" for prefix in ("q", "quat", "orientation")},
    **{prefix + axis: "r" + axis for axis in "xyz" for prefix in ("r", "rvec", "rotvec")},
}
_PLACE = ("x", "y", "z")
_QUATERNION = ("qx", "qy", "qz", "qw")
_VECTOR = ("rx", "ry", "rz")
_ROW_NAMES = ("name", "pose", "image", "setting", "id")
_STATED = re.compile(r"\b(?:units?|lengths?)\b\W*(?:are|is|in)?\W*(mm|cm|um|inch|in|ft|m)\b", re.I)
# the columns by which a table of measurements of a plan is known; it states mm and degrees
_OF_MEASUREMENTS = ("permitted_error_px", "search_window_px")


@dataclass(frozen=True)
class _Columns:
    """Where a table has what, and in which units."""

    at: Mapping[str, int]
    name: int | None
    scale: float
    angle: float
    words: str
    of_plan: bool


def _of_table(path: Path, text: str, units: str | None) -> PoseFile:
    lines = [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip()]
    comments = [line for _, line in lines if line.lstrip().startswith("#")]
    rows = [(k, line) for k, line in lines if not line.lstrip().startswith("#")]
    heading = _heading(path, rows, lines)
    delimiter = _delimiter(heading[1])
    cells = _cells(heading[1].lstrip("# "), delimiter)
    columns = _columns(path, heading[0], cells, comments, units)
    poses: dict[str, GivenPose] = {}
    for line, row in rows:
        if line <= heading[0]:
            continue
        values = _cells(row, delimiter)
        if len(values) != len(cells):
            _refuse(path, line, "row", f"must have {len(cells)} cells", str(len(values)))
        pose = _of_row(path, line, values, columns, len(poses))
        if pose is None:
            continue
        # a plan's table has a row for each target of a setting
        before = poses.get(pose.name)
        if before is not None and not (
            columns.of_plan and np.array_equal(before.cam2world, pose.cam2world)
        ):
            _refuse(path, line, "name", "must be different in each row", repr(pose.name))
        poses[pose.name] = pose
    return PoseFile(tuple(poses.values()), f"table of poses, camera to part, {columns.words}")


def _heading(
    path: Path, rows: Sequence[tuple[int, str]], lines: Sequence[tuple[int, str]]
) -> tuple[int, str]:
    """Return the line that names the columns: the first one, or a comment just before the numbers."""
    for line, text in lines:
        is_comment = text.lstrip().startswith("#")
        cells = _cells(text.lstrip("# "), _delimiter(text))
        axes = {axis for cell in cells if (axis := _axis(cell)[0])}
        if set(_PLACE) <= axes:
            return line, text
        if not is_comment:
            break
    line, text = rows[0] if rows else (1, "")
    rule = "must be a header with x, y, z, and qx, qy, qz, qw or rx, ry, rz"
    _refuse(path, line, "first row", rule, shown(text[:60], str))


def _delimiter(line: str) -> str:
    return next((sign for sign in (";", "\t", ",") if sign in line), " ")


def _cells(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]


def _axis(cell: str) -> tuple[str, str]:
    """Return which number a column holds, and the unit in its title; empty where there is none."""
    # rostopic writes field.pose.position.x
    short = re.sub(r".*\b(position|orientation)\.", r"\1", cell.strip().lower())
    match = _COLUMN.fullmatch(short)
    if plain(short) in _AXES or match is None:
        return _AXES.get(plain(short), ""), ""
    return _AXES.get(plain(match["name"]), ""), (match["unit"] or "").lower()


def _columns(
    path: Path, line: int, cells: Sequence[str], comments: Sequence[str], units: str | None
) -> _Columns:
    at: dict[str, int] = {}
    stated: dict[str, str] = {}
    for k, cell in enumerate(cells):
        axis, unit = _axis(cell)
        if axis:
            if axis in at:
                _refuse(path, line, "header", "must name each number once", f"{axis} twice")
            at[axis] = k
            stated[axis] = unit
    has_turn = [set(names) <= set(at) for names in (_QUATERNION, _VECTOR)]
    if sum(has_turn) != 1:
        got = "both" if all(has_turn) else ", ".join(cells)
        _refuse(path, line, "header", "must name qx, qy, qz, qw, or rx, ry, rz", got)
    of_plan = set(_OF_MEASUREMENTS) <= set(cells)
    lengths = {stated[axis] for axis in _PLACE}
    angles = {stated[axis] for axis in _VECTOR if axis in at}
    if len(lengths) > 1 or len(angles) > 1:
        _refuse(path, line, "header", "must state one unit for x, y, z", ", ".join(cells))
    (word,) = lengths
    if of_plan:
        word = "mm"
        angles = {"deg"}
    elif not word:
        word = next((m[1].lower() for comment in comments if (m := _STATED.search(comment))), "")
    if word and units and UNITS_MM.get(word) != UNITS_MM[units]:
        raise PoseFileError.of_rule("units", f"must be {word}, as the file states", units)
    unit = word or units or ""
    if not unit or unit not in UNITS_MM:
        place = f"{path}:{line}: header"
        rule = "must state the unit of x, y, z, such as x_mm"
        raise PoseFileError.of_rule(place, rule, ", ".join(cells), hint=_HINT)
    angle = 1.0
    if angles:
        (turn,) = angles
        if not turn.startswith(("deg", "rad")):
            rule = "must state the unit of rx, ry, rz, such as rx_deg or rx_rad"
            _refuse(path, line, "header", rule, ", ".join(cells))
        angle = np.pi / 180.0 if turn.startswith("deg") else 1.0
    by_name = {plain(cell): k for k, cell in enumerate(cells)}
    usual = ("setting",) if of_plan else _ROW_NAMES
    name = next((by_name[word] for word in usual if word in by_name), None)
    words = f"{unit}, {'as stated' if word else 'as given'}"
    return _Columns(at, name, UNITS_MM[unit], float(angle), words, of_plan)


def _of_row(
    path: Path, line: int, values: Sequence[str], columns: _Columns, k: int
) -> GivenPose | None:
    """Return the pose of a row; None of a target that a plan does not inspect."""
    name = f"pose_{k + 1:02d}"
    if columns.name is not None:
        name = values[columns.name]
        if not name and columns.of_plan:
            return None
        if not name:
            _refuse(path, line, "name", "must not be empty", "nothing")
        if columns.of_plan:
            name = setting_name(int(float(name)) - 1)

    def number(axis: str) -> float:
        text = values[columns.at[axis]]
        value = plain_value(text)
        if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
            _refuse(path, line, axis, "must be a finite number", shown(text, str))
        return float(value)

    def refuse(rule: str, got: str) -> NoReturn:
        _refuse(path, line, "rotation", rule, got)

    place = columns.scale * np.array([number(axis) for axis in _PLACE])
    if "qx" in columns.at:
        quaternion = np.array([number(axis) for axis in _QUATERNION])
    else:
        vector = columns.angle * np.array([number(axis) for axis in _VECTOR])
        quaternion = Rotation.from_rotvec(vector).as_quat()
    return GivenPose(name, _pose(refuse, quaternion, place))


def _refuse(path: Path, line: int, field: str, rule: str, got: str) -> NoReturn:
    raise PoseFileError(f"{path}:{line}: {field} {rule}. Got {got}.")
