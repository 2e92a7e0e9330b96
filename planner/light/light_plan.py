"""The lamps of a plan: where they are, and which one shows what in which setting."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class LitImage:
    """One image of a setting.

    Attributes
    ----------
    lamps : tuple of int
        Numbers of the lamps that are on, in rising order: one, or all of those that are on together.
    contrast : dict of str to float
        What it shows by name: least contrast of its edges, see `aspectgraph.contrast`; of silhouettes, that with what
        is behind them.
    silhouettes : tuple of str
        Names whose edges the camera sees, at least one of them, as silhouettes.
    """

    lamps: tuple[int, ...]
    contrast: Mapping[str, float]
    silhouettes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, repr=False)
class LightPlan:
    """Lamps that make what a plan measures show.

    Attributes
    ----------
    kind : str
        "fixed", "ring" or "placed".
    contrast : float
        Least contrast.
    step : float
        Least step of grey values, as a share of the value of a face that is lit frontally.
    ground : str
        "dark", or "bright" for a back light.
    lamps : array (n, 3)
        Places of the lamps that are used, mm; one is on at a time, or all are.
    images : tuple of tuple of LitImage
        Per setting, the images to take; one, unless no lamp shows everything at once.
    unlit : tuple of dict of str to str
        Per setting, what no lamp shows, and why.
    lower_bound : int
        Proven: so many lamps are needed at least.
    bound_proof : str
        What the bound rests on.
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
        """Whether everything shows in every setting."""
        return not any(self.unlit)

    @property
    def minimal(self) -> bool:
        """Whether fewer lamps are proven not to be enough."""
        return bool(len(self.lamps)) and len(self.lamps) == self.lower_bound

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain values, ready for JSON.

        Returns
        -------
        dict
            Lists, texts and numbers.
        """
        return {
            "kind": self.kind,
            "contrast": self.contrast,
            "step": self.step,
            "ground": self.ground,
            "together": self.together,
            "lamps": self.lamps.tolist(),
            "lower_bound": self.lower_bound,
            "bound_proof": self.bound_proof,
            "settings": [
                {
                    "images": [
                        {
                            "lamps": list(one.lamps),
                            "contrast": dict(one.contrast),
                            "silhouettes": list(one.silhouettes),
                        }
                        for one in images
                    ],
                    "unlit": dict(unlit),
                }
                for images, unlit in zip(self.images, self.unlit, strict=True)
            ],
        }

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
        names = (
            "kind",
            "contrast",
            "step",
            "ground",
            "lamps",
            "lower_bound",
            "bound_proof",
            "together",
        )
        plain = {name: data[name] for name in names}
        images = tuple(
            tuple(
                LitImage(tuple(one["lamps"]), dict(one["contrast"]), tuple(one["silhouettes"]))
                for one in setting["images"]
            )
            for setting in data["settings"]
        )
        return cls(
            **plain,
            images=images,
            unlit=tuple(dict(setting["unlit"]) for setting in data["settings"]),
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, LightPlan):
            return NotImplemented
        return self.to_dict() == other.to_dict()

    __hash__ = None  # type: ignore[assignment]
