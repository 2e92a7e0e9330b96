"""The lamps of a plan: where they are, and which one shows what in which setting."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


class Exposure(NamedTuple):
    """What one image is exposed for.

    Attributes
    ----------
    target : str
        The brightest point is next to this target.
    pixel : (int, int)
        That point, px: u and v.
    dimmest : str
        The target whose edges get least light.
    times : float
        How many times less; infinite if most of its edges get none.
    """

    target: str
    pixel: tuple[int, int]
    dimmest: str
    times: float


@dataclass(frozen=True)
class LitImage:
    """One image to take in a setting, with its lamps.

    Attributes
    ----------
    lamps : tuple of int
        Numbers of the lamps that are on, in ascending order.
    contrast : dict of str to float
        Per target, the least contrast of its edges, see `aspectgraph.contrast`. Of a silhouette, it
        is the contrast with the background.
    silhouettes : tuple of str
        Names of targets with at least one edge that the camera sees as a silhouette.
    expose_for : Exposure or None
        The brightest point next to the edges, for a matt part of one albedo. None if its light was
        not computed, as in plans of earlier programs.
    """

    lamps: tuple[int, ...]
    contrast: Mapping[str, float]
    silhouettes: tuple[str, ...] = ()
    expose_for: Exposure | None = None

    def exposure_dict(self) -> dict[str, Any] | None:
        """Return what the image is exposed for as plain values, ready for JSON.

        Returns
        -------
        dict or None
            An infinite ratio is None.
        """
        if self.expose_for is None:
            return None
        target, pixel, dimmest, times = self.expose_for
        ratio = times if math.isfinite(times) else None
        return {"target": target, "pixel": list(pixel), "dimmest": dimmest, "times": ratio}


def _image_dict(image: LitImage) -> dict[str, Any]:
    found = image.exposure_dict()
    return {
        "lamps": list(image.lamps),
        "contrast": dict(image.contrast),
        "silhouettes": list(image.silhouettes),
        **({} if found is None else {"expose_for": found}),
    }


def _image_of(data: Mapping[str, Any]) -> LitImage:
    return LitImage(
        tuple(data["lamps"]),
        dict(data["contrast"]),
        tuple(data["silhouettes"]),
        _exposure_of(data.get("expose_for")),
    )


def _exposure_of(data: Mapping[str, Any] | None) -> Exposure | None:
    if data is None:
        return None
    u, v = data["pixel"]
    times = math.inf if data["times"] is None else float(data["times"])
    return Exposure(data["target"], (u, v), data["dimmest"], times)


# fields that a file holds as they are, in its order
_STORED = (
    *("kind", "contrast", "step", "ground", "together"),
    *("lamps", "lower_bound", "bound_proof"),
)


@dataclass(frozen=True, eq=False, repr=False)
class LightPlan:
    """Lamps that light the targets of a plan.

    Attributes
    ----------
    kind : str
        "fixed", "ring" or "placed".
    contrast : float
        Least contrast.
    step : float
        Least step of grey values, as a share of the value of a face lit frontally.
    ground : str
        "dark", or "bright" for a back light.
    lamps : array (n, 3)
        Positions of the lamps in use, mm. One is on at a time, or all are.
    images : tuple of tuple of LitImage
        Per setting, the images to take. There is one, unless no single lamp lights all targets.
    unlit : tuple of dict of str to str
        Per setting, the unlit targets and the reasons.
    lower_bound : int
        Proven lower bound of the number of lamps.
    bound_proof : str
        How the bound was proven.
    together : bool
        Whether all lamps are on in every image.
    """

    kind: str
    contrast: float
    step: float
    ground: str
    lamps: NDArray[np.float64]
    images: tuple[tuple[LitImage, ...], ...]
    unlit: tuple[Mapping[str, str], ...]
    lower_bound: int
    bound_proof: str = field(default="")
    together: bool = False

    def __post_init__(self) -> None:
        places = np.array(self.lamps, dtype=np.float64).reshape(-1, 3)
        places.setflags(write=False)
        object.__setattr__(self, "lamps", places)

    def __repr__(self) -> str:
        """Return a one-line summary."""
        n = len(self.lamps)
        dark = sum(map(len, self.unlit))
        lamps = f"{n} {self.kind} lamp{'s' * (n != 1)} (at least {self.lower_bound} needed)"
        return f"<LightPlan: {lamps}, contrast {self.contrast:g}, {sum(map(len, self.images))} images, {dark} unlit>"

    @property
    def complete(self) -> bool:
        """Whether all targets are lit in every setting."""
        return not any(self.unlit)

    @property
    def minimal(self) -> bool:
        """Whether the bound proves that fewer lamps are not enough."""
        return bool(len(self.lamps)) and len(self.lamps) == self.lower_bound

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain values, ready for JSON.

        Returns
        -------
        dict
            Lists, texts and numbers.
        """
        settings = [
            {"images": [_image_dict(image) for image in images], "unlit": dict(unlit)}
            for images, unlit in zip(self.images, self.unlit, strict=True)
        ]
        stored = {name: getattr(self, name) for name in _STORED}
        return {**stored, "lamps": self.lamps.tolist(), "settings": settings}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> LightPlan:
        """Build from the result of `to_dict`.

        Parameters
        ----------
        data : mapping of str to value
            The fields.

        Returns
        -------
        LightPlan
            Equal to the one written.
        """
        settings = data["settings"]
        return cls(
            **{name: data[name] for name in _STORED},
            images=tuple(tuple(map(_image_of, setting["images"])) for setting in settings),
            unlit=tuple(dict(setting["unlit"]) for setting in settings),
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, LightPlan):
            return NotImplemented
        return self.to_dict() == other.to_dict()

    __hash__ = None  # type: ignore[assignment]
