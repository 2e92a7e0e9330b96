"""Bit strings and the numbers they stand for.

A chromosome is a row of bits: `n_genes` genes of `bits_per_gene` bits each, the most significant bit first. A gene is
read as an integer in [0, 2**M - 1], and that as a fraction of a range, so that both ends of the range are exactly
representable.

In plain binary a step of one may flip every bit (0111 -> 1000, a "Hamming cliff"); in Gray code neighbouring integers
always differ in exactly one bit, so a single mutation can make a smallest step from anywhere.
"""

from dataclasses import dataclass

import numpy as np

from ga.checks import check_bits, check_flag, check_integer, check_range
from ga.exceptions import ParameterError

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
