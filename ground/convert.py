"""Records of plain values, as files hold them: read by the rules on their fields, written, and their JSON schema.

A record is a frozen dataclass or a named tuple. The types of its fields say what a file may hold, and `msgspec.Meta`
in an ``Annotated`` type states rules. The title of a rule completes the sentence that begins with the name of the
field; without one, the words follow from type and limits. A field with ``init=False`` follows from the others: files
state it, and it is compared when they are read.
"""

from __future__ import annotations

import dataclasses
import difflib
import json
import math
import re
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from functools import cache
from typing import Annotated, Any, Literal, Protocol, Self, TypeVar, Union

import msgspec
from msgspec import Meta as Meta

T = TypeVar("T")

Path = tuple[object, ...]
"""Keys and indices from the whole down to a value."""

_LONGEST = 60
_LONGEST_REPR = 80
# a number computed twice may differ in its last digits
_SAME = 1e-6
# larger integers are no floats
_MOST_BITS = 1000


class RuleError(Protocol):
    """An error that says which parameter breaks which rule."""

    def __init__(self, message: str) -> None:
        """Take the whole text."""

    @classmethod
    def of_rule(cls, parameter: str, rule: str, got: str) -> Self:
        """Return "PARAMETER RULE. Got GOT."."""


# Marks of fields, in an Annotated type beside Meta.


class Shape(tuple[int | None, ...]):
    """Lengths of an array along its axes, such as ``Shape(4, 4)``; None is any length."""

    def __new__(cls, *lengths: int | None) -> Shape:
        """Take the lengths one by one."""
        return super().__new__(cls, lengths)

    def __str__(self) -> str:
        """Return the shape as numpy writes it, with n for any length."""
        lengths = ["n" if length is None else str(length) for length in self]
        return f"({', '.join(lengths)}{',' * (len(lengths) == 1)})"


@dataclasses.dataclass(frozen=True)
class Key:
    """The key of a field in files, where it is not the name of the field."""

    name: str


class NullIs(float):
    """The number that is not finite for which a file has null: ``NullIs(math.nan)``."""


@dataclasses.dataclass(frozen=True)
class Plain:
    """Two functions by which a value that is no record becomes plain values and comes back."""

    write: Callable[[Any], Any]
    read: Callable[[Any], Any]


LATER = object()
"""Mark of a record that is read as the plain values it consists of."""

NOT_STORED = object()
"""Mark of a field that files do not hold; it needs a default."""

STATED = object()
"""Mark of a field that files always hold, although it has a default."""

FROM_ONE = object()
"""Mark of an index, or of a mapping by index: files count from 1."""

ROW = object()
"""Mark of a record that a file has as an array of its fields."""

SPELLED = object()
"""Mark of a number that may be infinite: a file then has ``{"not finite": "inf"}``."""


# The three functions.


def from_plain(cls: type[T], data: object, error: type[RuleError], source: str = "") -> T:
    """Return the record that plain values state.

    Parameters
    ----------
    cls : type
        A dataclass or a named tuple.
    data : object
        Plain values as JSON and TOML have them.
    error : type
        The error to raise: a class with ``of_rule``.
    source : str, optional
        What the text of an error begins with, such as the path of the file.

    Returns
    -------
    object
        The record. Arrays are of float64 or of the type that the field states; lists become tuples.

    Raises
    ------
    error
        Names the first wrong value by its path, the rule and the value.
    """
    record: Any = cls
    try:
        return typing.cast(T, _record(record).read(data, ()))
    except _Refusal as refusal:
        raise refusal.as_error(error, source) from refusal.__cause__


def check_keys(cls: type, data: Mapping[str, Any], error: type[RuleError]) -> None:
    """Refuse a key that is no field of a record, and a field without a default that is missing.

    Parameters
    ----------
    cls : type
        A dataclass or a named tuple, whose constructor then takes the data.
    data : mapping
        Values by key.
    error : type
        The error to raise: a class with ``of_rule``.
    """
    record: Any = cls
    try:
        _record(record).check_keys(data, ())
    except _Refusal as refusal:
        raise refusal.as_error(error) from None


