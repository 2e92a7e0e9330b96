"""Parts that a STEP file mirrors or scales: the kernel turns the first and tears the second apart, and says nothing.

A part is placed by two coordinate systems, or by a transformation operator. Only the operator can mirror and scale.

Reference: ISO 10303-42, cartesian_transformation_operator_3d and the function base_axis.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from aspectgraph.exceptions import ReadError
from aspectgraph.read.step.text import StepEntity, known_references, reachable

SAME_SCALE = 1e-9
"""A scale that differs from 1 by less, relatively, is 1 with rounded digits."""

_OPERATOR = "CARTESIAN_TRANSFORMATION_OPERATOR_3D"
_ARGUMENTS = re.compile(rf"{_OPERATOR}\s*\(([^()]*)\)", re.IGNORECASE)
_RELATION = "REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION"


def check_operators(entities: dict[int, StepEntity], solid_kinds: frozenset[str]) -> None:
    """Check that no operator that places a part mirrors or scales it.

    Parameters
    ----------
    entities : dict
        See `text.parse_entities`.
    solid_kinds : frozenset of str
        The types that are solids.

    Raises
    ------
    ReadError
        A part is mirrored or scaled; the message names the operator.
    """
    for number in sorted(set(_placing_operators(entities, solid_kinds))):
        arguments = _arguments(entities[number])
        if arguments is None:
            continue
        axis1, axis2, _, scale, axis3 = arguments
        size = 1.0 if scale == "$" else float(scale)
        if abs(size - 1.0) > SAME_SCALE:
            raise ReadError(
                "the parts of a STEP file must be placed in their own size. "
                f"Got #{number}, which scales a part by {size:g}."
            )
        if _mirrors(*(_direction(entities, axis) for axis in (axis1, axis2, axis3))):
            raise ReadError(
                "the parts of a STEP file must be moved and turned only. "
                f"Got #{number}, which mirrors a part; export the mirrored part as one of its own."
            )


def _placing_operators(
    entities: dict[int, StepEntity], solid_kinds: frozenset[str]
) -> Iterator[int]:
    """Go through the operators that place a part; those of drawings and views place none."""
    for entity in entities.values():
        if _RELATION not in entity.kinds and "MAPPED_ITEM" not in entity.kinds:
            continue
        used = known_references(entities, entity)
        operators = [number for number in used if _OPERATOR in entities[number].kinds]
        if not operators:
            continue
        if _RELATION in entity.kinds or any(
            entities[inner].kind in solid_kinds
            for number in used
            for inner in reachable(entities, number)
        ):
            yield from operators


def _arguments(entity: StepEntity) -> list[str] | None:
    """Return axis 1 and 2, origin, scale and axis 3 as the file writes them; None if it has another form."""
    found = _ARGUMENTS.search(entity.text)
    if found is None:
        return None
    arguments = [argument.strip() for argument in found[1].split(",")]
    return arguments[-5:] if len(arguments) >= 5 else None


def _direction(entities: dict[int, StepEntity], reference: str) -> np.ndarray | None:
    """Return the numbers of a direction, shape (3,); None if it is not given."""
    entity = entities.get(int(reference[1:])) if reference.startswith("#") else None
    if entity is None or len(entity.numbers) != 3:
        return None
    return np.array(entity.numbers)


def _mirrors(axis1: np.ndarray | None, axis2: np.ndarray | None, axis3: np.ndarray | None) -> bool:
    """Return whether the axes of an operator are left-handed; the second one decides, if it is given."""
    if axis2 is None:
        return False
    z = np.array([0.0, 0.0, 1.0]) if axis3 is None else axis3
    if axis1 is None:
        along_x = not z[1] and not z[2]
        axis1 = np.array([0.0, 1.0, 0.0] if along_x else [1.0, 0.0, 0.0])
    return bool(np.cross(axis1, axis2) @ z < 0.0)
