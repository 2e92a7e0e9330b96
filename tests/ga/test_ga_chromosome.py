"""Genes, integers and Gray code against tables written by hand."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ga import Chromosome, ParameterError, binary_from_gray, gray_from_binary

BINARY = ["000", "001", "010", "011", "100", "101", "110", "111"]
GRAY = ["000", "001", "011", "010", "110", "111", "101", "100"]


def rows(strings):
    return np.array([[c == "1" for c in string] for string in strings])


def test_gray_code_table():
    assert np.array_equal(gray_from_binary(rows(BINARY)), rows(GRAY))
    assert np.array_equal(binary_from_gray(rows(GRAY)), rows(BINARY))


def test_gray_neighbours_differ_in_one_bit():
    chromosome = Chromosome(1, 10, gray=True)
    bits = chromosome.bits_from_integers(np.arange(1024)[:, None])
    assert np.array_equal((bits[1:] != bits[:-1]).sum(axis=1), np.ones(1023))


def test_genes_are_read_most_significant_bit_first():
    bits = rows(["011100", "110001"])
    assert Chromosome(2, 3).integers(bits).tolist() == [[3, 4], [6, 1]]
    assert Chromosome(3, 2).integers(bits).tolist() == [[1, 3, 0], [3, 0, 1]]
    assert Chromosome(2, 3, gray=True).integers(bits).tolist() == [[2, 7], [4, 1]]
    assert Chromosome(2, 3).genes(bits)[1].astype(int).tolist() == [[1, 1, 0], [0, 0, 1]]


def test_a_single_chromosome_needs_no_population_axis():
    assert Chromosome(2, 3).integers(rows(["011100"])[0]).tolist() == [3, 4]


def test_fractions_reach_both_ends():
    assert Chromosome(2, 3).fractions(rows(["000111", "001100"])).tolist() == [
        [0.0, 1.0],
        [1 / 7, 4 / 7],
    ]


def test_decode_returns_the_ends_exactly():
    low = np.array([-0.1, 0.3])
    high = np.array([0.7, 1e9])
    decoded = Chromosome(2, 5).decode(rows(["0000011111", "1111100000"]), low, high)
    assert decoded.tolist() == [[-0.1, 1e9], [0.7, 0.3]]


def test_decode_with_one_range_for_all_genes():
    assert Chromosome(2, 2).decode(rows(["0110"]), 0.0, 3.0) == pytest.approx(
        np.array([[1.0, 2.0]])
    )


def test_longest_gene_is_exact():
    chromosome = Chromosome(1, 53)
    top = np.array([[2**53 - 1], [2**52 + 1]])
    assert np.array_equal(chromosome.integers(chromosome.bits_from_integers(top)), top)


@given(
    n_genes=st.integers(1, 6),
    bits_per_gene=st.integers(1, 20),
    gray=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_encoding_and_decoding_are_inverse(n_genes, bits_per_gene, gray, seed):
    chromosome = Chromosome(n_genes, bits_per_gene, gray)
    rng = np.random.default_rng(seed)
    bits = rng.random((7, chromosome.n_bits)) < 0.5
    assert np.array_equal(chromosome.bits_from_integers(chromosome.integers(bits)), bits)
    assert np.array_equal(chromosome.encode(chromosome.fractions(bits)), bits)
    t = rng.random((7, n_genes))
    assert (
        np.abs(chromosome.fractions(chromosome.encode(t)) - t).max()
        <= 0.5 / (2**bits_per_gene - 1) + 1e-15
    )


def test_every_integer_once():
    chromosome = Chromosome(2, 2, gray=True)
    bits = np.array(list(itertools.product([False, True], repeat=4)))
    assert sorted(map(tuple, chromosome.integers(bits).tolist())) == list(
        itertools.product(range(4), repeat=2)
    )


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Chromosome(0, 4), r"n_genes must be an integer of at least 1\. Got 0\."),
        (lambda: Chromosome(2, 54), r"bits_per_gene must be an integer in \[1, 53\]\. Got 54\."),
        (lambda: Chromosome(2, 4, gray="yes"), r"gray must be True or False\. Got 'yes'\."),
        (
            lambda: Chromosome(2, 4).integers(np.zeros((3, 7))),
            r"bits must have 8 bits .* Got shape \(3, 7\)\.",
        ),
        (lambda: Chromosome(1, 2).integers([[0, 2]]), r"bits must hold only 0 and 1\. Got 2\."),
        (
            lambda: Chromosome(1, 2).integers([["0", "1"]]),
            r"bits must hold only 0 and 1\. Got an array of <U1\.",
        ),
        (
            lambda: gray_from_binary(1),
            r"bits must have bits along its last axis\. Got shape \(\)\.",
        ),
        (lambda: binary_from_gray([0, 3]), r"bits must hold only 0 and 1\. Got 3\."),
        (lambda: Chromosome(1, 2).encode([1.5]), r"fractions must be in \[0, 1\]\. Got 1\.5\."),
        (lambda: Chromosome(1, 2).encode([np.nan]), r"fractions must be in \[0, 1\]\. Got nan\."),
        (
            lambda: Chromosome(2, 2).encode([0.5]),
            r"fractions must have 2 genes .* Got shape \(1,\)\.",
        ),
        (
            lambda: Chromosome(1, 2).bits_from_integers([4]),
            r"integers must be integers in \[0, 3\]\. Got 4\.",
        ),
        (
            lambda: Chromosome(1, 2).bits_from_integers([0.5]),
            r"integers in \[0, 3\]\. Got an array of float64\.",
        ),
        (
            lambda: Chromosome(1, 2).decode([0, 1], 0.0, np.inf),
            r"high must be one finite number.*Got inf\.",
        ),
        (
            lambda: Chromosome(1, 2).decode([0, 1], 2.0, 1.0),
            r"low must not be above high\. Got 2\.0 and 1\.0\.",
        ),
        (
            lambda: Chromosome(2, 1).decode([0, 1], [0.0, 0.0, 0.0], 1.0),
            r"low must be one .* each of 2 genes",
        ),
    ],
)
def test_bad_input(call, message):
    with pytest.raises(ParameterError, match=message):
        call()
