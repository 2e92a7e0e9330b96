"""Populations of bit strings: genes and their codes, selection, crossover and mutation."""

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any, Literal, TypeVar, cast

import numpy as np

from ga.exceptions import FitnessError, InfeasiblePopulationError, ParameterError

_Choice = TypeVar("_Choice", bound=str)

# Whole populations: telling rows apart, evaluating what is new, drawing the first one.


# Checks of everything that crosses the public boundary; no other module checks again.


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


def check_choice(name: str, value: Any, choices: Collection[_Choice]) -> _Choice:
    """Return `value` if it is one of `choices`."""
    if not isinstance(value, str) or value not in choices:
        names = ", ".join(repr(choice) for choice in choices)
        raise ParameterError.of_rule(name, f"must be one of {names}", repr(value))
    # it is one of them, which are texts
    return cast("_Choice", value)


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


# Bit strings and the numbers they stand for.
#
# A chromosome is a row of bits: `n_genes` genes of `bits_per_gene` bits each, the most
# significant bit first. A gene is read as an integer in [0, 2**M - 1], and that as a fraction of
# a range, so that both ends of the range are exactly representable.
#
# In plain binary a step of one may flip every bit (0111 -> 1000, a "Hamming cliff"); in Gray code
# neighbouring integers always differ in exactly one bit, so a single mutation can make a smallest
# step from anywhere.


#: Integers up to 2**53 are exact in float64.
MAX_BITS_PER_GENE = 53


def gray_from_binary(bits: np.ndarray) -> np.ndarray:
    """Return the Gray code of plain binary numbers.

    Parameters
    ----------
    bits : (..., M) bool
        Numbers in plain binary, most significant bit first.

    Returns
    -------
    (..., M) bool
        The same numbers in reflected Gray code: each bit xor the one before it.

    Raises
    ------
    ParameterError
        When `bits` holds anything but 0 and 1, or is a single number.

    Examples
    --------
    >>> import numpy as np
    >>> from ga import gray_from_binary
    >>> gray_from_binary(np.array([[0, 1, 1], [1, 0, 0]], bool)).astype(int).tolist()
    [[0, 1, 0], [1, 1, 0]]
    """
    bits = check_bits("bits", bits)
    gray = bits.copy()
    gray[..., 1:] ^= bits[..., :-1]
    return gray


def binary_from_gray(bits: np.ndarray) -> np.ndarray:
    """Return the plain binary of Gray-coded numbers; the inverse of `gray_from_binary`.

    Parameters
    ----------
    bits : (..., M) bool
        Numbers in reflected Gray code, most significant bit first.

    Returns
    -------
    (..., M) bool
        The same numbers in plain binary: the running xor of the bits.

    Raises
    ------
    ParameterError
        When `bits` holds anything but 0 and 1, or is a single number.

    Examples
    --------
    >>> import numpy as np
    >>> from ga import binary_from_gray
    >>> binary_from_gray(np.array([[0, 1, 0], [1, 1, 0]], bool)).astype(int).tolist()
    [[0, 1, 1], [1, 0, 0]]
    """
    return np.logical_xor.accumulate(check_bits("bits", bits), axis=-1)


