"""The camera that ``--camera`` names; it loads nothing that takes long."""

from __future__ import annotations

from pathlib import Path

from planner.camera.camera import Camera
from planner.exceptions import CameraError


def read_camera(text: str) -> Camera:
    """Return the camera of a TOML file, or the one with that name in the catalogue."""
    path = Path(text)
    if path.suffix.lower() == ".toml" or path.is_file():
        try:
            return Camera.from_toml(path)
        except CameraError as error:
            # begins with the file, and the line that breaks a rule
            raise CameraError(f"--camera {error}") from None
    try:
        return Camera.named(text)
    except CameraError as error:
        if error.parameter != "camera":
            raise
        rule = "must be a TOML file, or a name that 'aspectgraph cameras' lists"
        raise CameraError.of_rule("camera", rule, error.got, hint=error.hint) from None
