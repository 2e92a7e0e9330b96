"""How the poses of images will be known when values are read, and what that tells of a setting."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray

from ground.convert import Meta
from planner.camera.pose import Covariance, PoseUncertainty
from planner.plan_file import Amount

if TYPE_CHECKING:
    from planner.request.models import Means


OWN_EDGES = "own edges"
GIVEN = "given"
PLANNED = "planned"


@dataclass(frozen=True)
class RegistrationRecord:
    """How the poses of images will be known.

    Attributes
    ----------
    method : str
        "own edges": from the part's own edges in each image. "given": as surely as ``pose_uncertainty`` says.
        "planned": no better than planned. Unlike a request that states nothing, images need not be registered.
    surfaces_mm : float or None
        Standard deviation of the position of faces along their normals. None is that of the targets.
    pose_uncertainty : PoseUncertainty or None
        Of given poses.
    """

    method: str
    surfaces_mm: float | None = None
    pose_uncertainty: PoseUncertainty | None = None


# What is known of a setting's pose when its values are read.


LEAST_POSE = np.array([1e-4] * 3 + [1e-6] * 3)
"""Standard deviations of poses that are said to be exact, mm and rad."""


@dataclass(frozen=True, eq=False)
class PoseKnowledge:
    """What is known of a pose after registration.

    Attributes
    ----------
    covariance : array (6, 6)
        Of how far the camera may be from where registration puts it, as `PoseUncertainty` has it.
    by_surfaces : mapping of str to float
        Standard deviation of values by the deviations of surfaces, beside that by the pose; by target, in its unit.
        A target without one has that of its own surfaces.
    by_edge : mapping of str to array (6, 6)
        The covariance for the length of an edge, where nothing is assumed of the faces at its ends; by target.
    """

    covariance: Covariance
    by_surfaces: Annotated[Mapping[str, Amount], Meta(title="must map names to amounts")] = field(
        default_factory=dict
    )
    by_edge: Annotated[Mapping[str, Covariance], Meta(title="must map names to covariances")] = (
        field(default_factory=dict)
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "covariance", self.pose_uncertainty.covariance)

    @property
    def pose_uncertainty(self) -> PoseUncertainty:
        """How far the camera may be from where registration puts it."""
        return PoseUncertainty(self.covariance)

    def of_target(self, means: Means, name: str) -> Means:
        """Return what a target is measured with at this pose."""
        return replace(
            means,
            pose_uncertainty=PoseUncertainty(self.by_edge.get(name, self.covariance)),
            by_surfaces=self.by_surfaces.get(name),
            own_edges=None,
        )

    def with_prior(self, before: NDArray[np.float64], now: NDArray[np.float64]) -> PoseKnowledge:
        """Return what is known if another covariance was known before the image.

        Parameters
        ----------
        before, now : array (6, 6)
            The covariance of the camera's displacement that this is from, and the other one.
        """
        by_edge = {
            name: _with_prior(covariance, before, now) for name, covariance in self.by_edge.items()
        }
        return replace(self, covariance=_with_prior(self.covariance, before, now), by_edge=by_edge)


def _with_prior(
    known: Covariance, before: NDArray[np.float64], now: NDArray[np.float64]
) -> Covariance:
    """Return a covariance (6, 6) after the image as it is if another one was known before."""
    floor = np.diag(LEAST_POSE**2)
    root = np.sqrt(np.diag(now + floor))
    units = np.outer(root, root)
    old, new, after = (
        np.linalg.inv((covariance + floor) / units) for covariance in (before, now, known)
    )
    # what the image tells is not negative
    values, vectors = np.linalg.eigh(after - old)
    image = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return symmetric(np.linalg.inv(new + image) * units).covariance


def symmetric(covariance: NDArray[np.float64]) -> PoseUncertainty:
    """Return a pose uncertainty from a covariance (6, 6) whose last digits may not be symmetric."""
    return PoseUncertainty((covariance + covariance.T) / 2)


def means_at(means: Means, setting: Any, name: str) -> Means:
    """Return what a target of a setting is measured with.

    Parameters
    ----------
    means : Means
        Those of the plan.
    setting : SensorSetting
        With or without knowledge of its pose.
    name : str
        The target.
    """
    known = getattr(setting, "registered", None)
    return means if known is None else known.of_target(means, name)
