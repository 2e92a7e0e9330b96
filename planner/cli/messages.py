"""Errors as somebody at a shell needs them: options as they are typed, none that only a call in Python has."""

from __future__ import annotations

import re

_HOW_IN_A_CALL = re.compile(r"\b\w+=(?:\[[^]]*\]|\S+) \(on the command line ([^)]*)\)")
_ONLY_IN_A_CALL = re.compile(r"; allow more with limits=ReadLimits\([^)]*\)")
_RULE = re.compile(
    r"(^|: |; |\. |')(contrast|gap_mm|min_corner_deg|occluders|select|separation_px|solids|step|surround_px|units)"
    r"(?= (?:must (?:be|hold|lie|name)|applies))"
)
# in a file these are fields, and the message begins with the file's name
_FIRST = re.compile(
    r"^(accuracy|entities|out|probability|min_length_px|field_margin_px|focus_margin_mm|stand_off_mm|visibility_radius_mm"
    r"|workspace)(?= must )"
)
# in a plan's file it is a field
_CAMERA = re.compile(r"\bcamera must be a name of the catalogue")
_MEMORY = re.compile(r"\bmemory_limit_bytes\b")
_REGIONS = re.compile(
    r", or for the regions only: compute_regions answers the same questions, and (?=a plan needs no)"
)
_PICTURE = re.compile(r"^path of a picture(?= must )")
_PART = re.compile(r"\bpath must name an existing part file")
_TYPED = {"step": "grey-step", "stand_off_mm": "stand-off"}
_SOLIDS = re.compile(r"\bsolids(?= does not say)")
_VALUE = re.compile(r"\b(gap_mm|occluders|solids|units)=(?=\S)")


def as_typed(text: str) -> str:
    """Return the message of an error with parameters named as the options of the command line.

    Parameters
    ----------
    text : str
        The message, as a call in Python raises it.
    """
    text = _HOW_IN_A_CALL.sub(r"\1", text)
    text = _ONLY_IN_A_CALL.sub("", text)
    text = _MEMORY.sub("--memory-limit", text)
    text = _REGIONS.sub(": ", text)
    text = _SOLIDS.sub("--solids", text)
    text = _PICTURE.sub("--picture", text)
    text = _PART.sub("the part must be an existing file", text)
    text = _CAMERA.sub(
        "--camera must be a TOML file, or a name that 'aspectgraph cameras' lists", text
    )
    text = _VALUE.sub(lambda found: f"{_option(found[1])} ", text)
    text = _FIRST.sub(lambda found: _option(found[1]), text)
    return _RULE.sub(lambda found: found[1] + _option(found[2]), text)


def _option(name: str) -> str:
    return "--" + _TYPED.get(name, name).replace("_", "-")
