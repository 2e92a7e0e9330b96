"""Arguments of the wrong type, or in the wrong order, are refused in one line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from planner.exceptions import RequestError

ITEMS = "mapping or sequence"
"""What names the items of a request; a text is none."""

MAPPING = "mapping"
"""Names the items of a request by keys."""

_HINTS = {
    "Solid": "read_solid reads one from a file",
    "Camera": "Camera.named and Camera.from_toml make one",
    "PoseUncertainty": "PoseUncertainty.isotropic makes one",
    "Effort": "Effort.named makes one",
    "InspectionPlan": "read_plan reads one from a file",
    ITEMS: "read_entities reads one from a text",
}
_LONGEST = 40


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
        if any(_is(value, other) for _, other in given.values()):
            hint = f"the order of the arguments is {', '.join(given)}"
        rule = f"must be {_article(kind)} {kind}"
        raise RequestError.of_rule(parameter, rule, _shown(value), hint=hint)


def _is(value: object, kind: str) -> bool:
    if kind == ITEMS:
        return isinstance(value, Mapping | Sequence) and not isinstance(value, str | bytes)
    if kind == MAPPING:
        return isinstance(value, Mapping)
    return kind in (one.__name__ for one in type(value).__mro__)


def _shown(value: object) -> str:
    """Return a short value itself, of others the type."""
    name = type(value).__name__
    if value is None or isinstance(value, int | float | str):
        text = repr(value)
        return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
    return f"{_article(name)} {name}"


def _article(name: str) -> str:
    return "an" if name[0] in "AEIOU" else "a"