@dataclass(frozen=True)
class Chromosome:
    """Layout of a chromosome: equal genes, plain binary or Gray code.

    Guarantee: `integers` and `bits_from_integers` are inverse to each other, and `fractions(encode(t))` is within
    half a step, 0.5 / (2**bits_per_gene - 1), of t.

    Parameters
    ----------
    n_genes : int
        Number of genes, at least 1.
    bits_per_gene : int
        Bits of each gene (M in the paper), 1 to 53.
    gray : bool
        Whether genes are in Gray code.

    Raises
    ------
    ParameterError
        When a parameter breaks its rule.

    Examples
    --------
    >>> from ga import Chromosome
    >>> Chromosome(n_genes=2, bits_per_gene=8).n_bits
    16
    """

    n_genes: int
    bits_per_gene: int
    gray: bool = False

    def __post_init__(self) -> None:
        check_integer("n_genes", self.n_genes, 1)
        check_integer("bits_per_gene", self.bits_per_gene, 1, MAX_BITS_PER_GENE)
        check_flag("gray", self.gray)

    @property
    def n_bits(self) -> int:
        """Length of the whole bit string."""
        return self.n_genes * self.bits_per_gene

    @property
    def largest(self) -> int:
        """Largest integer a gene can hold."""
        return int(2**self.bits_per_gene) - 1

    def genes(self, bits: np.ndarray) -> np.ndarray:
        """Split bits into genes.

        Parameters
        ----------
        bits : (..., n_bits) bool
            Chromosomes.

        Returns
        -------
        (..., n_genes, bits_per_gene) bool
            The bits of each gene.

        Raises
        ------
        ParameterError
            When bits have the wrong length, or are not 0 and 1.
        """
        bits = check_bits("bits", bits, self.n_bits)
        return bits.reshape(*bits.shape[:-1], self.n_genes, self.bits_per_gene)

    def integers(self, bits: np.ndarray) -> np.ndarray:
        """Read each gene as an integer.

        Parameters
        ----------
        bits : (..., n_bits) bool
            Chromosomes.

        Returns
        -------
        (..., n_genes) int64
            In [0, 2**bits_per_gene - 1].

        Raises
        ------
        ParameterError
            When bits have the wrong length, or are not 0 and 1.
        """
        genes = self.genes(bits)
        if self.gray:
            genes = binary_from_gray(genes)
        result: np.ndarray = genes @ self._weights
        return result

    def fractions(self, bits: np.ndarray) -> np.ndarray:
        """Read each gene as a fraction of its range.

        Parameters
        ----------
        bits : (..., n_bits) bool
            Chromosomes.

        Returns
        -------
        (..., n_genes) float64
            In [0, 1], ends included.

        Raises
        ------
        ParameterError
            When bits have the wrong length, or are not 0 and 1.
        """
        return self.integers(bits) / self.largest

    def decode(self, bits: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Read each gene as a number in [low, high].

        Parameters
        ----------
        bits : (..., n_bits) bool
            Chromosomes.
        low, high : float or (n_genes,) float64
            Ends of the range of each gene, in any unit.

        Returns
        -------
        (..., n_genes) float64
            In the unit of `low` and `high`.

        Raises
        ------
        ParameterError
            When bits have the wrong length, or a range is not finite or upside down.
        """
        low, high = check_range(low, high, self.n_genes)
        fractions = self.fractions(bits)
        # This form returns both ends exactly, which low + t (high - low) need not.
        result: np.ndarray = (1.0 - fractions) * low + fractions * high
        return result

    def bits_from_integers(self, integers: np.ndarray) -> np.ndarray:
        """Write integers as genes.

        Parameters
        ----------
        integers : (..., n_genes) int
            In [0, 2**bits_per_gene - 1].

        Returns
        -------
        (..., n_bits) bool
            Chromosomes.

        Raises
        ------
        ParameterError
            When the number of genes is wrong, or a value is no integer or out of range.
        """
        integers = np.asarray(integers)
        self._check_genes("integers", integers)
        outside = (integers < 0) | (integers > self.largest)
        if integers.dtype.kind not in "iu" or outside.any():
            value = integers[outside][0] if outside.any() else f"an array of {integers.dtype}"
            raise ParameterError(f"integers must be integers in [0, {self.largest}]. Got {value}.")
        genes = (integers[..., None].astype(np.int64) & self._weights) != 0
        if self.gray:
            genes = gray_from_binary(genes)
        result: np.ndarray = genes.reshape(*integers.shape[:-1], self.n_bits)
        return result

    def encode(self, fractions: np.ndarray) -> np.ndarray:
        """Write fractions as genes, each as the nearest representable value.

        Parameters
        ----------
        fractions : (..., n_genes) float64
            In [0, 1].

        Returns
        -------
        (..., n_bits) bool
            Chromosomes.

        Raises
        ------
        ParameterError
            When the number of genes is wrong, or a value is outside [0, 1].
        """
        fractions = np.asarray(fractions, dtype=np.float64)
        self._check_genes("fractions", fractions)
        inside = (fractions >= 0.0) & (fractions <= 1.0)
        if not inside.all():
            raise ParameterError(f"fractions must be in [0, 1]. Got {fractions[~inside][0]}.")
        return self.bits_from_integers(np.rint(fractions * self.largest).astype(np.int64))

    @property
    def _weights(self) -> np.ndarray:
        return 1 << np.arange(self.bits_per_gene - 1, -1, -1, dtype=np.int64)

    def _check_genes(self, name: str, array: np.ndarray) -> None:
        if array.ndim == 0 or array.shape[-1] != self.n_genes:
            raise ParameterError.of_rule(
                name, f"must have {self.n_genes} genes along its last axis", f"shape {array.shape}"
            )


Fitness = Callable[[np.ndarray], np.ndarray]
Feasible = Callable[[np.ndarray], np.ndarray]
Sampler = Callable[[int, np.random.Generator], np.ndarray]


@dataclass(frozen=True)
class Brood:
    """A population just made, not evaluated yet, and how it came about; counts as in `ga.History`."""

    population: np.ndarray
    drawn: int
    eliminated: int
    kept: int


def row_keys(bits: np.ndarray) -> np.ndarray:
    """One comparable key per row of (N, n_bits) bool: equal keys exactly for equal rows; shape (N,)."""
    packed = np.packbits(bits, axis=1)
    return packed.view(f"V{packed.shape[1]}").ravel()


def first_seen(bits: np.ndarray) -> np.ndarray:
    """Index of the first row equal to each row of (N, n_bits) bool; shape (N,)."""
    _, first, inverse = np.unique(row_keys(bits), return_index=True, return_inverse=True)
    return first[inverse.ravel()]


def evaluate(
    fitness: Fitness, bits: np.ndarray, known_bits: np.ndarray, known_fitness: np.ndarray
) -> tuple[np.ndarray, int]:
    """Fitness of every row, calling `fitness` once, and only for what is not known yet.

    Parameters
    ----------
    fitness : callable
        ``fitness((k, n_bits) bool) -> (k,)``, a function of the bits alone.
    bits : (N, n_bits) bool
        The rows asked for.
    known_bits : (m, n_bits) bool
        Rows whose fitness is known.
    known_fitness : (m,) float64
        Their fitness.

    Returns
    -------
    values : (N,) float64
        Fitness of each row.
    k : int
        How many rows `fitness` was called on: different ones, none of them known.
    """
    n_known = len(known_bits)
    first = first_seen(np.concatenate([known_bits, bits]))[n_known:]
    new = np.flatnonzero(first == np.arange(n_known, n_known + len(bits)))
    values = np.concatenate([known_fitness, np.empty(len(bits))])
    if new.size:
        values[n_known + new] = call_fitness(fitness, frozen(bits[new]))
    return values[first], int(new.size)


def frozen(array: np.ndarray) -> np.ndarray:
    """Return `array` made read-only: what callers are shown, they cannot change."""
    array.flags.writeable = False
    return array


def uniform_sampler(n_bits: int) -> Sampler:
    """Return a sampler whose bits are all independent and even."""
    return lambda n, rng: rng.random((n, n_bits)) < 0.5


def initial_population(
    initial: np.ndarray | Sampler | None,
    shape: tuple[int, int],
    feasible: Feasible | None,
    attempts: int,
    distinct: bool,
    rng: np.random.Generator,
) -> Brood:
    """First population: given rows, then feasible draws until it is full.

    Parameters
    ----------
    initial : (n, n_bits) array of 0 and 1, callable, or None
        Rows to begin with, n <= N, all feasible; or ``initial(n, rng) -> (n, n_bits)``, a sampler to draw from; None:
        even random bits.
    shape : (N, n_bits)
        Size of the population.
    feasible : callable or None
        ``feasible((k, n_bits) bool) -> (k,) bool``.
    attempts : int
        How many times N individuals are drawn at most.
    distinct : bool
        Whether all rows must differ; of equal ones the first stays.
    rng : numpy.random.Generator
        Source of chance.

    Returns
    -------
    Brood
        Feasible rows (N, n_bits) bool, and counts.

    Raises
    ------
    ParameterError
        When given rows have the wrong shape or hold an infeasible row.
    InfeasiblePopulationError
        When too few feasible rows were drawn.
    """
    size, n_bits = shape
    sampler = initial if callable(initial) else uniform_sampler(n_bits)
    rows = np.empty((0, n_bits), dtype=bool)
    if initial is not None and not callable(initial):
        rows = _given_rows(initial, size, n_bits, feasible)
    if distinct:
        rows = _distinct(rows)
    drawn = eliminated = 0
    for _ in range(attempts):
        if len(rows) >= size:
            break
        candidates = check_population("initial(n, rng)", sampler(size, rng), n_bits)
        drawn += len(candidates)
        if feasible is not None:
            survivors = candidates[call_feasible(feasible, frozen(candidates))]
            eliminated += len(candidates) - len(survivors)
            candidates = survivors
        rows = np.concatenate([rows, candidates])
        if distinct:
            rows = _distinct(rows)
    if len(rows) < size:
        kind = "distinct feasible" if distinct else "feasible"
        raise InfeasiblePopulationError(
            f"initial population must hold {size} {kind} individuals. Got {len(rows)} after {drawn} draws, "
            f"{eliminated} of them infeasible."
        )
    return Brood(rows[:size].copy(), drawn, eliminated, kept=0)


def _distinct(rows: np.ndarray) -> np.ndarray:
    result: np.ndarray = rows[first_seen(rows) == np.arange(len(rows))]
    return result


def _given_rows(
    initial: np.ndarray, size: int, n_bits: int, feasible: Feasible | None
) -> np.ndarray:
    rows = check_population("initial", initial, n_bits)
    if len(rows) > size:
        raise ParameterError(
            f"initial must have at most {size} rows, the population size. Got {len(rows)}."
        )
    if feasible is not None and len(rows):
        infeasible = np.flatnonzero(~call_feasible(feasible, frozen(rows.copy())))
        if infeasible.size:
            raise InfeasiblePopulationError(
                f"initial must hold only feasible individuals. "
                f"Got {infeasible.size} infeasible of {len(rows)}, the first in row {infeasible[0]}."
            )
    return rows


# From one generation to the next: select, cross, mutate, eliminate, replace.


# One-point crossover.


def exchange_tails(
    first: np.ndarray, second: np.ndarray, cuts: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Two children of each couple: the parents with their bits from the cut on exchanged.

    Parameters
    ----------
    first, second : (n, n_bits) bool
        The parents of each couple.
    cuts : (n,) int
        How many leading bits each child keeps; n_bits leaves the couple as it is.

    Returns
    -------
    (n, n_bits) bool, (n, n_bits) bool
        The child that begins like `first`, and the one that begins like `second`.
    """
    tail = np.arange(first.shape[1]) >= cuts[:, None]
    return np.where(tail, second, first), np.where(tail, first, second)


def draw_cuts(n: int, n_bits: int, probability: float, rng: np.random.Generator) -> np.ndarray:
    """Cuts of `n` couples: with `probability` a place Y uniform in [1, n_bits - 1], else n_bits (no crossover)."""
    crossed = rng.random(n) < probability
    if n_bits == 1:  # there is no place to cut
        return np.ones(n, dtype=np.int64)
    return np.where(crossed, rng.integers(1, n_bits, n), n_bits)


def one_point(
    first: np.ndarray, second: np.ndarray, probability: float, rng: np.random.Generator
) -> np.ndarray:
    """Cross each couple at one random place, with a given probability.

    Parameters
    ----------
    first, second : (n, n_bits) bool
        The parents of each couple.
    probability : float
        P_c: how likely a couple is crossed rather than copied.
    rng : numpy.random.Generator
        Source of chance.

    Returns
    -------
    (2 n, n_bits) bool
        Row 2 i begins like ``first[i]``, row 2 i + 1 like ``second[i]``.
    """
    cuts = draw_cuts(len(first), first.shape[1], probability, rng)
    children = exchange_tails(first, second, cuts)
    return np.stack(children, axis=1).reshape(-1, first.shape[1])


# Mutation: every bit flips by itself.


def flip_bits(bits: np.ndarray, probability: float, rng: np.random.Generator) -> np.ndarray:
    """Flip every bit by itself, with the same probability.

    A probability of 0.5 forgets the parent altogether. Above it offspring resemble their parent's complement, so 0.9
    keeps as much of a parent as 0.1 does, every other generation.

    Parameters
    ----------
    bits : (N, n_bits) bool
        Individuals; left as they are.
    probability : float
        P_m of the paper.
    rng : numpy.random.Generator
        Source of chance.

    Returns
    -------
    (N, n_bits) bool
        The mutated individuals.
    """
    return bits ^ (rng.random(bits.shape) < probability)


# Who becomes a parent: chances proportional to weights, weights made from fitness.
#
# Every method has a part without chance (weights; slots of the wheel), tested by hand, and a thin
# part that draws.


def proportional_weights(fitness: np.ndarray) -> np.ndarray:
    """Weights of the paper: the fitness itself.

    A wheel has no negative slots. When any fitness is negative, all are shifted up by the lowest, whose weight
    becomes zero; without a negative value nothing is shifted. When all weights would be zero, all become one: an even
    chance.

    Parameters
    ----------
    fitness : (N,) float64
        Finite values, higher is better.

    Returns
    -------
    (N,) float64
        Weights in [0, 1], scaled so that no sum of them can overflow.
    """
    largest = np.abs(fitness).max()
    if largest == 0.0:
        return np.ones(len(fitness))
    # The power of two keeps ratios exact; halves leave room for the difference of two extremes.
    weights = np.ldexp(fitness, -np.frexp(largest)[1] - 1)
    weights = weights - min(weights.min(), 0.0)
    return weights if weights.any() else np.ones(len(fitness))


def window_weights(fitness: np.ndarray) -> np.ndarray:
    """Weights above the worst: fitness minus the lowest of the population, shape (N,).

    Keeps the pressure up when all of a population is good: 0.95 against 0.94 is hardly a difference to
    `proportional_weights`. All equal: an even chance.
    """
    halves = fitness / 2.0
    return proportional_weights(halves - halves.min())


def rank_weights(fitness: np.ndarray) -> np.ndarray:
    """Weights by rank: 1 for the worst to N for the best, equal fitness sharing the mean of their ranks; shape (N,).

    Only the order counts, so the pressure is the same in every generation and for every scale of the fitness.
    """
    _, inverse, counts = np.unique(fitness, return_inverse=True, return_counts=True)
    last = np.cumsum(counts)
    return (last - (counts - 1) / 2.0)[inverse]


def spin(weights: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Slots of the wheel at given positions.

    Parameters
    ----------
    weights : (N,) float64
        Not negative, at least one positive: the width of each slot.
    positions : (n,) float64
        Places on the wheel in [0, 1).

    Returns
    -------
    (n,) int64
        Index of the slot at each position; a slot is closed on its left and open on its right, so one of zero width
        is never met.
    """
    # the power of two changes no share, and keeps the least of weights apart
    edges = np.cumsum(np.ldexp(weights, -np.frexp(weights.max())[1]))
    slots = np.searchsorted(edges, positions * edges[-1], side="right")
    # A position just below 1 may round up to the very end of the wheel.
    result: np.ndarray = np.minimum(slots, np.flatnonzero(weights)[-1])
    return result


def roulette(weights: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    """Roulette wheel: `n` independent spins; indices of shape (n,)."""
    return spin(weights, rng.random(n))


def stochastic_universal(weights: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    """Stochastic universal sampling: one spin of a wheel with `n` evenly spaced pointers; indices of shape (n,).

    Guarantee: an individual with the share s of all weight is chosen floor(n s) or ceil(n s) times. The result is
    shuffled, so that pairs of neighbours are pairs at random. J. E. Baker, "Reducing bias and inefficiency in the
    selection algorithm", Proc. 2nd Int. Conf. on Genetic Algorithms, 1987.
    """
    positions = (np.arange(n) + rng.random()) / n
    return rng.permutation(spin(weights, positions))


Scaling = Literal["proportional", "window", "rank"]
Selection = Literal["roulette", "sus"]
SCALINGS: dict[Scaling, Callable[[np.ndarray], np.ndarray]] = {
    "proportional": proportional_weights,
    "window": window_weights,
    "rank": rank_weights,
}
SELECTIONS: dict[Selection, Callable[[np.ndarray, int, np.random.Generator], np.ndarray]] = {
    "roulette": roulette,
    "sus": stochastic_universal,
}


@dataclass(frozen=True)
class Breeding:
    """How offspring are made; checked by `ga.maximize`, whose parameters these are.

    `weigh` and `select` are the functions behind the names in `ga.bits.SCALINGS` and `SELECTIONS`.
    """

    crossover: float
    mutation: float
    weigh: Callable[..., np.ndarray]
    select: Callable[..., np.ndarray]
    elitism: int
    duplicates: bool
    attempts: int
    feasible: Feasible | None


def breed(
    population: np.ndarray,
    weights: np.ndarray,
    n: int,
    breeding: Breeding,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Draw `n` offspring, feasible or not.

    Parameters
    ----------
    population : (N, n_bits) bool
        The generation parents are chosen from.
    weights : (N,) float64
        Their slots on the wheel.
    n : int
        Offspring wanted.
    breeding : Breeding
        Operators and probabilities.
    rng : numpy.random.Generator
        Source of chance.

    Returns
    -------
    children : (n, n_bits) bool
        The offspring. Couples have two; of an odd number the last child is dropped.
    parents : (n,) int64
        Index of the parent whose leading bits a child has.
    """
    parents = breeding.select(weights, n + n % 2, rng)
    children = one_point(
        population[parents[0::2]], population[parents[1::2]], breeding.crossover, rng
    )
    return flip_bits(children, breeding.mutation, rng)[:n], parents[:n]


def next_generation(
    population: np.ndarray, fitness: np.ndarray, breeding: Breeding, rng: np.random.Generator
) -> Brood:
    """Make the next population, of the same size and all feasible.

    The best `elitism` individuals come first, unchanged. Every other place draws an offspring; one that is infeasible
    (or, without `duplicates`, equal to an individual already in the new population) is eliminated and the place draws
    again, up to `attempts` times in all. A place that has drawn in vain goes to the parent of its last offspring,
    which is feasible.

    Parameters
    ----------
    population : (N, n_bits) bool
        Feasible individuals.
    fitness : (N,) float64
        Their fitness.
    breeding : Breeding
        Operators, probabilities and rules.
    rng : numpy.random.Generator
        Source of chance.

    Returns
    -------
    Brood
        The new population, (N, n_bits) bool, and counts.
    """
    weights = breeding.weigh(fitness)
    elite = np.argsort(-fitness, kind="stable")[: breeding.elitism]
    following = population.copy()
    following[: breeding.elitism] = population[elite]
    taken = np.arange(len(population)) < breeding.elitism
    parents = np.zeros(len(population), dtype=np.int64)
    drawn = eliminated = 0
    for _ in range(breeding.attempts):
        places = np.flatnonzero(~taken)
        if not places.size:
            break
        following[places], parents[places] = breed(population, weights, places.size, breeding, rng)
        drawn += places.size
        if breeding.feasible is not None:
            places = places[call_feasible(breeding.feasible, frozen(following[places]))]
            eliminated += int((~taken).sum()) - places.size
        if not breeding.duplicates:
            places = places[_is_new(following, taken, places)]
        taken[places] = True
    gaps = np.flatnonzero(~taken)
    following[gaps] = population[parents[gaps]]
    return Brood(following, drawn, eliminated, gaps.size)


def _is_new(bits: np.ndarray, taken: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Which rows at `places` equal no taken row and no earlier row at `places`; shape (len(places),) bool."""
    n_taken = int(taken.sum())
    first = first_seen(np.concatenate([bits[taken], bits[places]]))[n_taken:]
    result: np.ndarray = first == np.arange(n_taken, n_taken + places.size)
    return result