def check_fields(
    record: Any, error: type[RuleError], text: Callable[[object], str] | None = None
) -> None:
    """Make the values of a record keep the rules of its fields; for its ``__post_init__``.

    Parameters
    ----------
    record : object
        A dataclass whose fields may hold what is like their types: integers, lists, numbers and arrays of numpy.
        Afterwards they hold floats, tuples and arrays, as `from_plain` makes them.
    error : type
        The error to raise: a class with ``of_rule``.
    text : callable, optional
        Returns a value in words. Default: as Python writes it.

    Raises
    ------
    error
        Names the first wrong field, the rule and the value.
    """
    cls: Any = type(record)
    for key, field in _record(cls).fields.items():
        value: Any = getattr(record, field.name, None)
        if field.is_derived or value is field.default:
            continue
        try:
            read = field.kind.read(value.tolist() if hasattr(value, "tolist") else value, (key,))
        except _Refusal as refusal:
            # of an argument, which item it is is no name
            refusal.path = (field.name,)
            raise refusal.as_error(error, text=text or _as_python) from None
        object.__setattr__(record, field.name, read)


def to_plain(record: Any, *, defaults: bool = False) -> dict[str, Any]:
    """Return a record as plain values that JSON and TOML can hold.

    Parameters
    ----------
    record : object
        A dataclass or a named tuple.
    defaults : bool, optional
        Write also the fields whose values are their defaults.

    Returns
    -------
    dict
        By the keys of the fields, in their order.

    Raises
    ------
    ValueError
        If a number is not finite, and its field has no way to write that.
    """
    cls: Any = type(record)
    data: dict[str, Any] = _record(cls).plain(record, defaults)
    return data


def json_schema(cls: Any, *, defaults: bool = False, **members: object) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a record; each rule is a title.

    Parameters
    ----------
    cls : type
        A dataclass or a named tuple.
    defaults : bool, optional
        Fields with defaults must be there, too, as `to_plain` then writes them.
    **members
        What the schema says besides, such as a title and a description of the whole.
    """
    definitions = _Definitions()
    definitions.defaults = defaults
    reference = _record(cls).schema(definitions)
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **members, **reference}
    return {**schema, "$defs": dict(sorted(definitions.items()))}


# Texts of errors.


def field_name(*parts: object) -> str:
    """Return the path of a field as a reader would write it: ``settings[2].probability["long edge"]``."""
    text = ""
    for part in parts:
        if isinstance(part, int):
            text += f"[{part}]"
        elif isinstance(part, str) and re.fullmatch(r"\w[\w-]*", part) and len(part) <= _LONGEST:
            text += f".{part}" if text else part
        else:
            text += f"[{shown(part)}]"
    return text


def shown(value: object) -> str:
    """Return a value in JSON's notation, shortened to a readable length."""
    if isinstance(value, dict) and set(value) == {"not finite"}:
        value = value["not finite"]
        return {"nan": "NaN", "inf": "Infinity", "-inf": "-Infinity"}.get(str(value), shown(value))
    if isinstance(value, int) and value.bit_length() > 4 * _LONGEST:
        return f"an integer of {value.bit_length()} bits"
    text = json.dumps(value, ensure_ascii=False, default=repr)
    text = text if text.isprintable() else ascii(text)
    if len(text) <= _LONGEST:
        return text
    if isinstance(value, dict | list):
        kind, item = ("an object", "field") if isinstance(value, dict) else ("an array", "item")
        return f"{kind} of {len(value)} {item}{'s' * (len(value) != 1)}"
    return _cut(text, _LONGEST)


def _nested_shape(value: object) -> str:
    """Return the shape of nested arrays; of arrays that differ, that of the first."""
    if not isinstance(value, list):
        return shown(value)
    shape = []
    while isinstance(value, list):
        shape.append(len(value))
        value = value[0] if value else None
    return str(tuple(shape))


def _listed(words: Sequence[str]) -> str:
    """Return words as a sentence lists them: a, b or c."""
    *first, last = words
    return f"{', '.join(first)} or {last}" if first else last


