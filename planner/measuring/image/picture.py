"""One image as it is measured: grey values, their noise, and the camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from errors.formatting import percent_text
from planner.camera.camera import Camera
from planner.measuring.image.scans import CLIPPED_SHARE, Scans, find_edges, noise_of, white_of

MOST_CLIPPED = 0.05
"""Share of an image that may be overexposed without a note."""
BRIGHT_SHARE = 0.995
"""An image is as bright as this share of its pixels at most."""
DARK_SHARE = 0.25
"""Share of white below which an image is dark."""
WELL_EXPOSED = 0.8
"""Share of white that the bright part of an image should have."""
MOST_BLUR_PX = 2.0
"""Blur across edges from which on an image has a note."""


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

    def notes(
        self, blur_px: float, overexposed: Sequence[str] = (), share: float | None = None
    ) -> list[str]:
        """Return what is wrong with the exposure, and with the focus.

        Parameters
        ----------
        blur_px : float
            Blur across edges.
        overexposed : sequence of str
            Targets that are not measured, because light beside their edges is.
        share : float, optional
            For what share of the time to expose, if the image is overexposed and that is known.
        """
        found = []
        bright = float(np.quantile(self.grey[::4, ::4], BRIGHT_SHARE)) / self.white
        shorter = "expose for half of the time or less"
        if share is not None:
            shorter = f"expose for {percent_text(share, 2)} of the time, less if the part is shiny"
        if self.overexposed:
            found.append(f"{100 * self.clipped_share:.0f} % of the image is overexposed: {shorter}")
        elif overexposed:
            found.append(f"overexposed beside {', '.join(overexposed)}: {shorter}")
        elif bright < DARK_SHARE:
            found.append(f"dark: expose for {WELL_EXPOSED / max(bright, 0.004):.1f} times as long")
        if blur_px > MOST_BLUR_PX:
            found.append(f"blurred: edges are spread with a standard deviation of {blur_px:.1f} px")
        return found

    @property
    def overexposed(self) -> bool:
        """Whether so much of the image is overexposed that it has a note."""
        return self.clipped_share > MOST_CLIPPED

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
