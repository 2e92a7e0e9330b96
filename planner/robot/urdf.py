"""URDF files: the chain from the base link to the tip, and what is fixed to each of its links.

A URDF is in metres; what comes out is in millimetres. Collision geometry is read, or the visual one where a link has
no other. Joints off the chain, such as those of a gripper, stand at zero.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np

from planner.argument_kinds import shown
from planner.exceptions import RobotError
from planner.robot.transforms import compose, from_rpy, invert

_MM = 1000.0
_TURNS = ("revolute", "continuous")
_LONGEST_M = 50.0
N_JOINTS = 6
"""Joints of an arm."""


@dataclass(frozen=True)
class Shape:
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
        Six, from the base to the tip.
    tip : array (4, 4)
        Frame of the tip in that of the last joint.
    segments : tuple of str
        Names of the base link and of the links behind the joints.
    shapes : tuple of tuple of Shape
        What is fixed to each segment.
    """

    name: str
    joints: tuple[UrdfJoint, ...]
    tip: np.ndarray
    segments: tuple[str, ...]
    shapes: tuple[tuple[Shape, ...], ...]


class _Tree:
    """Links and joints of a file by name."""

    def __init__(self, root: ElementTree.Element) -> None:
        self.name = root.get("name", "")
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


def read_urdf(text: str, tip: str, base: str | None = None) -> UrdfArm:
    """Return the arm that a URDF describes.

    Parameters
    ----------
    text : str
        The file.
    tip : str
        Link the camera is fixed to.
    base : str, optional
        Link whose frame is the robot's base. Default: ``base_link`` where there is one, otherwise the first link.

    Raises
    ------
    RobotError
        The text is no URDF, a link is missing, or the chain is no arm of six turning joints with limits and speeds.
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
    links = _bodies(tree, chain, moving)
    base = _base(base, tree, links[0])
    links[0] = _seen_from(links[0], base)
    joints = []
    for before, joint in zip(links, moving, strict=False):
        origin = compose(before[_end(joint, "parent")], _origin(joint))
        joints.append(_moving_joint(joint, origin))
    _check_size(joints, links[-1][tip])
    shapes = tuple(
        tuple(shape for link, pose in body.items() for shape in _shapes(tree.links[link], pose))
        for body in links
    )
    segments = (base, *(_end(joint, "child") for joint in moving))
    return UrdfArm(tree.name, tuple(joints), links[-1][tip], segments, shapes)


def _bodies(
    tree: _Tree, chain: list[ElementTree.Element], moving: list[ElementTree.Element]
) -> list[dict[str, np.ndarray]]:
    """Return what moves as one with the first link and with each moving joint: poses (4, 4) by link."""
    starts = [_end(chain[0], "parent"), *(_end(joint, "child") for joint in moving)]
    bodies = []
    for start in starts:
        body = {start: np.eye(4)}
        left = [start]
        while left:
            link = left.pop()
            for joint in tree.below.get(link, ()):
                if joint not in moving:
                    child = _end(joint, "child")
                    body[child] = compose(body[link], _origin(joint))
                    left.append(child)
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
    if re.search(r"<!(DOCTYPE|ENTITY)", text, re.IGNORECASE):
        raise RobotError.of_rule("urdf", "must hold no DOCTYPE and no entities", "one")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise RobotError.of_rule("urdf", "must be XML", str(error)) from None
    # http://www.ros.org/wiki/xacro and others
    spaces = [one for one in root.iter() if re.match(r"\{[^}]*ros\.org[^}]*\}", str(one.tag))]
    if spaces or "${" in text or "$(" in text:
        hint = "xacrodoc writes the URDF of a xacro: xacrodoc robot.urdf.xacro -o robot.urdf"
        raise RobotError.of_rule("urdf", "must be expanded", "a xacro file", hint=hint)
    if root.tag != "robot":
        raise RobotError.of_rule("urdf", "must hold the element robot", shown(root.tag))
    return root


def _check_moving(moving: list[ElementTree.Element], tip: str) -> None:
    """Raise unless the chain has six turning joints."""
    for number, joint in enumerate(moving, start=1):
        kind = joint.get("type")
        if kind not in _TURNS:
            raise RobotError.of_rule(
                "urdf", f"must turn in every joint to {tip!r}", f"{kind} for joint {number}"
            )
    if len(moving) != N_JOINTS:
        rule = f"must have six joints between base and {tip!r}"
        names = ", ".join(map(_name, moving))
        raise RobotError.of_rule("urdf", rule, f"{len(moving)}: {names}")


def _moving_joint(joint: ElementTree.Element, origin: np.ndarray) -> UrdfJoint:
    """Return a joint with its limits."""
    name = _name(joint)
    limit = joint.find("limit")
    values = {} if limit is None else dict(limit.attrib)
    if joint.get("type") == "continuous":
        values |= {"lower": repr(-2 * math.pi), "upper": repr(2 * math.pi)}
    for key in ("lower", "upper", "velocity"):
        if key not in values:
            raise RobotError.of_rule("urdf", f"must state {key} of joint {name!r}", "none")
    lower, upper, speed = (
        _numbers(values[key], 1, f"{key} of joint {name!r}")[0]
        for key in ("lower", "upper", "velocity")
    )
    if not lower < upper:
        rule = f"must have lower below upper for joint {name!r}"
        raise RobotError.of_rule("urdf", rule, f"{lower:g} and {upper:g}")
    if speed <= 0:
        raise RobotError.of_rule(
            "urdf", f"must have a positive velocity for joint {name!r}", f"{speed:g}"
        )
    stated = joint.find("axis")
    text = "1 0 0" if stated is None else stated.get("xyz", "1 0 0")
    axis = np.array(_numbers(text, 3, f"axis of joint {name!r}"))
    length = math.sqrt(float((axis**2).sum()))
    if length == 0:
        raise RobotError.of_rule("urdf", f"must have an axis for joint {name!r}", text)
    return UrdfJoint(name, origin, axis / length, lower, upper, speed)


def _shapes(link: ElementTree.Element, pose: np.ndarray) -> list[Shape]:
    """Return the geometry of a link whose frame is given."""
    elements = link.findall("collision") or link.findall("visual")
    return [_shape(element, pose, _name(link)) for element in elements]


def _shape(element: ElementTree.Element, pose: np.ndarray, link: str) -> Shape:
    """Return one geometry."""
    placed = compose(pose, _origin(element))
    geometry = element.find("geometry")
    for shape in () if geometry is None else geometry:
        what = f"{shape.tag} of link {link!r}"
        if shape.tag == "mesh":
            scale = _numbers(shape.get("scale", "1 1 1"), 3, f"scale of {what}")
            size = tuple(_MM * number for number in scale)
            return Shape("mesh", size, placed, shape.get("filename", ""))
        if shape.tag == "box":
            size = _numbers(shape.get("size", ""), 3, f"size of {what}")
        elif shape.tag == "cylinder":
            size = tuple(
                _numbers(shape.get(key, ""), 1, f"{key} of {what}")[0]
                for key in ("radius", "length")
            )
        elif shape.tag == "sphere":
            size = _numbers(shape.get("radius", ""), 1, f"radius of {what}")
        else:
            continue
        if min(size) <= 0:
            raise RobotError.of_rule("urdf", f"must have a positive size for {what}", repr(size))
        return Shape(shape.tag, tuple(_MM * number for number in size), placed)
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