class _Refusal(Exception):
    """A value that breaks a rule, before it is known which error to raise."""

    def __init__(self, path: Path, rule: str = "", value: object = None, got: str = "") -> None:
        super().__init__(rule)
        self.path = path
        self.rule = rule
        self.value = value
        self.got = got

    def as_error(
        self, error: type[RuleError], source: str = "", text: Callable[[object], str] = shown
    ) -> Any:
        """Return the error to raise; what a record says of itself follows its path."""
        cause = self.__cause__
        name = field_name(*self.path)
        if cause is None:
            got = self.got or (_nested_shape if "shape" in self.rule else text)(self.value)
            refused: Any = error.of_rule(name or "file", self.rule, got)
        elif not name:
            refused = cause if isinstance(cause, error) else error(str(cause))
        else:
            joint = "." if getattr(cause, "parameter", "") else ": "
            refused = error(f"{name}{joint}{cause}")
        return error(f"{source}: {refused}") if source else refused


def _as_python(value: object) -> str:
    """Return a value as Python writes it, shortened to a readable length."""
    text = repr(value)
    return _cut(text, _LONGEST_REPR)


def _cut(text: str, longest: int) -> str:
    """Return a text of at most this length; what began with a quote ends with it."""
    if len(text) <= longest:
        return text
    quote = text[0] if text[0] in "'\"" else ""
    return f"{text[: longest - 3 - len(quote)]}...{quote}"


# What a field may hold, by its type.


class _Definitions(dict[str, Any]):
    """Schemas of records by name, and whether files hold defaults."""

    defaults = False


class _Kind:
    """What a value may be: any plain value."""

    def __init__(self, metas: Sequence[Meta] = (), rule: str = "") -> None:
        self.metas = metas
        self.rule = self.stated("title") or rule

    def stated(self, name: str) -> Any:
        """Return what the rules of the field state last, such as its title; None if none does."""
        values = [getattr(meta, name) for meta in self.metas]
        return next((value for value in reversed(values) if value is not None), None)

    def read(self, value: Any, path: Path) -> Any:
        """Return the value for the record, or raise `_Refusal`."""
        return value

    def plain(self, value: Any, defaults: bool) -> Any:
        """Return the value of a record as files hold it."""
        return value

    def schema(self, definitions: _Definitions) -> dict[str, Any]:
        """Return the schema; those of records are added to the definitions."""
        return self._worded({})

    def _worded(self, schema: dict[str, Any]) -> dict[str, Any]:
        words = {"title": self.rule, "description": self.stated("description")}
        return {**{key: text for key, text in words.items() if text}, **schema}

    def _refuse_unless(self, holds: bool, path: Path, value: object, rule: str = "") -> None:
        if not holds:
            raise _Refusal(path, rule or self.rule, value)


class _Made(_Kind):
    """A value that functions make plain, and make again."""

    def __init__(self, functions: Plain, metas: Sequence[Meta]) -> None:
        super().__init__(metas, "must be as this program writes it")
        self.functions = functions

    def read(self, value: Any, path: Path) -> Any:
        try:
            return self.functions.read(value)
        except ValueError as error:
            raise _Refusal(path) from error
        except (AttributeError, KeyError, TypeError):
            raise _Refusal(path, self.rule, value) from None

    def plain(self, value: Any, defaults: bool) -> Any:
        return self.functions.write(value)


class _Later(_Kind):
    """A record as plain values."""

    def __init__(self, record: _Kind, metas: Sequence[Meta]) -> None:
        super().__init__(metas, record.rule)
        self.record = record

    def read(self, value: Any, path: Path) -> Any:
        self._refuse_unless(isinstance(value, Mapping), path, value)
        return value

    def schema(self, definitions: _Definitions) -> dict[str, Any]:
        return self.record.schema(definitions)


_WORDS = {
    float: "must be a number",
    int: "must be an integer",
    str: "must be text",
    bool: "must be true or false",
}
_LIMITS = {
    "gt": "must be above {:g}",
    "ge": "must be at least {:g}",
    "lt": "must be below {:g}",
    "le": "must be at most {:g}",
}


