"""Text of YAML, JSON and OpenCV's XML as a tree of mappings, lists, numbers and words.

Numbers are what YAML 1.2 and JSON call so: `1e-05` is one, though not in YAML 1.1; `010` is none, as
it is 8 in one version and 10 in the other. What stands in quotes is a word.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from planner.argument_kinds import shown
from planner.exceptions import CameraError

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
        found: dict[str, Any] = {}
        for event in self._until(yaml.MappingEndEvent):
            if not isinstance(event, yaml.ScalarEvent) or _is_merge(event):
                raise self._error(event, "a key must be a word", "a merge or a structure")
            self._value(event)
            if event.value in found:
                raise self._error(event, "a key must stand once", shown(event.value, str))
            found[event.value] = self._value(next(self._events))
        return found

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
