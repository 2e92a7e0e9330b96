"""Arguments of the wrong type, in the wrong order or out of their range are refused in one line."""

from __future__ import annotations

import inspect
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from difflib import get_close_matches
from functools import wraps
from numbers import Integral, Real
from typing import Any, NamedTuple, ParamSpec, TypeVar, cast

from planner.exceptions import RequestError

_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")

ITEMS = "mapping or sequence"
"""What names the items of a request; a text is none."""

MAPPING = "mapping"
"""Names the items of a request by keys."""

POSES = "pose or list of poses"
"""A `GivenPose`, a file of them, a list, or an array (4, 4) or (n, 4, 4). Its shape is checked elsewhere."""

OF_MODEL = "write wanted, left_out = dimensions_to_plan(stated) and pass wanted"
"""Says how dimensions of a CAD model become a request."""

_HINTS = {
    "Solid": "read_solid reads one from a file",
    "Cell": "Cell.from_toml reads one from a file",
    "Camera": "Camera.named and Camera.from_toml make one",
    "PoseUncertainty": "PoseUncertainty.isotropic makes one",
    "Effort": "Effort.named makes one",
    "InspectionPlan": "read_plan reads one from a file",
    "Registration": "Registration.own_edges and Registration.none make one",
    "DecisionRule": "DecisionRule.iso14253 makes one",
    "Localisation": "Localisation.gaussian makes one",
    "MeasurementResults": "measure makes them",
    "Material": "Material('metal') makes one",
    "InspectionOptions": "InspectionOptions(accuracy=0.95) makes one",
    "PartRequest": "it holds camera, pose_uncertainty and what to measure",
    ITEMS: "read_entities reads a text, and select_entities takes a rule",
}
_LONGEST = 40
_LEAST_ACCURACY = 0.5
# what the command line calls them, and what others do
_OTHER_WORDS = {
    "seed": "rng",
    "light": "lamps",
    "register": "registration",
    "edges": "edge_break_mm",
    "time_limit": "time_limit_s",
}


class NumberRule(NamedTuple):
    """A range of numbers.

    Attributes
    ----------
    text : str
        The rule, beginning with its verb.
    holds : callable
        ``holds(number)`` returns whether a number is in the range.
    """

    text: str
    holds: Callable[[float], bool]

    def accepts(self, value: Any) -> bool:
        """Return whether a value is a finite number in the range; a truth value is no number."""
        if not isinstance(value, Real) or isinstance(value, bool):
            return False
        try:
            number = float(value)
        except OverflowError:
            # a whole number beyond all floats
            return False
        return math.isfinite(number) and self.holds(number)


NOT_NEGATIVE = NumberRule("must be finite and not negative", lambda number: number >= 0)
POSITIVE = NumberRule("must be positive", lambda number: number > 0)
POSITIVE_SECONDS = NumberRule("must be a positive number of seconds", POSITIVE.holds)
BETWEEN_0_AND_1 = NumberRule("must be in (0, 1)", lambda number: 0 < number < 1)
FROM_0_BELOW_1 = NumberRule("must be in [0, 1)", lambda number: 0 <= number < 1)
ABOVE_0_TO_1 = NumberRule("must be in (0, 1]", lambda number: 0 < number <= 1)


def check_number(name: str, value: Any, rule: NumberRule) -> float:
    """Return a number, or raise `RequestError` with its name if it breaks its rule."""
    if not rule.accepts(value):
        raise RequestError.of_rule(name, rule.text, shown(value))
    return float(value)


def check_fraction(name: str, value: Any) -> float:
    """Return a number in (0, 1) or raise `RequestError`."""
    return check_number(name, value, BETWEEN_0_AND_1)


def check_accuracy(value: Any) -> float:
    """Return an accuracy, or raise `RequestError`; one below 0.5 was rather meant as the permitted error.

    Parameters
    ----------
    value : float
        0.98 permits an error of 2 %.
    """
    accuracy = check_fraction("accuracy", value)
    if accuracy < _LEAST_ACCURACY:
        raise RequestError.of_rule(
            "accuracy",
            f"must be at least {_LEAST_ACCURACY:g}, because 0.98 permits an error of 2%",
            shown(value),
            hint=f"write {1 - accuracy:g} for an error of {100 * accuracy:g}%",
        )
    return accuracy