class _Scalar(_Kind):
    """A number, a text, a truth value, or a choice. Each Meta is a rule, in the words of its title or the next one."""

    def __init__(self, annotation: Any, metas: Sequence[Meta]) -> None:
        super().__init__(metas)
        self.type = annotation
        if typing.get_origin(annotation) is Literal:
            self.words = _choice(typing.get_args(annotation))
        elif issubclass(annotation, Enum):
            self.words = _choice([member.value for member in annotation])
        else:
            self.words = _WORDS[annotation]
        titles = [
            next((meta.title for meta in metas[k:] if meta.title), "") for k in range(len(metas))
        ]
        self.rules = list(zip(metas, titles, strict=True)) or [(Meta(), "")]
        self.rule = self.rules[0][1] or self.words

    def read(self, value: Any, path: Path) -> Any:
        value = value.item() if hasattr(value, "dtype") else value
        number = value
        if isinstance(value, int) and value.bit_length() > _MOST_BITS:
            number = math.inf if value > 0 else -math.inf
        self._refuse_unless(number == number, path, value)
        for meta, title in self.rules:
            if not _fits(number, Annotated[self.type, meta]):
                raise _Refusal(path, title or self._limit(number, meta), value)
        if isinstance(number, float) and not math.isfinite(number):
            raise _Refusal(path, self.rule, value)
        return msgspec.convert(value, self.type)

    def _limit(self, value: object, meta: Meta) -> str:
        """Return the words of the limit that a value breaks, or of the type."""
        for name, words in _LIMITS.items():
            limit = getattr(meta, name)
            rule = Meta(**{name: limit})
            is_number = _fits(value, Annotated[self.type, Meta()])
            if limit is not None and is_number and not _fits(value, Annotated[self.type, rule]):
                return words.format(limit)
        return self.words

    def plain(self, value: Any, defaults: bool) -> Any:
        value = value.value if isinstance(value, Enum) else value
        value = value.item() if hasattr(value, "dtype") else value
        if self.type is float and isinstance(value, int):
            value = float(value)
        if isinstance(value, float) and not math.isfinite(value):
            raise ValueError(f"a file must hold finite numbers. Got {value!r}.")
        return value

    def schema(self, definitions: _Definitions) -> dict[str, Any]:
        schema: dict[str, Any] = {}
        for meta, _ in self.rules:
            schema |= msgspec.json.schema(Annotated[self.type, meta])
        if "$ref" in schema:
            schema = {"enum": [member.value for member in self.type]}
        return {**schema, **self._worded({})}


def _choice(values: Sequence[object]) -> str:
    if len(values) == 1:
        return f"must be {shown(values[0])}"
    return f"must be {_listed([str(value) for value in values])}"


def _alike(first: Any, second: Any) -> bool:
    """Tell whether two values are the same, but for the last digits of a number."""
    if isinstance(first, float) and isinstance(second, float):
        return math.isclose(first, second, rel_tol=1e-9, abs_tol=_SAME)
    if hasattr(first, "tolist") and hasattr(second, "tolist"):
        return bool(first.tolist() == second.tolist())
    return bool(first == second)


def _fits(value: object, annotation: Any) -> bool:
    try:
        msgspec.convert(value, annotation)
    except msgspec.ValidationError:
        return False
    return True


class _Spelled(_Kind):
    """A number that need not be finite: another spelling of it, beside the number itself."""

    def __init__(self, number: _Kind, null: float | None) -> None:
        rule = "must be a number or null" if null is not None else f"{number.rule}, or {_SPELLING}"
        super().__init__(number.metas, rule)
        self.number = number
        self.null = null

    def read(self, value: Any, path: Path) -> Any:
        if self.null is not None and value is None:
            return float(self.null)
        if self.null is None and isinstance(value, Mapping) and set(value) == {"not finite"}:
            spelling = value["not finite"]
            if spelling != "inf":
                raise _Refusal((*path, "not finite"), 'must be "inf"', spelling)
            return math.inf
        if not _fits(value, float) or not math.isfinite(value):
            raise _Refusal(path, self.rule, value)
        return self.number.read(value, path)

    def plain(self, value: Any, defaults: bool) -> Any:
        if math.isfinite(value):
            return self.number.plain(value, defaults)
        return None if self.null is not None else {"not finite": str(float(value))}

    def schema(self, definitions: _Definitions) -> dict[str, Any]:
        other = {"type": "null"} if self.null is not None else {"const": {"not finite": "inf"}}
        return self._worded({"anyOf": [self.number.schema(definitions), other]})


_SPELLING = '{"not finite": "inf"} where there is no finite one'


