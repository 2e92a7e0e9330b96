"""The catalogue of real cameras: bodies, lenses and pairs of them, read from ``catalogue.toml``."""

from __future__ import annotations

import difflib
import json
import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import resources
from typing import Any

from planner.exceptions import CameraError, RequestError

# A camera as the text of a TOML file.


def toml_text(fields: Mapping[str, Any]) -> str:
    """Return fields as TOML, one to a line; None is left out, because TOML has no word for it.

    Parameters
    ----------
    fields : mapping of str to value
        Texts, numbers, and sequences of them.
    """
    lines = [f"{key} = {_value(value)}" for key, value in fields.items() if value is not None]
    return "\n".join(lines) + "\n"


def _value(value: Any) -> str:
    if isinstance(value, str):
        # TOML forbids DEL, which JSON leaves as it is
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(_value, value))}]"
    # the shortest digits that give the same number back
    return repr(value)


# what a camera takes from its body
_BODY = ("pixel_pitch_mm", "resolution")


def camera_names() -> tuple[str, ...]:
    """Return the names of the cameras in the catalogue, sorted.

    Returns
    -------
    tuple of str
        Names for `Camera.named`. Each is a camera with a lens.

    Examples
    --------
    >>> from planner import camera_names
    >>> "basler-acA2440-20gm-8mm" in camera_names()
    True
    """
    return tuple(sorted(catalogued()))


def camera_parts() -> dict[str, dict[str, dict[str, Any]]]:
    """Return the bodies and lenses of the catalogue with the facts of their data sheets and where these were read.

    Returns
    -------
    dict
        ``"body"`` and ``"lens"``: by name, the facts, their ``source`` (an address), and ``maker``: whether that is the
        maker's own page.
    """
    data = _data()
    return {
        kind: {name: {"maker": True, **facts} for name, facts in data[kind].items()}
        for kind in ("body", "lens")
    }


def check_bodies(names: Sequence[str]) -> None:
    """Raise `RequestError` unless all names are bodies of the catalogue."""
    bodies = _data()["body"]
    for name in names:
        if name not in bodies:
            rule = f"must be of the catalogue: {', '.join(bodies)}"
            raise RequestError.of_rule("bodies", rule, repr(name))


@cache
def _data() -> dict[str, Any]:
    text = resources.files("planner.camera").joinpath("catalogue.toml").read_text(encoding="utf-8")
    return dict(tomllib.loads(text))


@cache
def catalogued() -> dict[str, tuple[dict[str, Any], dict[str, Any]]]:
    """Read the catalogue: the fields of each camera, and its lens.

    Bodies and lenses hold data-sheet facts, pairs say which are mounted and how they are set.
    """
    data = _data()
    cameras = {}
    for name, pair in data["pair"].items():
        body = {k: data["body"][pair["body"]][k] for k in _BODY}
        lens = data["lens"][pair["lens"]]
        settings = {key: value for key, value in pair.items() if key not in ("body", "lens")}
        cameras[name] = {"focal_length_mm": lens["focal_length_mm"], **body, **settings}, lens
    return cameras


def find_camera(name: str) -> tuple[str, dict[str, Any], dict[str, Any]]:
    """Return the name of a camera as the catalogue spells it, its fields and its lens; or raise `CameraError`."""
    keys = {key.lower(): key for key in catalogued()}
    key = keys.get(str(name).lower())
    if key is None:
        near = (
            difflib.get_close_matches(str(name).lower(), keys, n=3, cutoff=0.3) or sorted(keys)[:3]
        )
        offered = ", ".join(keys[n] for n in near)
        raise CameraError.of_rule(
            "camera", "must be a name of the catalogue", repr(str(name)), hint=f"nearest: {offered}"
        )
    return key, *catalogued()[key]


def check_lens(lens: Mapping[str, Any], f_number: float, focus_distance_mm: float) -> None:
    """Raise `CameraError` unless a lens of the catalogue can be set so."""
    widest = lens["widest_f_number"]
    narrowest = lens["narrowest_f_number"]
    closest = lens["closest_object_mm"]
    if not widest <= f_number <= narrowest:
        raise CameraError.of_rule(
            "f_number", f"must be in {widest:g} to {narrowest:g}, the lens's range", f"{f_number:g}"
        )
    if focus_distance_mm < closest:
        raise CameraError.of_rule(
            "focus_distance_mm",
            f"must be at least {closest:g}, the lens's closest object",
            f"{focus_distance_mm:g}",
        )