def check_count(name: str, value: Any, least: int, most: int | None = None) -> None:
    """Raise `RequestError` unless a value is an integer between two others, both included."""
    if isinstance(value, bool) or not isinstance(value, Integral) or int(value) < least:
        raise RequestError.of_rule(name, f"must be an integer of at least {least}", shown(value))
    if most is not None and int(value) > most:
        raise RequestError.of_rule(name, f"must be at most {most:g}", shown(value))


def check_kinds(**given: tuple[object, str]) -> None:
    """Refuse an argument whose type is wrong; say so if it is that of another argument.

    Types are compared by their names, so that nothing is loaded for it.

    Parameters
    ----------
    **given : (object, str)
        Value and name of the type, by parameter, in the order of the call.

    Raises
    ------
    RequestError
        Names the parameter.
    """
    for parameter, (value, kind) in given.items():
        if _is(value, kind):
            continue
        hint = _HINTS.get(kind, "")
        if kind in (ITEMS, MAPPING) and _of_model(value):
            hint = OF_MODEL
        if any(_is(value, other) for _, other in given.values()):
            hint = f"the order of the arguments is {', '.join(given)}"
        elif kind == POSES:
            continue
        rule = f"must be {with_article(kind)}"
        raise RequestError.of_rule(parameter, rule, kind_shown(value), hint=hint)


def check_list(name: str, values: object, kind: str, hint: str) -> None:
    """Raise `RequestError` unless a value is a list of a type; the hint says what makes one."""
    rule = f"must be a list of {kind}"
    if not _is(values, ITEMS) or isinstance(values, Mapping):
        raise RequestError.of_rule(name, rule, kind_shown(values), hint=hint)
    for value in cast("Sequence[object]", values):
        if not _is(value, kind):
            raise RequestError.of_rule(name, rule, f"a list with {kind_shown(value)}", hint=hint)


def check_callable(name: str, value: object) -> None:
    """Raise `RequestError` unless a value is None or can be called."""
    if value is not None and not callable(value):
        raise RequestError.of_rule(name, "must be a callable", kind_shown(value))


def check_path(name: str, value: object) -> None:
    """Raise `RequestError` unless a value is a path."""
    if not isinstance(value, str | os.PathLike):
        raise RequestError.of_rule(name, "must be a path", kind_shown(value))


def check_space(space: object, *, may_be_part: bool = False) -> None:
    """Raise `RequestError` unless a value holds the visible regions of a part; some calls also take the part."""
    if not hasattr(space, "solid"):
        part = "a Solid, " if may_be_part else ""
        rule = f"must be {part}VisibilityRegions or an EntityAspectGraph"
        got = f"an object of type {type(space).__name__}"
        raise RequestError.of_rule("space", rule, got, hint="compute_regions makes the former")


def check_keywords(call: str, given: Iterable[str], known: Sequence[str]) -> None:
    """Refuse a keyword that a call does not have, and name the one that may be meant.

    Parameters
    ----------
    call : str
        Name of the call.
    given : iterable of str
        The keywords.
    known : sequence of str
        Those that it has.

    Raises
    ------
    TypeError
        As Python does for calls that name their keywords.
    """
    for name in given:
        if name in known:
            continue
        starting = [word for word in known if word.startswith(name)]
        near = starting or get_close_matches(name, known)
        meant = _OTHER_WORDS.get(name) or next(iter(near), "")
        hint = f"; did you mean {meant!r}?" if meant else ""
        raise TypeError(f"{call}() has no argument {name!r}{hint}")


def show_keywords(
    function: Callable[..., Any], keywords: type, defaults: Mapping[str, Any]
) -> None:
    """Let help and completion list the keywords that a call takes together; type checkers read its annotation.

    Parameters
    ----------
    function : callable
        The call, with ``**`` for these keywords.
    keywords : TypedDict
        What they are.
    defaults : mapping of str to value
        Their defaults; others are None.
    """
    signature = inspect.signature(function)
    shown = [item for item in signature.parameters.values() if item.kind is not item.VAR_KEYWORD]
    for name, kind in keywords.__annotations__.items():
        text = getattr(kind, "__forward_arg__", kind)
        default = defaults.get(name)
        shown.append(
            inspect.Parameter(
                name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=text
            )
        )
    function.__signature__ = signature.replace(parameters=shown)  # type: ignore[attr-defined]


