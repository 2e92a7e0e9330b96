"""Names of the images that the settings of a plan take."""

from __future__ import annotations


def setting_name(setting_idx: int, image_idx: int | None = None) -> str:
    """Return the name of a setting, such as "setting_01", or of one of its images, such as "setting_01_2".

    Parameters
    ----------
    setting_idx : int
        Number of the setting, from 0.
    image_idx : int, optional
        Number of the image, from 0, of a setting that takes several, each with other lamps.
    """
    stem = f"setting_{setting_idx + 1:02d}"
    return stem if image_idx is None else f"{stem}_{image_idx + 1}"


def image_name(setting_idx: int, image_idx: int | None = None) -> str:
    """Return the file name of the image that a setting takes, see `setting_name`."""
    return f"{setting_name(setting_idx, image_idx)}.png"
