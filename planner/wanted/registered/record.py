"""How the poses of images will be known when values are read, as a request states it."""

from __future__ import annotations

from dataclasses import dataclass

from planner.camera.pose_uncertainty import PoseUncertainty

OWN_EDGES = "own edges"
GIVEN = "given"


@dataclass(frozen=True)
class RegistrationRecord:
    """How the poses of images will be known.

    Attributes
    ----------
    method : str
        "own edges": from the part's own edges in each image. "given": as surely as ``pose_uncertainty`` says.
    surfaces_mm : float or None
        Standard deviation of the position of faces along their normals. None is that of the targets.
    pose_uncertainty : PoseUncertainty or None
        Of given poses.
    """

    method: str
    surfaces_mm: float | None = None
    pose_uncertainty: PoseUncertainty | None = None
