"""How sure a value is measured from a pose: probability of a small error, uncertainty, budget."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from errors.checks import (
    check_covariance,
    check_not_negative,
    check_pixel_pitch,
    check_positive,
    covariance_root,
)
from errors.exceptions import InvalidParameterError, InvalidShapeError
from errors.joint import quadratic_probability
from errors.measurands.conformity import COVERAGE
from errors.measurands.fitted import is_short
from errors.measurands.geometry import Localisation
from errors.measurands.measurand import Expansion, Image, Measurand
from errors.registration.known_poses import KnownPoses

# what a normal variable is within one and two standard deviations of its mean with
_ONE = math.erf(1 / math.sqrt(2))
_TWO = math.erf(2 / math.sqrt(2))
_BISECTIONS = 60

SOURCES = ("translation", "rotation", "localisation", "localisation_floor", "surfaces")
"""What the variance of a measured value comes from."""


@dataclass(frozen=True)
class Prediction:
    """How sure a value is measured from one pose.

    Attributes
    ----------
    nominal : float
        Nominal value, mm (angles: degrees), as everything here.
    permitted_error : float
        Largest error that counts as accurate.
    probability : float
        P(error at most that); 0 without an image.
    standard_uncertainty : float
        Standard deviation of the error; of a short arc half the width of the interval that holds 68.27 %.
    expanded_uncertainty : float
        U: twice that; of a short arc half the width of the interval that holds 95.45 %.
    bias : float
        Mean error, of second order in the displacement.
    budget : dict of str to float
        Variance by `SOURCES`: translation and rotation of the camera, errors of single points in the image, the error
        that all points of an entity have in common, and surfaces that are not where the model has them. What
        translation and rotation do together, by their correlation or as a product, is shared equally; where they cancel
        each other, a share may be negative. Of a value that is not from a short arc, they sum to the square of the
        standard uncertainty.
    """

    nominal: float
    permitted_error: float
    probability: float
    standard_uncertainty: float
    expanded_uncertainty: float
    bias: float
    budget: dict[str, float]


class MeasurandModel:
    """The joint second-order model of a value: error = g.delta + 1/2 delta'H delta + localisation + surfaces.

    Probabilities are those of x = ln(1 + k error) / k, with k between 0 (the error itself) and 1 / nominal, such that x
    is linear in the displacement along the gradient: perspective multiplies what lies in a plane, and adds to what lies
    in two. At .055 rad the largest difference from exact measurements falls from .03 to .007 by it.

    Parameters
    ----------
    measurand : Measurand
        The value.
    image_distance_mm : float
        From the lens to the image plane, mm.
    pixel_pitch_mm : array_like (2,)
        Pixel pitch (r_x, r_y), mm.
    pose_covariance : array_like (6, 6)
        Of (dx, dy, dz, phi_x, phi_y, phi_z), mm and rad: translation and rotation vector of the real camera in the
        frame of the planned one (x right, y down, z along the optical axis), about the lens.
    localisation : Localisation
        How well points are found.
    permitted_error : float
        Largest error that counts as accurate, in the unit of the value.
    surfaces_mm : float
        Standard deviation of a face's position along its normal, mm. Entities in one plane share it.
    by_surfaces : float, optional
        Standard deviation of the value by the position of faces, in its unit, where it is known; then ``surfaces_mm``
        does not count.

    Raises
    ------
    InvalidParameterError
        If a number breaks its rule.
    """

    def __init__(
        self,
        measurand: Measurand,
        *,
        image_distance_mm: float,
        pixel_pitch_mm: ArrayLike,
        pose_covariance: ArrayLike,
        localisation: Localisation,
        permitted_error: float,
        surfaces_mm: float = 0.0,
        by_surfaces: float | None = None,
    ):
        self.by_surfaces = by_surfaces
        self.measurand = measurand
        self.localisation = localisation
        self.surfaces_mm = check_not_negative(surfaces_mm, "surfaces_mm")
        pitch = check_pixel_pitch(pixel_pitch_mm)
        self.image = Image(
            check_positive(image_distance_mm, "image_distance_mm"),
            (float(pitch[0]), float(pitch[1])),
        )
        self.covariance = check_covariance(pose_covariance)
        if self.covariance.shape != (6, 6):
            raise InvalidShapeError.of_rule(
                "pose_covariance", "must have shape (6, 6)", f"shape {self.covariance.shape}"
            )
        self.permitted_error = check_positive(permitted_error, "permitted_error")
        if self.permitted_error >= measurand.nominal:
            raise InvalidParameterError(
                f"permitted_error must be smaller than the nominal value {measurand.nominal:.6g}. "
                f"Got {permitted_error!r}."
            )
        self._root = covariance_root(self.covariance)

    def probability(self, world_to_camera: ArrayLike) -> NDArray[np.float64]:
        """Return the probability that the error is at most the permitted one.

        Parameters
        ----------
        world_to_camera : array_like (n, 4, 4)
            Planned poses.

        Returns
        -------
        array (n,)
            Probabilities in [0, 1]; 0 where an entity is not wholly in front of the camera or its plane is seen
            edge-on.
        """
        expansion = self._expansion(world_to_camera)
        return self._within(expansion, np.full(len(expansion.seen), self.permitted_error))

    def probability_at(
        self, world_to_camera: ArrayLike, poses: KnownPoses, excess: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the same with a covariance of each pose.

        Parameters
        ----------
        world_to_camera : array_like (n, 4, 4)
            Planned poses.
        poses : KnownPoses
            Their covariances (n, 6, 6), with roots.
        excess : array (n,)
            Variance of x beside that by the pose, see `errors.measurands.measurand.Expansion`: by surfaces.

        Returns
        -------
        array (n,)
            Probabilities in [0, 1].
        """
        expansion = self._expansion(world_to_camera)
        expansion.variance[:, 2] = excess
        error = np.full(len(expansion.seen), self.permitted_error)
        return self._within(expansion, error, (poses.covariance, poses.root))

    def scale(self, world_to_camera: ArrayLike) -> float:
        """Return the unit of x per unit of the value at one pose (1, 4, 4); 0 without an image."""
        expansion = self._expansion(world_to_camera)
        return float(expansion.scale[0]) if expansion.seen[0] else 0.0

    def describe(self, world_to_camera: ArrayLike) -> Prediction:
        """Return how sure the value is measured from one pose.

        Parameters
        ----------
        world_to_camera : array_like (4, 4)
            Planned pose.

        Returns
        -------
        Prediction
            Probability, uncertainty and budget; infinite uncertainty without an image.
        """
        expansion = self._expansion(np.asarray(world_to_camera)[None])
        if not expansion.seen[0]:
            nothing = dict.fromkeys(SOURCES, math.inf)
            return Prediction(
                self.measurand.nominal,
                self.permitted_error,
                0.0,
                math.inf,
                math.inf,
                math.nan,
                nothing,
            )
        probability = float(self._within(expansion, np.array([self.permitted_error]))[0])
        budget, bias = self._budget(expansion)
        u = math.sqrt(math.fsum(budget.values()))
        expanded = COVERAGE * u
        if any(map(is_short, self.measurand.geometry)):
            u = self._quantile(expansion, _ONE)
            expanded = self._quantile(expansion, _TWO)
        return Prediction(
            self.measurand.nominal, self.permitted_error, probability, u, expanded, bias, budget
        )

    def _expansion(self, world_to_camera: ArrayLike) -> Expansion:
        poses = np.asarray(world_to_camera, dtype=np.float64)
        if poses.ndim != 3 or poses.shape[1:] != (4, 4):
            raise InvalidShapeError.of_rule(
                "world_to_camera", "must have shape (n, 4, 4)", str(poses.shape)
            )
        expansion = self.measurand.expansion(poses, self.image, self.localisation, self.surfaces_mm)
        if self.by_surfaces is not None:
            expansion.variance[:, 2] = (self.by_surfaces * expansion.scale) ** 2
        return expansion

    def _within(
        self,
        expansion: Expansion,
        error: NDArray[np.float64],
        spread: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None,
    ) -> NDArray[np.float64]:
        """Return P(|error| <= given) (n,), with a covariance and a root of each pose if they are given."""
        seen = expansion.seen
        covariance, root = (self.covariance, self._root) if spread is None else spread
        result = np.zeros(len(seen))
        if not seen.any():
            return result
        gradient = expansion.gradient[seen]
        hessian = expansion.hessian[seen]
        if spread is not None:
            covariance = covariance[seen]
            root = root[seen]
        if expansion.logarithmic:
            bend = np.full(len(gradient), 1 / self.measurand.nominal)
        else:
            bend = _bend(gradient, hessian, covariance, 1 / self.measurand.nominal)
            hessian = hessian - bend[:, None, None] * (gradient[:, :, None] * gradient[:, None, :])
        limits = (
            _bent(np.stack([-error, error], axis=1)[seen], bend[:, None])
            * expansion.scale[seen, None]
        )
        variance = expansion.variance.sum(axis=1, keepdims=True)
        noise = np.concatenate([expansion.widths, variance], axis=1)[seen]
        result[seen] = quadratic_probability(gradient, hessian, root, noise, limits)
        return result

    def _budget(self, expansion: Expansion) -> tuple[dict[str, float], float]:
        """Return variance by source, and the mean error, of the first pose."""
        scale = expansion.scale[0]
        g = expansion.gradient[0] / scale
        h = expansion.hessian[0] / scale
        if expansion.logarithmic:
            # error = nominal (exp(y / nominal) - 1) = y + y^2 / (2 nominal) + ...
            h = h + np.outer(g, g) / self.measurand.nominal
        whole, translation, rotation = (
            _variance(g[part], h[part, part], self.covariance[part, part])
            for part in (slice(6), slice(3), slice(3, 6))
        )
        common = whole - translation - rotation
        points, floor, surfaces = expansion.variance[0] / scale**2
        points += (expansion.widths[0] ** 2).sum() / 6 / scale**2
        parts = translation + common / 2, rotation + common / 2, points, floor, surfaces
        budget = dict(zip(SOURCES, map(float, parts), strict=True))
        return budget, float(0.5 * np.trace(h @ self.covariance))

    def _quantile(self, expansion: Expansion, probability: float) -> float:
        """Return the error that is not exceeded with a probability."""
        low = 0.0
        high = self.measurand.nominal
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            enough = self._within(expansion, np.array([middle]))[0] >= probability
            low, high = (low, middle) if enough else (middle, high)
        return high


