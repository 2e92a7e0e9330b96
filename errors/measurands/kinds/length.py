"""Length of an edge by the length of its image: the paper's measurement."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from compiled.cache import njit
from errors.checks import MIN_IMAGE_LENGTH_MM
from errors.measurands.fit_expansion import add_product, add_square, plane_row, point_row
from errors.measurands.fitted import Frame
from errors.measurands.geometry import Line
from errors.measurands.localisation import Localisation
from errors.measurands.measurand import Expansion, Image, Measurand, lines_of
from errors.measurands.registry import kind


@kind("length")
class Length(Measurand):
    """Length of an edge, mm: the nominal length times the length of its image over that at the nominal pose.

    Both ends must be found; nothing is carried back. The error is expanded as a logarithm, see `errors.joint`.

    An end is a corner with another line, which has a floor of its own: along the edge each end is wrong by it. The edge
    may lie off its place in both directions across it, each as far as a surface does.
    """

    takes = (Line,)
    in_image = True

    def describe(self) -> tuple[float, tuple[Frame, ...], NDArray[np.float64], NDArray[np.float64]]:
        """Return nominal value, frames, and the derivatives by what is fitted, see `Measurand`."""
        (line,) = lines_of(self.geometry)
        side = np.cross(line.direction, np.eye(3)[int(np.argmin(np.abs(line.direction)))])
        frame = Frame(line.middle, line.direction, side / np.linalg.norm(side))
        return line.length, (frame,), np.zeros(2), np.zeros((2, 2))

    def image_value(
        self, images: NDArray[np.float64], planned: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return deviations (n,) by images of the ends (n, 2, 2)."""
        length = np.linalg.norm(images[:, 1] - images[:, 0], axis=1)
        return np.asarray(self.nominal * (length / np.linalg.norm(planned[1] - planned[0]) - 1))

    def expansion(
        self,
        poses: NDArray[np.float64],
        image: Image,
        localisation: Localisation,
        surfaces_mm: float = 0.0,
    ) -> Expansion:
        """Return the error of the length at poses (n, 4, 4)."""
        (line,) = lines_of(self.geometry)
        n = len(poses)
        gradient = np.zeros((n, 6))
        hessian = np.zeros((n, 6, 6))
        tangent = np.zeros((n, 3))
        ends = (
            np.array([line.p, line.q]) @ np.swapaxes(poses[:, :3, :3], 1, 2) + poses[:, None, :3, 3]
        )
        _expand_lengths(np.ascontiguousarray(ends), image.distance_mm, gradient, hessian, tangent)
        length = tangent[:, 0]
        steps = np.abs(tangent[:, 1:]) * image.pitch_mm
        variance = np.zeros((n, 3))
        if localisation.model == "rounding":
            widths = steps
        else:
            widths = np.zeros((n, 2))
            sigma = localisation.sigma_px
            if localisation.model == "fit":
                sigma = max(sigma, localisation.floor_px)
            variance[:, 0] = 2 * sigma**2 * (steps**2).sum(axis=1)
            # pixels in a millimetre along the image
            per_mm = np.hypot(*(tangent[:, 1:] / image.pitch_mm).T)
            common = localisation.common_px / np.where(per_mm > 0, per_mm, np.inf)
            variance[:, 1] = 2 * common**2
        # moving the edge is moving the camera against it; along itself it makes no error
        by_place = gradient[:, :3]
        along = np.einsum("ni,nij,j->n", by_place, poses[:, :3, :3], line.direction)
        across = np.maximum((by_place**2).sum(axis=1) - along**2, 0.0)
        variance[:, 2] = surfaces_mm**2 * across
        seen = length > MIN_IMAGE_LENGTH_MM
        return Expansion(
            seen, gradient, hessian, variance, widths, length / self.nominal, logarithmic=True
        )


@njit(error_model="numpy")
def _expand_lengths(ends, distance, gradient, hessian, tangent):
    n = np.array([0.0, 0.0, 1.0])
    e = np.zeros(3)
    side = np.zeros(3)
    w = np.empty(3)
    s = np.empty(6)
    row = np.empty(6)
    turn = np.empty(6)
    for i in range(len(ends)):
        first = ends[i, 0]
        last = ends[i, 1]
        if not (first[2] > 0.0 and last[2] > 0.0):
            continue
        du = distance * (last[0] / last[2] - first[0] / first[2])
        dv = distance * (last[1] / last[2] - first[1] / first[2])
        length = math.sqrt(du * du + dv * dv)
        tangent[i, 0] = length
        if not length > MIN_IMAGE_LENGTH_MM:
            continue
        tangent[i, 1] = du / length
        tangent[i, 2] = dv / length
        e[0] = du / length
        e[1] = dv / length
        side[0] = -dv / length
        side[1] = du / length
        g = gradient[i]
        h = hessian[i]
        turn[:] = 0.0
        for k in range(2):
            p = ends[i, k]
            scale = (2 * k - 1) * distance / p[2]
            plane_row(n, p[2], p, s)
            point_row(side, n, p[2], p, w, row)
            turn += scale * row
            point_row(e, n, p[2], p, w, row)
            g += scale * row
            add_square(h, w, p, s, row, scale)
        add_product(h, turn, turn, 0.5 / length)
        add_product(h, g, g, -0.5 / length)
