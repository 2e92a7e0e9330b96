"""One image as it is measured: grey values, their noise, and the camera."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from planner.camera.camera import Camera
from planner.measuring.image.scans import CLIPPED_SHARE, Scans, find_edges, noise_of, white_of


@dataclass(frozen=True)
class Picture:
    """An image.

    Attributes
    ----------
    name : str
        Its name, such as "setting_01.png".
    grey : array (h, w)
        Grey values, float32.
    white : float
        Grey value of full exposure.
    noise : float
        Standard deviation of the noise, in grey values.
    camera : Camera
        The camera.
    """

    name: str
    grey: NDArray[np.float32]
    white: float
    noise: float
    camera: Camera

    @classmethod
    def of(cls, name: str, image: NDArray[np.generic], camera: Camera) -> Picture:
        """Return an image of 8 or 16 bits, or of floats in [0, 1]."""
        grey = np.ascontiguousarray(image, dtype=np.float32)
        return cls(name, grey, white_of(image), noise_of(grey), camera)

    def turned(self) -> Picture:
        """Return the image turned by 180 degrees."""
        return replace(self, grey=np.ascontiguousarray(self.grey[::-1, ::-1]))

    def mirrored(self) -> Picture:
        """Return the image with left and right exchanged."""
        return replace(self, grey=np.ascontiguousarray(self.grey[:, ::-1]))

    @property
    def clipped_share(self) -> float:
        """Share of the pixels that are overexposed."""
        return float(np.mean(self.grey >= CLIPPED_SHARE * self.white))

    def find(
        self,
        centres: NDArray[np.float64],
        across: NDArray[np.float64],
        half_px: float,
        sign: NDArray[np.int64] | None = None,
    ) -> Scans:
        """Scan across edges, see `planner.measuring.image.scans.find_edges`."""
        return find_edges(
            self.grey, centres, across, half_px, white=self.white, noise=self.noise, sign=sign
        )