class _Optional(_Kind):
    """A value or null."""

    def __init__(self, value: _Kind, metas: Sequence[Meta]) -> None:
        super().__init__(metas, f"{value.rule} or null" if value.rule else "")
        self.value = value

    def read(self, value: Any, path: Path) -> Any:
        if value is None:
            return None
        try:
            return self.value.read(value, path)
        except _Refusal as refusal:
            if refusal.path == path and refusal.rule == self.value.rule:
                refusal.rule = self.rule
            raise

    def plain(self, value: Any, defaults: bool) -> Any:
        return None if value is None else self.value.plain(value, defaults)

    def schema(self, definitions: _Definitions) -> dict[str, Any]:
        return self._worded({"anyOf": [self.value.schema(definitions), {"type": "null"}]})


class _Items(_Kind):
    """Values in an order: any number of a kind, or as many as there are kinds."""

    def __init__(self, kinds: Sequence[_Kind], count: int | None, metas: Sequence[Meta]) -> None:
        rule = "must be an array" if count is None else f"must be an array of {count} items"
        super().__init__(metas, rule)
        self.kinds = kinds
        self.least = self.stated("min_length") or 0 if count is None else count
        self.most = self.stated("max_length") if count is None else count
        extra = self.stated("extra_json_schema") or {}
        self.differ = extra.get("uniqueItems", False)

    def read(self, value: Any, path: Path) -> Any:
        self._refuse_unless(isinstance(value, list | tuple), path, value)
        largest = len(value) if self.most is None else self.most
        self._refuse_unless(self.least <= len(value) <= largest, path, value)
        kinds = self._kinds_of(value)
        items = tuple(kinds[k].read(item, (*path, k)) for k, item in enumerate(value))
        self._refuse_unless(not self.differ or len(set(items)) == len(items), path, value)
        return items

    def _kinds_of(self, value: Sequence[Any]) -> Sequence[_Kind]:
        return (
            self.kinds
            if self.least == self.most == len(self.kinds)
            else [self.kinds[0]] * len(value)
        )

    def plain(self, value: Any, defaults: bool) -> Any:
        kinds = self._kinds_of(value)
        return [kind.plain(item, defaults) for kind, item in zip(kinds, value, strict=True)]

    def schema(self, definitions: _Definitions) -> dict[str, Any]:
        schema: dict[str, Any] = {"type": "array"}
        schemas = [kind.schema(definitions) for kind in self.kinds]
        if all(item == schemas[0] for item in schemas):
            schema["items"] = schemas[0]
        else:
            schema["prefixItems"] = schemas
        if self.least:
            schema["minItems"] = self.least
        if self.most is not None:
            schema["maxItems"] = self.most
        if self.differ:
            schema["uniqueItems"] = True
        return self._worded(schema)


class _Row(_Items):
    """A record that files hold as an array of its fields."""

    def __init__(self, record: _Record, metas: Sequence[Meta]) -> None:
        kinds = [field.kind for field in record.fields.values()]
        super().__init__(kinds, len(kinds), metas)
        self.record = record

    def read(self, value: Any, path: Path) -> Any:
        if isinstance(value, self.record.cls):
            return value
        return self.record.cls(*super().read(value, path))

    def plain(self, value: Any, defaults: bool) -> Any:
        items = [getattr(value, field.name) for field in self.record.fields.values()]
        return super().plain(items, defaults)


class _Named(_Kind):
    """Values by name or number."""

    def __init__(self, key: type, value: _Kind, metas: Sequence[Meta]) -> None:
        super().__init__(metas, "must be an object")
        self.key = key
        self.value = value
        self.least = self.stated("min_length") or 0

    def read(self, value: Any, path: Path) -> Any:
        self._refuse_unless(isinstance(value, Mapping) and len(value) >= self.least, path, value)
        return {
            self._key(key, path): self.value.read(item, (*path, key)) for key, item in value.items()
        }

    def _key(self, key: Any, path: Path) -> Any:
        if self.key is str:
            self._refuse_unless(isinstance(key, str), path, key, "must have texts as keys")
            return key
        is_number = re.fullmatch(r"-?\d{1,18}", str(key), re.ASCII) is not None
        self._refuse_unless(is_number, path, key, "must have whole numbers as keys")
        return int(key)

    def plain(self, value: Any, defaults: bool) -> Any:
        return {str(key): self.value.plain(item, defaults) for key, item in value.items()}

    def schema(self, definitions: _Definitions) -> dict[str, Any]:
        schema = {"type": "object", "additionalProperties": self.value.schema(definitions)}
        return self._worded({**schema, **({"minProperties": self.least} if self.least else {})})


