"""URDF files: the chain from the base link to the tip, and what is fixed to each of its links.

A URDF is in metres; what comes out is in millimetres. Collision geometry is read, or the visual one where a link has
no other. Joints off the chain, such as those of a gripper, stand at zero.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np

from ground.convert import from_plain
from planner.argument_kinds import shown
from planner.exceptions import RobotError

# Products of poses, summed in one order everywhere: what BLAS adds up differs between its
# versions.


_ROTATION = 2e-6
"""Rounding a rotation to 6 decimals changes R·Rᵀ by at most 5e-7 · 2√3 = 1.74e-6."""
_POLAR = 2
_NO_NOISE = 1e-14


def compose(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the poses (..., 4, 4) first · second; shapes broadcast."""
    return np.einsum("...ij,...jk->...ik", first, second)


def invert(pose: np.ndarray) -> np.ndarray:
    """Return the inverses of poses (..., 4, 4)."""
    result = np.zeros_like(pose)
    turned = np.swapaxes(pose[..., :3, :3], -1, -2)
    result[..., :3, :3] = turned
    result[..., :3, 3] = -np.einsum("...ij,...j->...i", turned, pose[..., :3, 3])
    result[..., 3, 3] = 1.0
    return result


def carry(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return points (m, 3) moved by poses (..., 4, 4); (..., m, 3)."""
    return np.einsum("...ij,mj->...mi", pose[..., :3, :3], points) + pose[..., None, :3, 3]


def from_rpy(xyz: np.ndarray, rpy: np.ndarray) -> np.ndarray:
    """Return a pose (4, 4) of URDF's numbers: turned about fixed x, then y, then z, then shifted."""
    roll, pitch, yaw = (float(angle) for angle in rpy)
    cr = np.cos(roll)
    sr = np.sin(roll)
    cp = np.cos(pitch)
    sp = np.sin(pitch)
    cy = np.cos(yaw)
    sy = np.sin(yaw)
    pose = np.eye(4)
    pose[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    pose[:3, 3] = xyz
    return pose


def to_axis(axis: np.ndarray) -> np.ndarray:
    """Return a pose (4, 4) without shift whose z axis is a unit vector; the identity for z itself."""
    pose = np.eye(4)
    if np.array_equal(axis, (0.0, 0.0, 1.0)):
        return pose
    side = np.zeros(3)
    side[int(np.abs(axis).argmin())] = 1.0
    across = np.cross(side, axis)
    across /= np.sqrt((across**2).sum())
    pose[:3, 0] = across
    pose[:3, 1] = np.cross(axis, across)
    pose[:3, 2] = axis
    return pose


def about(axis: np.ndarray, angle: float) -> np.ndarray:
    """Return the rotation (3, 3) about a unit vector, by the formula of Rodrigues."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return (
        np.eye(3)
        + np.sin(angle) * cross
        + (1 - np.cos(angle)) * np.einsum("ij,jk->ik", cross, cross)
    )


def check_rotations(name: str, value: np.ndarray) -> np.ndarray:
    """Return poses (..., 4, 4) with the rotations nearest to theirs; those without noise stay as they are.

    The polar factor by the iteration X (3 - XᵀX) / 2 of Björck and Bowie (1971): an error e becomes 3/4 e².

    Raises
    ------
    RobotError
        A rotation is none to 6 decimals.
    """
    poses = np.array(value, dtype=np.float64)
    turns = poses[..., :3, :3]
    noise = np.abs(np.einsum("...ij,...kj->...ik", turns, turns) - np.eye(3)).max(axis=(-2, -1))
    if not (noise <= _ROTATION).all():
        wrong = turns[~(noise <= _ROTATION)][0]
        hint = "give 6 decimals, or divide the columns by the scale"
        raise RobotError.of_rule(name, "must hold a rotation", shown(wrong.tolist()), hint=hint)
    is_noisy = noise > _NO_NOISE
    noisy = turns[is_noisy]
    for _ in range(_POLAR):
        square = np.einsum("nji,njk->nik", noisy, noisy)
        noisy = 1.5 * noisy - 0.5 * np.einsum("nij,njk->nik", noisy, square)
    turns[is_noisy] = noisy
    return poses


def check_pose(name: str, value: Any) -> np.ndarray:
    """Return a pose (4, 4) with the nearest rotation, or raise `RobotError` if it is no rigid motion.

    A rotation is one to 6 decimals. What is left of its digits' noise is taken out.

    Raises
    ------
    RobotError
        Shape, a number that is not finite, the last row, a mirror image or a rotation that is none.
    """
    try:
        pose = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        pose = np.empty(0)
    if pose.shape != (4, 4):
        got = str(pose.shape) if pose.size else shown(value)
        raise RobotError.of_rule(name, "must have shape (4, 4)", got)
    if not np.isfinite(pose).all():
        raise RobotError.of_rule(name, "must hold finite numbers", shown(pose.tolist()))
    if not np.array_equal(pose[3], (0.0, 0.0, 0.0, 1.0)):
        raise RobotError.of_rule(name, "must have the last row 0 0 0 1", shown(pose[3].tolist()))
    pose = check_rotations(name, pose)
    turn = pose[:3, :3]
    handed = float(np.einsum("i,i->", np.cross(turn[0], turn[1]), turn[2]))
    if handed < 0:
        hint = "an axis points the wrong way"
        raise RobotError.of_rule(
            name, "must have a determinant of 1, not a mirror image", "-1", hint=hint
        )
    pose.flags.writeable = False
    return pose


_MM = 1000.0
_TURNS = ("revolute", "continuous")
_LONGEST_M = 50.0
# no joint of an arm turns by more than 6 turns, and of limits in degrees at least one is larger
_MOST_TURNED_RAD = 40.0
_SPEEDS_HINT = "a cell file states it in [robot] as speeds, in rad/s: one number, or one a joint"
JOINT_COUNTS = (6, 7)
"""Joints that an arm may have."""

PENDANT = "base"
"""Link in whose frame a controller counts poses, by the convention of ROS-Industrial."""


@dataclass(frozen=True)
class LinkShape:
    """Geometry that is fixed to a segment.

    Attributes
    ----------
    kind : {"mesh", "box", "cylinder", "sphere"}
        What it is.
    size : tuple of float
        Scale of a mesh with mm for its unit (3,); edges of a box (3,); radius and length of a cylinder; radius; mm.
    pose : array (4, 4)
        Its frame in that of the segment.
    file : str
        The mesh as the URDF names it.
    """

    kind: str
    size: tuple[float, ...]
    pose: np.ndarray
    file: str = ""


@dataclass(frozen=True)
class UrdfJoint:
    """A turning joint of the chain, in rad and seconds.

    Attributes
    ----------
    name : str
        Its name.
    origin : array (4, 4)
        Its frame in that of the link before it, fixed joints in between included.
    axis : array (3,)
        Unit vector in its own frame.
    lower, upper, speed : float
        Limits.
    """

    name: str
    origin: np.ndarray
    axis: np.ndarray
    lower: float
    upper: float
    speed: float


@dataclass(frozen=True)
class UrdfArm:
    """A serial arm as a file describes it.

    Attributes
    ----------
    name : str
        Name of the robot.
    joints : tuple of UrdfJoint
        Six or seven, from the base to the tip.
    tip : array (4, 4)
        Frame of the tip in that of the last joint.
    segments : tuple of str
        Names of the base link and of the links behind the joints.
    shapes : tuple of tuple of LinkShape
        What is fixed to each segment.
    notes : tuple of str
        What of the file does not count, in words.
    pendant : array (4, 4) or None
        Frame of the link ``base`` in that of the base link, mm: where a controller counts poses from. None without it.
    """

    name: str
    joints: tuple[UrdfJoint, ...]
    tip: np.ndarray
    segments: tuple[str, ...]
    shapes: tuple[tuple[LinkShape, ...], ...]
    notes: tuple[str, ...] = ()
    pendant: np.ndarray | None = None


class _Tree:
    """Links and joints of a file by name."""

    def __init__(self, root: ElementTree.Element) -> None:
        self.name = root.get("name", "")
        for kind in ("link", "joint"):
            _check_distinct(kind, [_name(element) for element in root.findall(kind)])
        self.links = {_name(link): link for link in root.findall("link")}
        self.above: dict[str, ElementTree.Element] = {}
        self.below: dict[str, list[ElementTree.Element]] = {}
        for joint in root.findall("joint"):
            parent, child = (_end(joint, which) for which in ("parent", "child"))
            for link in (parent, child):
                if link not in self.links:
                    rule = f"must name links of the file in joint {_name(joint)!r}"
                    raise RobotError.of_rule("urdf", rule, repr(link))
            if child in self.above:
                raise RobotError.of_rule(
                    "urdf", "must hang every link on one joint", f"two for {child!r}"
                )
            self.above[child] = joint
            self.below.setdefault(parent, []).append(joint)
        self._check_root()

    def _check_root(self) -> None:
        """Raise if links hang on nothing: they would be left out."""
        roots = [link for link in self.links if link not in self.above]
        if len(roots) > 1:
            names = " and ".join(map(repr, roots))
            raise RobotError.of_rule(
                "urdf", "must have one link that hangs on no joint", f"{len(roots)}: {names}"
            )

    def check_mimics(self, chain: Iterable[ElementTree.Element]) -> None:
        """Raise if a joint follows another one in a way that is not modelled.

        Joints off the chain stand at zero. So one that follows such a joint without an offset does, too.
        """
        on_chain = {_name(joint) for joint in chain}
        for joint in (joint for joints in self.below.values() for joint in joints):
            mimic = joint.find("mimic")
            if mimic is None:
                continue
            name = _name(joint)
            followed = mimic.get("joint", "")
            offset = _numbers(mimic.get("offset", "0"), 1, f"offset of joint {name!r}")[0]
            if name in on_chain or followed in on_chain or offset != 0:
                raise RobotError.of_rule(
                    "urdf",
                    "must have joints that move by themselves",
                    f"mimic: joint {name!r} follows {followed!r}",
                )

    def joints_to(self, tip: str) -> list[ElementTree.Element]:
        """Return the joints from the root to a link."""
        chain: list[ElementTree.Element] = []
        link = tip
        while link in self.above:
            if len(chain) > len(self.above):
                raise RobotError.of_rule("urdf", "must not close a circle of joints", repr(tip))
            chain.append(self.above[link])
            link = _end(chain[-1], "parent")
        return chain[::-1]


def _check_distinct(kind: str, names: list[str]) -> None:
    """Raise if two elements have one name: one of them would be left out."""
    for name in names:
        if names.count(name) > 1:
            rule = f"must give every {kind} a name of its own"
            raise RobotError.of_rule("urdf", rule, f"{names.count(name)} called {name!r}")


def read_urdf(
    text: str, tip: str, base: str | None = None, speeds: Sequence[float] | np.ndarray | None = None
) -> UrdfArm:
    """Return the arm that a URDF describes.

    Parameters
    ----------
    text : str
        The file.
    tip : str
        Link the camera is fixed to.
    base : str, optional
        Link whose frame is the robot's base. Default: ``base_link`` where there is one, otherwise the first link.
    speeds : array (), (6,) or (7,), optional
        Largest speeds of the joints, rad/s. Default: those of the file.

    Raises
    ------
    RobotError
        The text is no URDF, a link is missing, or the chain is no arm of six or seven turning joints with limits and
        speeds.
    """
    tree = _Tree(_root(text))
    for parameter, link in (("tip", tip), ("base", base)):
        if link is not None and link not in tree.links:
            raise RobotError.of_rule(
                parameter, "must be a link of the robot", repr(link), hint=_listed(tree.links)
            )
    chain = tree.joints_to(tip)
    moving = [joint for joint in chain if joint.get("type") != "fixed"]
    _check_moving(moving, tip)
    tree.check_mimics(chain)
    rates = None if speeds is None else rate_of_each("speeds", np.asarray(speeds), len(moving))
    links = _bodies(tree, chain, moving)
    base = _base(base, tree, links[0])
    links[0] = _seen_from(links[0], base)
    joints = []
    for number, (before, joint) in enumerate(zip(links, moving, strict=False)):
        origin = compose(before[_end(joint, "parent")], _origin(joint))
        joints.append(_moving_joint(joint, origin, None if rates is None else rates[number]))
    _check_size(joints, links[-1][tip])
    notes: list[str] = []
    shapes = tuple(
        tuple(
            shape for link, pose in body.items() for shape in _shapes(tree.links[link], pose, notes)
        )
        for body in links
    )
    segments = (base, *(_end(joint, "child") for joint in moving))
    pendant = links[0].get(PENDANT)
    return UrdfArm(
        tree.name, tuple(joints), links[-1][tip], segments, shapes, tuple(notes), pendant
    )


def _bodies(
    tree: _Tree, chain: list[ElementTree.Element], moving: list[ElementTree.Element]
) -> list[dict[str, np.ndarray]]:
    """Return what moves as one with the first link and with each moving joint: poses (4, 4) by link."""
    starts = [_end(chain[0], "parent"), *(_end(joint, "child") for joint in moving)]
    bodies = []
    for start in starts:
        body = {start: np.eye(4)}
        open_links = [start]
        while open_links:
            link = open_links.pop()
            for joint in tree.below.get(link, ()):
                if joint not in moving:
                    child = _end(joint, "child")
                    body[child] = compose(body[link], _origin(joint))
                    open_links.append(child)
        bodies.append(body)
    return bodies


def _base(base: str | None, tree: _Tree, fixed: Mapping[str, np.ndarray]) -> str:
    """Return the base link; it must not move."""
    if base is None:
        return "base_link" if "base_link" in fixed else next(iter(fixed))
    if base not in fixed:
        raise RobotError.of_rule(
            "base", "must be a link before the first joint", repr(base), hint=_listed(fixed)
        )
    return base


def _seen_from(body: Mapping[str, np.ndarray], link: str) -> dict[str, np.ndarray]:
    """Return poses in the frame of one of the links."""
    inverse = invert(body[link])
    return {name: compose(inverse, pose) for name, pose in body.items()}


def _root(text: str) -> ElementTree.Element:
    """Return the element of the robot."""
    _check_plain_xml(text)
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise RobotError.of_rule("urdf", "must be XML", str(error)) from None
    # http://www.ros.org/wiki/xacro and others
    spaces = [
        element for element in root.iter() if re.match(r"\{[^}]*ros\.org[^}]*\}", str(element.tag))
    ]
    if spaces or any(map(_is_unexpanded, (*root.iter("link"), *root.iter("joint")))):
        hint = "xacrodoc writes the URDF of a xacro: xacrodoc robot.urdf.xacro -o robot.urdf"
        raise RobotError.of_rule("urdf", "must be expanded", "a xacro file", hint=hint)
    if root.tag != "robot":
        raise RobotError.of_rule("urdf", "must hold the element robot", shown(root.tag))
    return root


def _check_plain_xml(text: str | bytes) -> None:
    """Raise at a DOCTYPE, before any entity is read; one within a comment is none."""

    def refuse(*_: object) -> None:
        raise RobotError.of_rule("urdf", "must hold no DOCTYPE and no entities", "one")

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        raise RobotError.of_rule("urdf", "must be XML", str(error)) from None


def _is_unexpanded(element: ElementTree.Element) -> bool:
    """Return whether a link or a joint holds what xacro would replace."""
    texts = [word for part in element.iter() for word in (*part.attrib.values(), part.text or "")]
    return any("${" in word or "$(" in word for word in texts)


def _check_moving(moving: list[ElementTree.Element], tip: str) -> None:
    """Raise unless the chain has six or seven turning joints."""
    for number, joint in enumerate(moving, start=1):
        kind = joint.get("type")
        if kind not in _TURNS:
            raise RobotError.of_rule(
                "urdf", f"must turn in every joint to {tip!r}", f"{kind} for joint {number}"
            )
    if len(moving) not in JOINT_COUNTS:
        rule = f"must have six or seven joints between base and {tip!r}"
        names = ", ".join(map(_name, moving))
        raise RobotError.of_rule("urdf", rule, f"{len(moving)}: {names}")


def rate_of_each(name: str, values: np.ndarray, count: int) -> np.ndarray:
    """Return one number for each joint (k,), of a single number or of as many as there are joints."""
    if values.shape not in ((), (count,)):
        rule = f"must be one number, or one for each of the {count} joints"
        raise RobotError.of_rule(name, rule, f"{len(values)}")
    return np.array(np.broadcast_to(values, count))


def _moving_joint(joint: ElementTree.Element, origin: np.ndarray, speed: float | None) -> UrdfJoint:
    """Return a joint with its limits; its speed may come from elsewhere."""
    name = _name(joint)
    limit = joint.find("limit")
    values = {} if limit is None else dict(limit.attrib)
    if joint.get("type") == "continuous":
        values |= {"lower": repr(-2 * math.pi), "upper": repr(2 * math.pi)}
    for key in ("lower", "upper"):
        if key not in values:
            raise RobotError.of_rule("urdf", f"must state {key} of joint {name!r}", "none")
    lower, upper = (
        _numbers(values[key], 1, f"{key} of joint {name!r}")[0] for key in ("lower", "upper")
    )
    if not lower < upper:
        rule = f"must have lower below upper for joint {name!r}"
        raise RobotError.of_rule("urdf", rule, f"{lower:g} and {upper:g}")
    if max(abs(lower), abs(upper)) > _MOST_TURNED_RAD:
        rule = (
            f"must have limits of joint {name!r} within {_MOST_TURNED_RAD / (2 * math.pi):g} turns"
        )
        hint = "are they in degrees? A URDF states them in rad"
        raise RobotError.of_rule("urdf", rule, f"{lower:g} and {upper:g} rad", hint=hint)
    if speed is None:
        speed = _stated_speed(values, name)
    return UrdfJoint(name, origin, _axis_of(joint), lower, upper, speed)


def _stated_speed(values: Mapping[str, str], name: str) -> float:
    """Return the largest speed of a joint that its limits state, rad/s."""
    if "velocity" not in values:
        rule = f"must state velocity of joint {name!r}"
        raise RobotError.of_rule("urdf", rule, "none", hint=_SPEEDS_HINT)
    speed = _numbers(values["velocity"], 1, f"velocity of joint {name!r}")[0]
    if speed <= 0:
        rule = f"must have a positive velocity for joint {name!r}"
        raise RobotError.of_rule("urdf", rule, f"{speed:g}", hint=_SPEEDS_HINT)
    return speed


def _shapes(link: ElementTree.Element, pose: np.ndarray, notes: list[str]) -> list[LinkShape]:
    """Return the geometry of a link whose frame is given, and note what is no body."""
    for kind in ("collision", "visual"):
        shapes = [_shape(element, pose, _name(link)) for element in link.findall(kind)]
        bodies = [shape for shape in shapes if _is_body(shape)]
        notes += [
            f"the {shape.kind} of link {_name(link)!r} has size 0 and is no body"
            for shape in shapes
            if not _is_body(shape)
        ]
        if bodies:
            return bodies
    return []


def _is_body(shape: LinkShape) -> bool:
    return shape.kind == "mesh" or min(shape.size) > 0


def _shape(element: ElementTree.Element, pose: np.ndarray, link: str) -> LinkShape:
    """Return one geometry."""
    placed = compose(pose, _origin(element))
    geometry = element.find("geometry")
    for shape in () if geometry is None else geometry:
        label = f"{shape.tag} of link {link!r}"
        if shape.tag == "mesh":
            scale = _numbers(shape.get("scale", "1 1 1"), 3, f"scale of {label}")
            size = tuple(_MM * number for number in scale)
            return LinkShape("mesh", size, placed, shape.get("filename", ""))
        if shape.tag == "box":
            size = _numbers(shape.get("size", ""), 3, f"size of {label}")
        elif shape.tag == "cylinder":
            size = tuple(
                _numbers(shape.get(key, ""), 1, f"{key} of {label}")[0]
                for key in ("radius", "length")
            )
        elif shape.tag == "sphere":
            size = _numbers(shape.get("radius", ""), 1, f"radius of {label}")
        else:
            continue
        # a dummy that marks a frame has no size at all; one number of 0 among others is a slip
        if min(size) < 0 or (min(size) == 0 and max(size) > 0):
            raise RobotError.of_rule("urdf", f"must have a positive size for {label}", repr(size))
        return LinkShape(shape.tag, tuple(_MM * number for number in size), placed)
    raise RobotError.of_rule(
        "urdf", f"must have a mesh, box, cylinder or sphere in link {link!r}", "none"
    )


def _origin(element: ElementTree.Element) -> np.ndarray:
    """Return the pose (4, 4) of an origin, mm."""
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    xyz = _numbers(origin.get("xyz", "0 0 0"), 3, "xyz of an origin")
    rpy = _numbers(origin.get("rpy", "0 0 0"), 3, "rpy of an origin")
    return from_rpy(_MM * np.array(xyz), np.array(rpy))


def _numbers(text: str, count: int, what: str) -> tuple[float, ...]:
    """Return the finite numbers of an attribute."""
    try:
        numbers = tuple(float(word) for word in text.split())
    except ValueError:
        numbers = ()
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        rule = f"must hold {count} finite numbers for {what}"
        raise RobotError.of_rule("urdf", rule, shown(text))
    return numbers


def _check_size(joints: list[UrdfJoint], tip: np.ndarray) -> None:
    """Refuse lengths that are in millimetres."""
    lengths = [
        math.sqrt(float((pose[:3, 3] ** 2).sum())) for pose in (*(j.origin for j in joints), tip)
    ]
    metres = sum(lengths) / _MM
    if metres > _LONGEST_M:
        raise RobotError.of_rule(
            "urdf",
            "must be in metres",
            f"an arm that is {metres:,.0f} m long",
            hint="are its lengths and meshes in mm?",
        )


def _name(element: ElementTree.Element) -> str:
    return element.get("name", "")


def _end(joint: ElementTree.Element, which: str) -> str:
    """Return the parent or the child of a joint."""
    link = joint.find(which)
    return "" if link is None else link.get("link", "")


def _listed(names: Iterable[str]) -> str:
    return "there are " + ", ".join(names)


# A calibrated arm: measured origins of its joints, and zeros that are off.
#
# ``ur_calibration`` of Universal Robots writes such a file for each of its arms. The result is a
# URDF as text again, so that everything else reads one kind of file.


_FAR_MM = 50.0
_FAR_RAD = 0.1
"""What differs more from the URDF is the calibration of another arm, or in other units."""
_ENDINGS = ("_link", "_joint")
_UPRIGHT = 1e-9


@dataclass(frozen=True)
class MeasuredOrigin:
    """The origin of a joint in the link before it, m and rad, as a URDF has it."""

    x: float
    y: float
    z: float
    roll: float
    pitch: float
    yaw: float


def calibrated_text(
    text: str,
    tip: str,
    origins: Mapping[str, Any] | None = None,
    joint_offsets: Sequence[float] = (),
) -> str:
    """Return a URDF with measured origins of its joints.

    Parameters
    ----------
    text : str
        The URDF.
    tip : str
        Link that carries the camera.
    origins : mapping of str to mapping, optional
        By the joint or the link behind it, with or without the ending ``_link``: x, y and z, m, roll, pitch and yaw,
        rad, as ``ur_calibration`` writes them.
    joint_offsets : sequence of float
        What each joint is farther than its controller counts, rad.

    Raises
    ------
    RobotError
        A name is no joint's, a value is missing, or the arm is another one.
    """
    root = _root(text)
    chain = _Tree(root).joints_to(tip)
    moving = [joint for joint in chain if joint.get("type") != "fixed"]
    for name, values in (origins or {}).items():
        parameter = f"calibration: {name}"
        pose = _measured_pose(parameter, values)
        joint = _joint_called(name, moving)
        _check_near(parameter, pose, _origin(joint))
        _set_origin(joint, pose)
    if len(joint_offsets) not in (0, len(moving)):
        rule = f"must have a number for each of the {len(moving)} joints"
        raise RobotError.of_rule("joint_offsets", rule, f"{len(joint_offsets)}")
    for joint, offset in zip(moving, joint_offsets, strict=False):
        if not abs(offset) <= _FAR_RAD:
            rule = f"must be at most {_FAR_RAD:g} rad, {math.degrees(_FAR_RAD):.3g} degrees"
            got = f"{offset:g} rad, {math.degrees(offset):g} degrees"
            raise RobotError.of_rule("joint_offsets", rule, got)
        turn = np.eye(4)
        turn[:3, :3] = about(_axis_of(joint), float(offset))
        _set_origin(joint, compose(_origin(joint), turn))
    return ElementTree.tostring(root, encoding="unicode")


def _measured_pose(parameter: str, values: Any) -> np.ndarray:
    """Return the pose (4, 4) that an entry of a calibration states, mm."""
    if not isinstance(values, Mapping):
        rule = "must hold x, y, z, roll, pitch and yaw"
        raise RobotError.of_rule(parameter, rule, shown(values))
    try:
        measured = from_plain(MeasuredOrigin, values, RobotError)
    except RobotError as error:
        name = f"{parameter}: {error.parameter}"
        raise RobotError.of_rule(name, error.rule, error.got) from None
    xyz = np.array([measured.x, measured.y, measured.z])
    return from_rpy(_MM * xyz, np.array([measured.roll, measured.pitch, measured.yaw]))


def _joint_called(name: str, joints: Sequence[ElementTree.Element]) -> ElementTree.Element:
    """Return the joint that a calibration calls so; names may have a prefix."""
    names = {name, *(f"{name}{ending}" for ending in _ENDINGS)}
    for is_same in (str.__eq__, lambda whole, part: whole.endswith(f"_{part}")):
        matches = [
            joint
            for joint in joints
            if any(
                is_same(stated, word)
                for stated in (_name(joint), _end(joint, "child"))
                for word in names
            )
        ]
        if len(matches) == 1:
            return matches[0]
    rule = "must name joints of the arm, or the links behind them"
    listed = _listed(_end(joint, "child") for joint in joints)
    raise RobotError.of_rule("calibration", rule, repr(name), hint=listed)


def _check_near(parameter: str, measured: np.ndarray, nominal: np.ndarray) -> None:
    """Raise if a measured origin is that of another arm."""
    apart = compose(invert(nominal), measured)
    mm = math.sqrt(float((apart[:3, 3] ** 2).sum()))
    turned = math.acos(max(-1.0, min(1.0, (float(np.trace(apart[:3, :3])) - 1.0) / 2.0)))
    if mm > _FAR_MM or turned > _FAR_RAD:
        rule = f"must be within {_FAR_MM:g} mm and {_FAR_RAD:g} rad of the URDF"
        hint = "is it of another arm?"
        raise RobotError.of_rule(parameter, rule, f"{mm:.3g} mm and {turned:.3g} rad", hint=hint)


def _axis_of(joint: ElementTree.Element) -> np.ndarray:
    """Return the unit vector (3,) of a joint's axis."""
    stated = joint.find("axis")
    text = "1 0 0" if stated is None else stated.get("xyz", "1 0 0")
    axis = np.array(_numbers(text, 3, f"axis of joint {_name(joint)!r}"))
    length = math.sqrt(float((axis**2).sum()))
    if length == 0:
        raise RobotError.of_rule("urdf", f"must have an axis for joint {_name(joint)!r}", text)
    return np.asarray(axis / length)


def _set_origin(joint: ElementTree.Element, pose: np.ndarray) -> None:
    """Give a joint another origin."""
    origin = joint.find("origin")
    if origin is None:
        origin = ElementTree.SubElement(joint, "origin")
    origin.set("xyz", " ".join(repr(float(mm) / _MM) for mm in pose[:3, 3]))
    origin.set("rpy", " ".join(map(repr, to_rpy(pose))))


def to_rpy(pose: np.ndarray) -> tuple[float, float, float]:
    """Return turns about fixed x, then y, then z, rad, of a pose (4, 4); the first is 0 where only a sum is fixed."""
    turn = pose[:3, :3].tolist()
    across = math.hypot(turn[0][0], turn[1][0])
    pitch = math.atan2(-turn[2][0], across)
    if across < _UPRIGHT:
        return 0.0, pitch, math.atan2(-turn[0][1], turn[1][1])
    return math.atan2(turn[2][1], turn[2][2]), pitch, math.atan2(turn[1][0], turn[0][0])


# Meshes of COLLADA, which some makers give for the links of their arms. Links count as convex hulls,
# so only the corners are read.


COLLADA = ".dae"
_DEEPEST = 100


def collada_points(data: bytes, file: str) -> np.ndarray:
    """Return the corners of a file of COLLADA in the frame of its link, m.

    The unit of the file is applied, and its upper axis is not, as in RViz (``rviz/mesh_loader.cpp``): a URDF that
    looks right there has its meshes turned by nothing but their nodes.

    Parameters
    ----------
    data : bytes
        The file.
    file : str
        Its name, for messages.

    Returns
    -------
    array (n, 3)
        Of all geometry in its scene.

    Raises
    ------
    RobotError
        If it is no such file, or its scene is empty.
    """
    _check_plain_xml(data)
    root = ElementTree.fromstring(data)
    for element in root.iter():
        element.tag = str(element.tag).rpartition("}")[2]
    if root.tag != "COLLADA":
        raise RobotError.of_rule("urdf", "must hold the element COLLADA in .dae files", file)
    unit = root.find("asset/unit")
    metre = 1.0 if unit is None else _numbers(unit.get("meter", "1"), 1, f"unit of {file}")[0]
    ids = {element.get("id", ""): element for element in root.iter() if element.get("id")}
    scene = ids.get(_target(root.find("scene/instance_visual_scene")))
    points = [] if scene is None else list(_scene_points(scene, np.eye(4), ids, file, 0))
    if not points:
        raise RobotError.of_rule("urdf", "must have a scene with geometry in .dae files", file)
    return np.asarray(metre * np.unique(np.concatenate(points), axis=0))


def _target(element: ElementTree.Element | None) -> str:
    """Return the name that a reference of COLLADA leads to."""
    return "" if element is None else element.get("url", "").removeprefix("#")


def _scene_points(
    node: ElementTree.Element,
    pose: np.ndarray,
    ids: Mapping[str, ElementTree.Element],
    file: str,
    depth: int,
) -> Iterator[np.ndarray]:
    """Yield corners (n, 3) of what hangs on a node whose frame (4, 4) is given."""
    if depth > _DEEPEST:
        raise RobotError.of_rule("urdf", "must not nest so deep in .dae files", file)
    for child in node:
        if child.tag in _STEPS:
            pose = np.einsum("ij,jk->ik", pose, _step(child, file))
        elif child.tag == "node":
            yield from _scene_points(child, pose, ids, file, depth + 1)
        elif child.tag == "instance_node" and _target(child) in ids:
            yield from _scene_points(ids[_target(child)], pose, ids, file, depth + 1)
        elif child.tag == "instance_geometry" and _target(child) in ids:
            corners = _collada_corners(ids[_target(child)], ids, file)
            yield np.einsum("ij,nj->ni", pose[:3, :3], corners) + pose[:3, 3]


def _collada_corners(
    geometry: ElementTree.Element, ids: Mapping[str, ElementTree.Element], file: str
) -> np.ndarray:
    """Return the corners (n, 3) of a geometry in its own frame."""
    position = geometry.find("mesh/vertices/input[@semantic='POSITION']")
    source = None if position is None else ids.get(position.get("source", "").removeprefix("#"))
    text = "" if source is None else source.findtext("float_array", "")
    count = 3 * math.ceil(len(text.split()) / 3)
    return np.array(_numbers(text, count, f"positions of {file}")).reshape(-1, 3)


_STEPS = {"matrix": 16, "translate": 3, "rotate": 4, "scale": 3}


def _step(element: ElementTree.Element, file: str) -> np.ndarray:
    """Return a transformation (4, 4) of a node of COLLADA."""
    count = _STEPS[element.tag]
    numbers = np.array(_numbers(element.text or "", count, f"{element.tag} of {file}"))
    step = np.eye(4)
    if element.tag == "matrix":
        return numbers.reshape(4, 4)
    if element.tag == "translate":
        step[:3, 3] = numbers
    elif element.tag == "scale":
        step[:3, :3] = np.diag(numbers)
    else:
        length = math.sqrt(float((numbers[:3] ** 2).sum()))
        step[:3, :3] = about(numbers[:3] / max(length, _UPRIGHT), math.radians(numbers[3]))
    return step
