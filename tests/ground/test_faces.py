"""What ``help`` shows of public records, and how types read there."""

import inspect
from collections.abc import Callable, Mapping
from typing import Any, Literal

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

import aspectgraph
import errors
import ga
import planner
from ground.faces import words_of

PACKAGES = [aspectgraph, errors, ga, planner]


@pytest.mark.parametrize(
    ("hint", "words"),
    [
        (float, "float"),
        (float | None, "float | None"),
        (tuple[float, float], "tuple[float, float]"),
        (tuple[str, ...], "tuple[str, ...]"),
        (Mapping[str, float], "Mapping[str, float]"),
        (Literal["matt", "metal"], "Literal['matt', 'metal']"),
        (NDArray[np.float64], "ndarray"),
        (ArrayLike, "ArrayLike"),
        (Callable[[np.ndarray], bool], "Callable[[ndarray], bool]"),
        (Any, "Any"),
    ],
)
def test_a_type_reads_as_in_a_docstring(hint, words):
    assert words_of(hint) == words


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.__name__)
def test_no_public_signature_shows_rules_of_files(package):
    """``help(Camera)`` began with patterns and titles of messages."""
    public = [getattr(package, name) for name in package.__all__]
    records = [item for item in public if hasattr(item, "__dataclass_fields__")]
    shown = [str(inspect.signature(record)) for record in records]
    shown += [str(inspect.signature(record.__init__)) for record in records]
    assert not [text for text in shown if "Annotated" in text or "Meta(" in text]


def test_a_record_states_its_fields_with_plain_types_and_defaults():
    distortion = inspect.signature(planner.Camera).parameters["distortion"]
    assert str(distortion) == "distortion: Distortion | None = None"
    assert str(inspect.signature(planner.Exposure)).startswith(
        "(target: str, pixel: tuple[int, int],"
    )


def test_a_record_is_made_as_before():
    """What is shown changes nothing of what is checked."""
    camera = planner.Camera(25.0, 0.00345, (2448, 2048), f_number=8.0, focus_distance_mm=250.0)
    assert camera.pixel_pitch_mm == (0.00345, 0.00345)
    with pytest.raises(TypeError, match="unexpected keyword argument 'colour'"):
        planner.Camera(25.0, 0.00345, (2448, 2048), 8.0, 250.0, colour="red")
