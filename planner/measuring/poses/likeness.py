"""What an image shows that does not show its setting: another setting, turned, mirrored, without distortion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from planner.measuring.image.picture import Picture
from planner.measuring.part_model import PartModel
from planner.measuring.poses.register import register
from planner.measuring.poses.registered import Registered
from planner.measuring.poses.task import NotRegisteredError
from planner.setting.image_names import setting_name

Array = NDArray[np.float64]

BETTER_MISFIT = 0.8
"""An image is taken to be undistorted if its misfit falls to this share without the lens distortion."""
SIMILAR_USED = 0.9
"""Then, at least this share of the samples still agrees."""

_UNDISTORTED = (
    "it looks undistorted, and the plan's camera has lens distortion: "
    "use the images as the camera takes them"
)
# settings that an image is compared with
_MOST_LOOKS = 30


def looks_like(
    model: PartModel, pictures: list[Picture], poses: list[Array], setting: int, prior: Array
) -> str:
    """Say what images show that do not show their setting; empty if that is not known.

    Parameters
    ----------
    model : PartModel
        The part.
    pictures : list of Picture
        Images of one setting.
    poses : list of array (4, 4)
        Planned poses of all settings.
    setting : int
        Which setting it should be.
    prior : array (n, n)
        What is known of pose and surfaces.

    Returns
    -------
    str
        Words after "it".
    """
    tried = [
        (f"looks like {setting_name(k)}", pictures, pose)
        for k, pose in enumerate(poses[:_MOST_LOOKS])
        if k != setting
    ]
    own = poses[setting]
    tried.append(("looks turned by 180 degrees", [one.turned() for one in pictures], own))
    tried.append(("looks mirrored", [one.mirrored() for one in pictures], own))
    if pictures[0].camera.distortion is not None:
        tried.append((_UNDISTORTED.removeprefix("it "), _undistorted(pictures), own))
    for text, shown, pose in tried:
        try:
            register(model, shown, pose, prior)
        except NotRegisteredError:
            continue
        return text
    return ""


def check_lens(
    model: PartModel, pictures: list[Picture], pose: Array, prior: Array, found: Registered
) -> None:
    """Refuse images without the lens distortion that the plan's camera has.

    Parameters
    ----------
    model : PartModel
        The part.
    pictures : list of Picture
        Images of one setting.
    pose : array (4, 4)
        Its planned pose.
    prior : array (n, n)
        What is known of pose and surfaces.
    found : Registered
        Their registration with the distortion.

    Raises
    ------
    NotRegisteredError
        If the part fits much better without the distortion.
    """
    if pictures[0].camera.distortion is None:
        return
    try:
        other = register(model, _undistorted(pictures), pose, prior)
    except NotRegisteredError:
        return
    better = other.misfit_px < BETTER_MISFIT * found.misfit_px
    if better and other.used >= SIMILAR_USED * found.used:
        raise NotRegisteredError(_UNDISTORTED)


def _undistorted(pictures: list[Picture]) -> list[Picture]:
    """Return images as those of a camera without distortion."""
    return [replace(one, camera=replace(one.camera, distortion=None)) for one in pictures]
