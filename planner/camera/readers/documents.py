"""Text of YAML, JSON and OpenCV's XML as a tree of mappings, lists, numbers and words.

Numbers are what YAML 1.2 and JSON call so: `1e-05` is one, though not in YAML 1.1; `010` is none, as
it is 8 in one version and 10 in the other. What stands in quotes is a word.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import yaml

from planner.camera.checks import shown
from planner.exceptions import CameraError

# calibrations have some kilobytes; the parser, which is Python, reads some 100 kB a second
_MOST_CHARACTERS = 1_000_000
_NUMBER = re.compile(r"[-+]?(?:(?:0|[1-9]\d*)(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?")
_NOT_FINITE = {".nan": "nan", ".inf": "inf", "+.inf": "inf", "-.inf": "-inf"}
_WORDS = {"true": True, "false": False, "null": None, "~": None, "": None}
_YES_OR_NO = {"yes": True, "no": False, "on": True, "off": False}
# PyYAML knows none of OpenCV's first line, %YAML:1.0
_DIRECTIVE = re.compile(r"\A%YAML[: ][^\n]*")
_MATRIX = "opencv-matrix"
_TAG = "tag:yaml.org,2002:"
# what PyYAML finds out by itself; `merge` and `binary` are not among them
_KNOWN_TAGS = {
    _TAG + name
    for name in ("map", "seq", "str", "int", "float", "bool", "null", "timestamp", "value", _MATRIX)
}


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
        roots = list(yaml.compose_all(_DIRECTIVE.sub("", text), Loader=yaml.SafeLoader))
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f":{mark.line + 1}" if mark is not None else ""
        reason = getattr(error, "problem", None) or getattr(error, "reason", "it cannot be parsed")
        raise CameraError(
            f"{path}{line}: camera file must be a calibration; as YAML it is broken. "
            f"Got: {shown(reason, str)}."
        ) from None
    # what follows a last `---` is a document without anything in it
    full = [root for root in roots if root.tag != _TAG + "null"]
    if len(full) > 1:
        raise CameraError(
            f"{path}: file must hold one camera. Got {len(full)} YAML documents or messages."
        )
    return _YamlValues(path).of(full[0]) if full else None


class _YamlValues:
    """Makes values of YAML's nodes; an alias is made once, so that no file is larger than its text."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._made: dict[int, Any] = {}

    def of(self, node: yaml.Node) -> Any:
        if id(node) in self._made:
            value = self._made[id(node)]
            if value is self:
                raise self._error(node, "an alias must not stand for what it is in", "a cycle")
            return value
        self._made[id(node)] = self
        value = self._make(node)
        self._made[id(node)] = value
        return value

    def _make(self, node: yaml.Node) -> Any:
        if node.tag not in _KNOWN_TAGS:
            tag = node.tag.replace(_TAG, "!!")
            raise self._error(node, "a tag must be !!opencv-matrix", shown(tag, str))
        if isinstance(node, yaml.MappingNode):
            return self._mapping(node)
        if isinstance(node, yaml.SequenceNode):
            return [self.of(item) for item in node.value]
        return plain_value(node.value) if node.style is None else node.value

    def _mapping(self, node: yaml.MappingNode) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for key_node, value_node in node.value:
            if not isinstance(key_node, yaml.ScalarNode) or key_node.tag == _TAG + "merge":
                raise self._error(key_node, "a key must be a word", "a merge or a structure")
            if key_node.value in found:
                raise self._error(key_node, "a key must stand once", shown(key_node.value, str))
            found[key_node.value] = self.of(value_node)
        return found

    def _error(self, node: yaml.Node, rule: str, value: str) -> CameraError:
        return CameraError(f"{self._path}:{node.start_mark.line + 1}: {rule}. Got {value}.")


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
    if unknown or kind not in (_MATRIX, "map", "seq"):
        attribute = next(iter(unknown), f"type_id={kind}")
        raise CameraError(
            f'{path}: <{element.tag}> must be plain or type_id="{_MATRIX}". '
            f"Got {shown(attribute, str)}."
        )
    children = list(element)
    if any(child.tag != "_" for child in children):
        found: dict[str, Any] = {}
        for child in children:
            if child.tag in found:
                raise CameraError(f"{path}: a key must stand once. Got {shown(child.tag, str)}.")
            found[child.tag] = _element_value(path, child)
        return found
    if children:
        return [_element_value(path, child) for child in children]
    words = (element.text or "").strip()
    if words.startswith('"'):
        return words.strip('"')
    values = [plain_value(word) for word in words.split()]
    if element.tag == "data" or len(values) > 1:
        return values
    return values[0] if values else None
