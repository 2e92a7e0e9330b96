"""Checks of everything that crosses the public boundary; no other module checks again."""

import math
from collections.abc import Callable, Collection
from numbers import Integral, Real
from typing import Any

import numpy as np

from ga.exceptions import FitnessError, ParameterError


def check_integer(name: str, value: Any, low: int, high: int | None = None) -> int:
    """Return `value` as an int in [low, high] (no upper limit if `high` is None)."""
    rule = f"an integer of at least {low}" if high is None else f"an integer in [{low}, {high}]"
    number: Any = value
    if (
        not isinstance(value, Integral)
        or isinstance(value, bool)
        or number < low
        or (high is not None and number > high)
    ):
        raise ParameterError.of_rule(name, f"must be {rule}", repr(value))
    return int(value)


def check_limit(name: str, value: Any, low: int) -> int | None:
    """Return `value` as an int of at least low, or None where there is no limit."""
    return None if value is None else check_integer(name, value, low)


def check_probability(name: str, value: Any) -> float:
    """Return `value` as a float in [0, 1]."""
    number: Any = value
    if not isinstance(value, Real) or isinstance(value, bool) or not 0.0 <= number <= 1.0:
        raise ParameterError.of_rule(name, "must be in [0, 1]", repr(value))
    return float(value)


def check_nonnegative(name: str, value: Any) -> float:
    """Return `value` as a finite float that is not negative."""
    number: Any = value
    if (
        not isinstance(value, Real)
        or isinstance(value, bool)
        or not (math.isfinite(number) and number >= 0.0)
    ):
        raise ParameterError.of_rule(name, "must be finite and not negative", repr(value))
    return float(value)


def check_finite(name: str, value: Any) -> float:
    """Return `value` as a finite float."""
    if not isinstance(value, Real) or isinstance(value, bool) or not math.isfinite(value):
        raise ParameterError.of_rule(name, "must be a finite number", repr(value))
    return float(value)


def check_choice(name: str, value: Any, choices: Collection[str]) -> str:
    """Return `value` if it is one of `choices`."""
    if not isinstance(value, str) or value not in choices:
        names = ", ".join(repr(choice) for choice in choices)
        raise ParameterError.of_rule(name, f"must be one of {names}", repr(value))
    return value


def check_flag(name: str, value: Any) -> bool:
    """Return `value` as a bool."""
    if not isinstance(value, (bool, np.bool_)):
        raise ParameterError.of_rule(name, "must be True or False", repr(value))
    return bool(value)


def check_callable(name: str, value: Any, *, optional: bool = False) -> None:
    """Raise unless `value` can be called (or is None where `optional`)."""
    if not callable(value) and not (optional and value is None):
        raise ParameterError.of_rule(
            name, f"must be callable{' or None' if optional else ''}", repr(value)
        )


def check_rng(rng: Any) -> tuple[np.random.Generator, int | None]:
    """Return a generator and the seed that repeats it.

    An integer is its own seed. None draws a fresh seed, which is returned so that the run can be repeated. A
    ``Generator`` is used as it is and has no seed to report (None), since it may have been advanced already.
    """
    if isinstance(rng, np.random.Generator):
        return rng, None
    if rng is None:
        entropy: Any = np.random.SeedSequence().entropy
        seed = int(entropy)
    elif isinstance(rng, Integral) and not isinstance(rng, bool) and int(rng) >= 0:
        seed = int(rng)
    else:
        raise ParameterError.of_rule(
            "rng", "must be a non-negative integer, a numpy Generator or None", repr(rng)
        )
    return np.random.default_rng(seed), seed


def as_array(value: Any) -> np.ndarray:
    """Return `value` as an array; one of objects, which every check refuses, where rows have different lengths."""
    try:
        return np.asarray(value)
    except ValueError:
        return np.array([None])


def check_range(low: object, high: object, n_genes: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the ends of the genes' ranges as float64 arrays, finite and in order, of shape () or (n_genes,)."""
    ends = []
    for name, value in (("low", low), ("high", high)):
        array = as_array(value)
        if (
            array.dtype.kind not in "biuf"
            or array.shape not in ((), (n_genes,))
            or not np.isfinite(array).all()
        ):
            raise ParameterError.of_rule(
                name, f"must be one finite number, or one for each of {n_genes} genes", repr(value)
            )
        ends.append(array.astype(np.float64))
    if np.any(ends[0] > ends[1]):
        raise ParameterError.of_rule("low", "must not be above high", f"{low!r} and {high!r}")
    return ends[0], ends[1]


def check_bits(name: str, bits: object, n_bits: int | None = None) -> np.ndarray:
    """Return `bits` as a boolean array of shape (..., n_bits), of any length if None; any type of 0 and 1 will do."""
    array = as_array(bits)
    if array.ndim == 0 or (n_bits is not None and array.shape[-1] != n_bits):
        length = "" if n_bits is None else f"{n_bits} "
        raise ParameterError.of_rule(
            name, f"must have {length}bits along its last axis", f"shape {array.shape}"
        )
    if array.dtype.kind not in "biuf":
        raise ParameterError.of_rule(name, "must hold only 0 and 1", f"an array of {array.dtype}")
    wrong = (array != 0) & (array != 1)
    if wrong.any():
        raise ParameterError.of_rule(name, "must hold only 0 and 1", str(array[wrong][0]))
    return array.astype(bool)


def check_population(name: str, bits: object, n_bits: int) -> np.ndarray:
    """Return `bits` as a boolean array of shape (N, n_bits)."""
    array = check_bits(name, bits, n_bits)
    if array.ndim != 2:
        raise ParameterError.of_rule(name, f"must have shape (N, {n_bits})", f"shape {array.shape}")
    return array


def call_fitness(fitness: Callable[..., object], bits: np.ndarray) -> np.ndarray:
    """Call the caller's `fitness` on rows of `bits`; return its values as float64, shape (N,), all finite."""
    values = as_array(fitness(bits))
    if values.dtype.kind not in "biuf" or values.shape != (len(bits),):
        raise FitnessError(
            f"fitness must return one number per individual, shape ({len(bits)},). "
            f"Got an array of {values.dtype} of shape {values.shape}."
        )
    values = values.astype(np.float64)
    wrong = np.flatnonzero(~np.isfinite(values))
    if wrong.size:
        raise FitnessError(
            f"fitness must be finite. Got {values[wrong[0]]} for individual {wrong[0]} of {len(bits)}."
        )
    return values


def call_feasible(feasible: Callable[..., object], bits: np.ndarray) -> np.ndarray:
    """Call the caller's `feasible` on rows of `bits`; return its booleans, shape (N,)."""
    mask = as_array(feasible(bits))
    if mask.dtype != bool or mask.shape != (len(bits),):
        raise FitnessError(
            f"feasible must return one bool per individual, shape ({len(bits)},). "
            f"Got an array of {mask.dtype} of shape {mask.shape}."
        )
    return mask
