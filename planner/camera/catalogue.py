"""The catalogue of real cameras: bodies, lenses and pairs of them, read from ``catalogue.toml``."""

from __future__ import annotations

from functools import cache
from importlib import resources
from typing import Any

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    import tomli as tomllib  # type: ignore[no-redef]


def camera_names() -> tuple[str, ...]:
    """Return the names of the catalogue, sorted.

    Returns
    -------
    tuple of str
        Names for `Camera.named`, each of a body and a lens.
    """
    return tuple(sorted(catalogued()))


@cache
def catalogued() -> dict[str, tuple[dict[str, Any], dict[str, Any]]]:
    """Read the catalogue: the fields of each camera, and its lens.

    Bodies and lenses hold data-sheet facts, pairs say which are mounted and how they are set.
    """
    data = tomllib.loads(resources.files("planner.camera").joinpath("catalogue.toml").read_text(encoding="utf-8"))
    cameras = {}
    for name, pair in data["pair"].items():
        body, lens = data["body"][pair["body"]], data["lens"][pair["lens"]]
        settings = {key: value for key, value in pair.items() if key not in ("body", "lens")}
        cameras[name] = {"focal_length_mm": lens["focal_length_mm"], **body, **settings}, lens
    return cameras