class _FromOne(_Kind):
    """An index or a mapping by index that files count from 1."""

    def __init__(self, counted: _Kind) -> None:
        super().__init__(counted.metas, counted.rule)
        self.counted = counted

    def read(self, value: Any, path: Path) -> Any:
        counted = self.counted.read(value, path)
        if isinstance(counted, int):
            return counted - 1
        for key in counted:
            self._refuse_unless(key >= 1, path, str(key), "must have whole numbers from 1 as keys")
        return {key - 1: item for key, item in counted.items()}

    def plain(self, value: Any, defaults: bool) -> Any:
        if not isinstance(value, Mapping):
            return self.counted.plain(value + 1, defaults)
        return self.counted.plain({key + 1: item for key, item in value.items()}, defaults)

    def schema(self, definitions: _Definitions) -> dict[str, Any]:
        return self.counted.schema(definitions)


class _Array(_Kind):
    """Numbers in an array of a shape."""

    def __init__(self, annotation: Any, shape: Shape | None, metas: Sequence[Meta]) -> None:
        super().__init__(metas)
        if shape is None:
            raise TypeError(f"an array must have a Shape. Got {annotation}.")
        self.shape = shape
        (element,) = typing.get_args(typing.get_args(annotation)[1]) or (float,)
        self.dtype = element
        number = {"b": bool, "i": int}.get(element.__name__[0], float)
        self.number = _Scalar(number, [meta for meta in metas if meta.title is None])

    def read(self, value: Any, path: Path) -> Any:
        import numpy as np

        rows = self._rows(value, path, self.shape)
        try:
            array = np.array(rows, dtype=self.dtype)
        except ValueError:
            raise _Refusal(path, f"must have the shape {self.shape}", value) from None
        # without rows, nothing states the other lengths
        return array if array.size else np.zeros([n or 0 for n in self.shape], self.dtype)

    def _rows(self, value: Any, path: Path, shape: Sequence[int | None]) -> Any:
        if not shape:
            return self.number.read(value, path)
        if not isinstance(value, list | tuple) or shape[0] not in (None, len(value)):
            rule = self.stated("title") if len(shape) == len(self.shape) else None
            rule = rule or f"must have the shape {Shape(*shape)}"
            raise _Refusal(path, rule, value)
        return [self._rows(item, (*path, k), shape[1:]) for k, item in enumerate(value)]

    def plain(self, value: Any, defaults: bool) -> Any:
        import numpy as np

        if not np.isfinite(value).all():
            raise ValueError("a file must hold finite numbers. Got an array with others.")
        return np.asarray(value).tolist()

    def schema(self, definitions: _Definitions) -> dict[str, Any]:
        schema = self.number.schema(definitions)
        for k in reversed(range(len(self.shape))):
            length = self.shape[k]
            limits = {} if length is None else {"minItems": length, "maxItems": length}
            title = f"must have the shape {Shape(*self.shape[k:])}"
            schema = {"title": title, "type": "array", **limits, "items": schema}
        return {**schema, **self._worded({})}


@dataclasses.dataclass(frozen=True)
class _Field:
    """A field of a record."""

    name: str
    kind: _Kind
    default: Any
    is_derived: bool
    is_stated: bool = False

    @property
    def is_needed(self) -> bool:
        return self.is_stated or self.default is dataclasses.MISSING

    def is_default(self, value: Any) -> bool:
        """Tell whether a value is the default, and is left out; arrays never are."""
        if self.is_stated:
            return False
        if value is self.default:
            return True
        if isinstance(value, float) and math.isnan(value):
            return isinstance(self.default, float) and math.isnan(self.default)
        return (
            type(value) is type(self.default)
            and not hasattr(value, "dtype")
            and bool(value == self.default)
        )