def _variance(
    g: NDArray[np.float64], h: NDArray[np.float64], covariance: NDArray[np.float64]
) -> float:
    """Return the variance of g.delta + 1/2 delta'H delta for normal delta: g'Sg + 1/2 tr (HS)^2."""
    turned = h @ covariance
    return float(g @ covariance @ g + 0.5 * np.trace(turned @ turned))


def _bend(
    g: NDArray[np.float64], h: NDArray[np.float64], covariance: NDArray[np.float64], limit: float
) -> NDArray[np.float64]:
    """Return k (n,) that makes ln(1 + k error) / k linear along the gradient: g'S H S g / (g'S g)^2, in [0, most]."""
    # one covariance for all poses, or one for each
    way = g @ covariance if covariance.ndim == 2 else np.einsum("ni,nij->nj", g, covariance)
    variance = (way * g).sum(axis=1)
    along = (way[:, None, :] @ h @ way[:, :, None])[:, 0, 0]
    safe = np.where(variance > 0, variance, np.inf)
    return np.asarray(np.clip(along / safe / safe, 0.0, limit))


def _bent(error: NDArray[np.float64], bend: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ln(1 + k error) / k; the error itself for k = 0."""
    scaled = np.maximum(bend * error, -1 + 1e-12)
    return np.where(bend > 0, np.log1p(scaled) / np.where(bend > 0, bend, 1.0), error)
