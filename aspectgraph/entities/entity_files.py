"""Entities as the command line takes them: all edges, ids, or a file of names."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

from aspectgraph.entities.straight_edges import Entity, resolve_entities
from aspectgraph.exceptions import EntityError
from aspectgraph.solid.solid import Solid

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


def read_entities(text_or_path: str | Path, solid: Solid, tolerance_mm: float | None = None) -> dict[str, Entity]:
    """Read entities as the command line takes them.

    Parameters
    ----------
    text_or_path : str or Path
        ``"all"`` for every straight sharp edge; ids such as ``"17, 18"``, ``"e17 e18"`` or, of rims and arcs,
        ``"r3, a0"``; or the path of a .toml or .json file with ``name = id``, ``name = "r3"`` or
        ``name = [[x, y, z], [x, y, z]]``, at top level or in a table ``entities``.
    solid : Solid
        The part.
    tolerance_mm : float, optional
        See `resolve_entities`.

    Returns
    -------
    dict of str to Entity
        By name, in the order given.

    Raises
    ------
    EntityError
        The text is none of these, or an entity is not a sharp straight edge, rim or arc.
    """
    text = str(text_or_path).strip()
    if text.lower() == "all":
        return resolve_entities(solid, [edge.id for edge in solid.straight_edges()], tolerance_mm)
    if Path(text).suffix.lower() in (".toml", ".json"):
        return resolve_entities(solid, _read_file(Path(text)), tolerance_mm)
    words = [word for word in re.split(r"[\s,;]+", text) if word]
    bad = [word for word in words if not re.fullmatch(r"[era]?\d+", word)]
    if bad or not words:
        raise EntityError(
            "entities must be 'all', ids such as 17,18 or r3,a0, or the path of a .toml or .json file. "
            f"Got {bad[0] if bad else text!r}."
        )
    return resolve_entities(solid, [word if word[0] in "ra" else int(word.lstrip("e")) for word in words], tolerance_mm)


def _read_file(path: Path) -> Any:
    if not path.is_file():
        raise EntityError(f"entities must name an existing file. Got {str(path)!r}.")
    try:
        text = path.read_text(encoding="utf-8")
        content = json.loads(text) if path.suffix.lower() == ".json" else tomllib.loads(text)
    except (json.JSONDecodeError, tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise EntityError(
            f"an entity file must be valid {path.suffix[1:].upper()}. Got {path.name}: {error}."
        ) from error
    if isinstance(content, dict) and isinstance(content.get("entities"), dict | list):
        content = content["entities"]
    if not isinstance(content, dict | list):
        raise EntityError(f"an entity file must hold names or edge ids. Got {path.name} with {type(content).__name__}.")
    return content