class _Record(_Kind):
    """A dataclass or a named tuple."""

    def __init__(self, cls: type, fields: Mapping[str, _Field], metas: Sequence[Meta] = ()) -> None:
        super().__init__(metas, "must be an object")
        self.cls = cls
        self.fields = fields
        # a constructor may round, what files hold is rounded already
        self._make = getattr(cls, "as_stored", cls)

    def read(self, value: Any, path: Path) -> Any:
        if isinstance(value, self.cls):
            return value
        self._refuse_unless(isinstance(value, Mapping), path, value)
        self.check_keys(value, path)
        items = {
            key: field.kind.read(value[key], (*path, key))
            for key, field in self.fields.items()
            if key in value
        }
        arguments = {
            self.fields[key].name: item
            for key, item in items.items()
            if not self.fields[key].is_derived
        }
        try:
            record = self._make(**arguments)
        except ValueError as error:
            raise _Refusal(path) from error
        self._check_derived(record, items, path)
        return record

    def check_keys(self, data: Mapping[str, Any], path: Path) -> None:
        """Refuse an unknown key, and a missing one."""
        for key in data:
            if key not in self.fields:
                rule = f"must be left out, or renamed to one of {', '.join(self.fields)}"
                near = difflib.get_close_matches(str(key), self.fields, n=1)
                nearest = "".join(f"; the nearest is {name}" for name in near)
                raise _Refusal((*path, key), rule, got=f"an unknown field{nearest}")
        for key, field in self.fields.items():
            if field.is_needed and key not in data:
                raise _Refusal((*path, key), "must be given", got="none")

    def _check_derived(self, record: Any, items: Mapping[str, Any], path: Path) -> None:
        """Refuse what contradicts the other fields."""
        for key, field in self.fields.items():
            derived = getattr(record, field.name)
            if field.is_derived and not _alike(items[key], derived):
                rule = f"must be {shown(field.kind.plain(derived, True))}, as the other fields say"
                raise _Refusal((*path, key), rule, field.kind.plain(items[key], True))

    def plain(self, value: Any, defaults: bool) -> Any:
        data = {}
        for key, field in self.fields.items():
            item = getattr(value, field.name)
            if defaults or not field.is_default(item):
                data[key] = field.kind.plain(item, defaults)
        return data

    def schema(self, definitions: _Definitions) -> dict[str, Any]:
        name = self.cls.__name__
        if name not in definitions:
            definitions[name] = {}
            summary = (self.cls.__doc__ or "").partition("\n")[0]
            # a dataclass without words gets its signature
            words = {} if summary.startswith(f"{name}(") else {"description": summary}
            definitions[name] = {
                "title": "must be an object",
                **words,
                "type": "object",
                "required": [
                    key
                    for key, field in self.fields.items()
                    if field.is_needed or definitions.defaults
                ],
                "additionalProperties": False,
                "properties": {
                    key: field.kind.schema(definitions) for key, field in self.fields.items()
                },
            }
        stated = self._worded({}) if self.metas else {}
        return {**stated, "$ref": f"#/$defs/{name}"}


class _Variant(_Kind):
    """One of several records: by the field that names its kind, otherwise by the keys that are there."""

    def __init__(self, records: Sequence[_Record], metas: Sequence[Meta]) -> None:
        super().__init__(metas, "must be an object")
        self.records = records
        names = [set(record.fields) for record in records]
        common = [
            key
            for key in records[0].fields
            if key in set.intersection(*names) and all(_tags(record, key) for record in records)
        ]
        self.tag = common[0] if common else None

    def read(self, value: Any, path: Path) -> Any:
        if isinstance(value, tuple(record.cls for record in self.records)):
            return value
        self._refuse_unless(isinstance(value, Mapping), path, value)
        return self._record_of(value, path).read(value, path)

    def _record_of(self, value: Mapping[str, Any], path: Path) -> _Record:
        if self.tag is None:
            for record in self.records:
                if all(key in value for key, field in record.fields.items() if field.is_needed):
                    return record
            raise _Refusal(path, self.rule, value)
        kinds = {tag: record for record in self.records for tag in _tags(record, self.tag)}
        tag = value.get(self.tag)
        if self.tag not in value:
            raise _Refusal((*path, self.tag), "must be given", got="none")
        if not isinstance(tag, str) or tag not in kinds:
            raise _Refusal((*path, self.tag), _choice(list(kinds)), tag)
        return kinds[tag]

    def plain(self, value: Any, defaults: bool) -> Any:
        record = next(record for record in self.records if record.cls is type(value))
        data = record.plain(value, defaults)
        if self.tag is None:
            return data
        # the field that names the kind is written although it may be the default
        return {self.tag: getattr(value, record.fields[self.tag].name), **data}

    def schema(self, definitions: _Definitions) -> dict[str, Any]:
        return self._worded({"anyOf": [record.schema(definitions) for record in self.records]})