def suggests_names(
    function: Callable[_Parameters, _Result],
) -> Callable[_Parameters, _Result]:
    """Return a call that refuses a keyword which it does not have, and names the one that may be meant."""
    parameters = [name for name in inspect.signature(function).parameters if name != "self"]

    @wraps(function)
    def checked(*args: _Parameters.args, **keywords: _Parameters.kwargs) -> _Result:
        check_keywords(function.__name__, keywords, parameters)
        return function(*args, **keywords)

    return checked


def names_meant(kind: type[_Result]) -> type[_Result]:
    """Return a class that refuses a keyword which it does not have, and names the one that may be meant."""
    original = kind.__init__
    parameters = [name for name in inspect.signature(original).parameters if name != "self"]

    @wraps(original)
    def checked(self: Any, *args: Any, **keywords: Any) -> None:
        check_keywords(kind.__name__, keywords, parameters)
        original(self, *args, **keywords)

    kind.__init__ = checked  # type: ignore[method-assign]
    return kind


def takes_names(
    rule: str, example: str
) -> Callable[[Callable[_Parameters, _Result]], Callable[_Parameters, _Result]]:
    """Return a decorator for a call whose arguments all need their names, with its refusal in one line.

    Parameters
    ----------
    rule : str
        The names, with units.
    example : str
        A right call.
    """

    def decorate(function: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
        signature = inspect.signature(function)
        call = f"{function.__qualname__}()"

        @wraps(function)
        def checked(*args: _Parameters.args, **keywords: _Parameters.kwargs) -> _Result:
            try:
                signature.bind(*args, **keywords)
            except TypeError:
                got = _arguments(args[1:], keywords)
                text = f"{call} takes {rule}, each by its name. Got {got}; write {example}."
                raise TypeError(text) from None
            return function(*args, **keywords)

        return checked

    return decorate


def _arguments(values: Sequence[object], keywords: Mapping[str, object]) -> str:
    """Return what a call got: the values without a name, and the names."""
    texts = [kind_shown(value) for value in values]
    if texts:
        return f"{' and '.join(texts)} without a name"
    return ", ".join(keywords) if keywords else "no argument"


def shown(value: object, text: Callable[[Any], str] = repr) -> str:
    """Return a value as Python writes it, shortened to a readable length."""
    if isinstance(value, int) and value.bit_length() > 240:
        return f"an integer of {value.bit_length()} bits"
    line = text(value)
    if "\n" in line:
        # arrays have a line per row
        line = " ".join(line.split())
    return _cut(line, 80)


def _is(value: object, kind: str) -> bool:
    if kind == ITEMS:
        return isinstance(value, Mapping | Sequence) and not isinstance(value, str | bytes)
    if kind == MAPPING:
        return isinstance(value, Mapping)
    if kind == POSES:
        return _is_poses(value)
    return kind in (ancestor.__name__ for ancestor in type(value).__mro__)


def _is_poses(value: object) -> bool:
    """Return whether a value is surely one or more poses."""
    if isinstance(value, list | tuple) and value:
        return _is_poses(value[0])
    if tuple(getattr(value, "shape", ()))[-2:] == (4, 4):
        return True
    return any(_is(value, kind) for kind in ("GivenPose", "PoseFile"))


def kind_of_model(value: object) -> bool:
    """Return whether a value is a requirement of a CAD model, which is no request yet."""
    kinds = ("ModelDimension", "GeometricTolerance", "ModelRequirements")
    return any(_is(value, kind) for kind in kinds)


def _of_model(value: object) -> bool:
    """Return whether a value is what `dimensions_to_plan` takes or returns."""
    if not isinstance(value, list | tuple):
        return kind_of_model(value)
    return any(isinstance(item, Mapping) or kind_of_model(item) for item in value)


def kind_shown(value: object) -> str:
    """Return a short value itself, of others the type."""
    name = type(value).__name__
    if value is None or isinstance(value, int | float | str):
        return _cut(repr(value), _LONGEST)
    return with_article(name)


def _cut(text: str, longest: int) -> str:
    """Return a text of at most this length; what began with a quote ends with it."""
    if len(text) <= longest:
        return text
    quote = text[0] if text[0] in "'\"" else ""
    return f"{text[: longest - 3 - len(quote)]}...{quote}"


def with_article(words: str) -> str:
    """Return words behind their indefinite article."""
    return f"{'an' if words[0] in 'AEIOUaeiou' else 'a'} {words}"
