"""The request of a plan as one frozen value, which resume, ``--out``, batch, kept regions and plan files compare.

**Guarantee.** Every field distinguishes requests: `InspectionRequest.identity` goes through all fields there are, so an
option that is added to the request cannot be forgotten.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from errors.measurands.localisation import Localisation
from planner.camera.camera import Camera
from planner.camera.pose_uncertainty import PoseUncertainty
from planner.effort.effort import Effort
from planner.exceptions import RequestError
from planner.identity.difference import first_difference
from planner.identity.earlier import in_words_of_now
from planner.identity.plain import completed_value, plain_fields
from planner.identity.program import program_digest
from planner.identity.target_record import TargetRecord
from planner.light.lighting import Lighting
from planner.request.constraints import Requirements
from planner.wanted.registered.record import RegistrationRecord

# beside the request in a plan file: how the part's file was read
SOURCE = "source"


@dataclass(frozen=True)
class PartRecord:
    """The part of a request.

    Attributes
    ----------
    name : str
        Its name.
    digest : str
        Of its vertices, to 1e-6 mm, and its triangles.
    """

    name: str
    digest: str

    @classmethod
    def of(cls, solid: Any) -> PartRecord:
        """Return the record of a part."""
        # other machines compute the last digits otherwise, and a zero may be negative
        vertices = np.round(np.asarray(solid.vertices, dtype=np.float64), 6) + 0.0
        triangles = np.asarray(solid.triangles, dtype="<i8")
        digest = hashlib.sha256(vertices.astype("<f8").tobytes())
        digest.update(triangles.tobytes())
        return cls(solid.name, digest.hexdigest())


@dataclass(frozen=True)
class RingRecord:
    """A space in which the lamp is on the camera.

    Attributes
    ----------
    contrast : float
        Least contrast of an edge.
    step : float or None
        Least step of grey values.
    """

    contrast: float
    step: float | None


@dataclass(frozen=True, eq=False)
class InspectionRequest:
    """All that a plan depends on, except the program.

    A new field needs nothing else to distinguish requests. If `plan_inspection` takes it under another name,
    `planner.identity.difference` holds that name, and `planner.cli.naming` the option of the command line.

    Attributes
    ----------
    part : PartRecord or None
        The part; None where the request is for any part, as in a batch.
    targets : tuple of TargetRecord or None
        Edges and dimensions, in order; None as for the part.
    camera : Camera
        The camera.
    pose_uncertainty : PoseUncertainty
        How far its real pose may be from the planned one.
    localisation : Localisation
        How well points are found in the image.
    accuracy, probability : float
        What is required.
    requirements : Requirements
        What every setting must satisfy: limits, detection conditions and reach.
    workspace : array (2, 3) or None
        The box the camera may be in, mm; None where it follows from the part.
    lighting : Lighting or None
        What is asked of lamps.
    ring : RingRecord or None
        Contrast and step, where the space is one with the lamp on the camera.
    seed : int
        Repeats the plan.
    effort : Effort
        How long to search.
    gap : float
        Share of the settings that the bound may miss.
    surfaces_mm : float
        Standard deviation of the position of faces along their normals, mm.
    registration : RegistrationRecord or None
        How poses are known when values are read; None for no better than planned.
    """

    part: PartRecord | None
    targets: tuple[TargetRecord, ...] | None
    camera: Camera
    pose_uncertainty: PoseUncertainty
    localisation: Localisation
    accuracy: float
    probability: float
    requirements: Requirements
    workspace: np.ndarray | None
    lighting: Lighting | None
    ring: RingRecord | None
    seed: int
    effort: Effort
    gap: float = 0.0
    surfaces_mm: float = 0.0
    registration: RegistrationRecord | None = None

    def identity(self) -> dict[str, Any]:
        """Return all fields as plain values, the same in every process.

        Returns
        -------
        dict of str to value
            By field, in their order.
        """
        return plain_fields(self)

    def fingerprint(self) -> str:
        """Return a digest of the identity and of the code that decides about plans, 64 hexadecimal digits."""
        return digest_of(self.identity(), program_digest())

    def difference(
        self,
        before: InspectionRequest | Mapping[str, Any],
        words: Callable[[str], str] = str,
        tolerance: float = 0.0,
    ) -> str | None:
        """Return in what an earlier request differs from this one.

        Parameters
        ----------
        before : InspectionRequest or mapping
            The earlier request, or its identity.
        words, tolerance
            See `planner.identity.difference.first_difference`.

        Returns
        -------
        str or None
            The first difference, such as ``seed was 5 and is now 6``; None if it is the same request.
        """
        known = before.identity() if isinstance(before, InspectionRequest) else before
        return request_difference(self.identity(), known, words, tolerance)

    def check_lasting(self) -> None:
        """Refuse a request that another process could not recognise.

        Raises
        ------
        RequestError
            If a reach has no lasting name; says how to give it one.
        """
        for owner, reach in _unnamed(self.identity(), ""):
            raise RequestError(
                f"{owner} must have a name that lasts where a state is kept: give it an attribute state_name, a text "
                f"that says what it permits, or plan without state. Got {reach}."
            )


def request_difference(
    now: Mapping[str, Any],
    before: Mapping[str, Any],
    words: Callable[[str], str] = str,
    tolerance: float = 0.0,
) -> str | None:
    """Return the first difference of two identities; a field that is missing has its default.

    Parameters
    ----------
    now, before, words, tolerance
        See `planner.identity.difference.first_difference`.

    Returns
    -------
    str or None
        None if they are of the same request.
    """
    return first_difference(_completed(now), _completed(before), words, tolerance)


def _completed(identity: Mapping[str, Any]) -> dict[str, Any]:
    """Return an identity in this program's words: with all its fields, and without the source."""
    known = {name: value for name, value in in_words_of_now(identity).items() if name != SOURCE}
    return completed_value(InspectionRequest, known)


def digest_of(*values: Any) -> str:
    """Return the SHA-256 of plain values."""
    text = json.dumps(values, sort_keys=True, allow_nan=True)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def _unnamed(value: Any, owner: str) -> list[tuple[str, str]]:
    """Return what nobody can recognise again in plain values, with the field that holds it."""
    if not isinstance(value, Mapping):
        return []
    if "unnamed" in value:
        return [(owner, str(value["unnamed"]))]
    return [pair for key, item in value.items() for pair in _unnamed(item, str(key))]
