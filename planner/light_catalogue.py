"""The catalogue of real lights: backlights, domes, coaxial lights and rings, read from ``light_catalogue.toml``."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Mapping
from functools import cache
from importlib import resources
from typing import Any

from planner.exceptions import RequestError


@cache
def light_parts() -> dict[str, dict[str, dict[str, Any]]]:
    """Return the lights of the catalogue with their sizes and where these were read.

    Returns
    -------
    dict
        By kind and name: sizes in mm, and ``source``, an address or empty where the size is a typical one of no maker.
    """
    text = resources.files("planner").joinpath("light_catalogue.toml").read_text(encoding="utf-8")
    return {
        kind: {name: {**facts, "source": facts.get("source", "")} for name, facts in of.items()}
        for kind, of in tomllib.loads(text).items()
    }


def light_names() -> tuple[str, ...]:
    """Return the names of the lights in the catalogue, as ``--light`` takes them.

    Returns
    -------
    tuple of str
        ``KIND:NAME`` each, in the order of the catalogue.

    Examples
    --------
    >>> from planner import light_names
    >>> "backlight:basler-back-100x100" in light_names()
    True
    """
    return tuple(f"{kind}:{name}" for kind, of in light_parts().items() for name in of)


def light_facts(kind: str, name: str) -> Mapping[str, Any]:
    """Return the sizes of a light of the catalogue.

    Raises
    ------
    RequestError
        If there is no such name of the kind.
    """
    of_kind = light_parts()[kind]
    facts = of_kind.get(name.lower())
    if facts is None:
        near = difflib.get_close_matches(name.lower(), of_kind, n=3, cutoff=0.3) or list(of_kind)
        rule = f"must name a light of kind {kind} in the catalogue"
        raise RequestError.of_rule("light", rule, repr(name), hint=f"nearest: {', '.join(near)}")
    return facts