def _tags(record: _Record, key: str) -> tuple[Any, ...]:
    """Return the texts by which a field names the kind of its record."""
    kind = record.fields[key].kind
    if not isinstance(kind, _Scalar) or typing.get_origin(kind.type) is not Literal:
        return ()
    return typing.get_args(kind.type)


# From types to kinds.


@cache
def _record(cls: type) -> _Record:
    """Return the kind of a dataclass or a named tuple."""
    hints = typing.get_type_hints(cls, include_extras=True)
    fields = {}
    for name, default, is_derived in _declared(cls):
        marks = getattr(hints[name], "__metadata__", ())
        if NOT_STORED not in marks:
            key = next((mark.name for mark in marks if isinstance(mark, Key)), name)
            fields[key] = _Field(name, _kind(hints[name]), default, is_derived, STATED in marks)
    return _Record(cls, fields)


def _declared(cls: Any) -> list[tuple[str, Any, bool]]:
    """Return name and default of each field, `dataclasses.MISSING` if it has none, and whether it is derived."""
    if hasattr(cls, "_fields"):
        missing = dataclasses.MISSING
        return [(name, cls._field_defaults.get(name, missing), False) for name in cls._fields]
    return [(field.name, _default(field), not field.init) for field in dataclasses.fields(cls)]


def _default(field: dataclasses.Field[Any]) -> Any:
    factory = field.default_factory
    return field.default if factory is dataclasses.MISSING else factory()


def _kind(annotation: Any) -> _Kind:
    """Return the kind of a type."""
    marks: tuple[Any, ...] = ()
    if typing.get_origin(annotation) is Annotated:
        annotation, *marks_given = typing.get_args(annotation)
        marks = tuple(marks_given)
    if FROM_ONE in marks:
        others = tuple(mark for mark in marks if mark is not FROM_ONE)
        return _FromOne(_kind(Annotated[(annotation, *others)] if others else annotation))
    metas = [mark for mark in marks if isinstance(mark, Meta)]
    functions = [mark for mark in marks if isinstance(mark, Plain)]
    if functions:
        return _Made(functions[0], metas)
    if LATER in marks:
        return _Later(_kind(annotation), metas)
    nulls = [mark for mark in marks if isinstance(mark, NullIs)]
    if nulls or SPELLED in marks:
        return _Spelled(_Scalar(annotation, metas), nulls[0] if nulls else None)
    origin = typing.get_origin(annotation) or annotation
    arguments = typing.get_args(annotation)
    if hasattr(origin, "__value__"):
        # NDArray is an alias of its own from numpy 2.5 on; Annotated takes one mark at least
        return _kind(Annotated[(origin.__value__[arguments], *marks, None)])
    if origin in (Union, types.UnionType):
        return _union(arguments, marks, metas)
    if origin is Any or origin is object:
        return _Kind(metas)
    if origin is Literal:
        return _Scalar(annotation, metas)
    if getattr(origin, "__name__", "") == "ndarray":
        shapes = [mark for mark in marks if isinstance(mark, Shape)]
        return _Array(annotation, shapes[0] if shapes else None, metas)
    if dataclasses.is_dataclass(origin) or hasattr(origin, "_fields"):
        record = _record(origin)
        if ROW in marks:
            return _Row(record, metas)
        return _Record(record.cls, record.fields, metas) if metas else record
    if issubclass(origin, Mapping):
        return _Named(arguments[0], _kind(arguments[1]), metas)
    if issubclass(origin, Sequence) and not issubclass(origin, str):
        items = [argument for argument in arguments if argument is not ...]
        is_fixed = issubclass(origin, tuple) and len(items) == len(arguments)
        return _Items([_kind(item) for item in items], len(items) if is_fixed else None, metas)
    return _Scalar(annotation, metas)


def _union(members: Sequence[Any], marks: Sequence[Any], metas: Sequence[Meta]) -> _Kind:
    """Return the kind of a union: of null and a type, or of records."""
    others = [member for member in members if member is not type(None)]
    if len(others) == 1:
        value = _kind(Annotated[(others[0], *marks)] if marks else others[0])
    else:
        value = _Variant([typing.cast(_Record, _kind(member)) for member in others], metas)
    return value if len(others) == len(members) else _Optional(value, metas)
