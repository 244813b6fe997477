"""Entropy coding: what is written is read, near the entropy, and damage is refused."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.extra import numpy as hnp

from tsplinejax import InputError
from tsplinejax.codec._entropy import Decoder, Encoder, bit_model, join, number_model, plain_lengths, split

NUMBERS = hnp.arrays(np.int64, st.integers(0, 300), elements=st.integers(-(2**39), 2**39))


@given(NUMBERS)
def test_split_numbers_join_again(numbers):
    """Token and plain bits together are the number, and the token alone tells how many bits follow."""
    tokens, rest, lengths = split(numbers)
    np.testing.assert_array_equal(join(tokens, rest), numbers)
    np.testing.assert_array_equal(plain_lengths(tokens), lengths)


def _contexts(rng, count):
    return rng.integers(0, 5, count), rng.integers(0, 3, count)


@settings(max_examples=40)
@given(st.lists(NUMBERS, max_size=4), st.integers(0, 2**32))
def test_what_is_written_is_read(batches, seed):
    """Any numbers in any contexts, in several calls that share a model."""
    rng = np.random.default_rng(seed)
    contexts = [_contexts(rng, len(batch)) for batch in batches]
    encoder, model = Encoder(), number_model(5, 3)
    for batch, context in zip(batches, contexts, strict=True):
        encoder.code(model, context, batch)
    decoder, model = Decoder(*encoder.finish()), number_model(5, 3)
    for batch, context in zip(batches, contexts, strict=True):
        np.testing.assert_array_equal(decoder.code(model, context, None), batch)


@pytest.mark.parametrize("scale", [0.1, 1.0, 30.0])
def test_size_is_near_the_entropy(scale):
    """Independent numbers take at most 3 % more than their entropy, whatever their spread."""
    numbers = np.rint(np.random.default_rng(0).laplace(scale=scale, size=100_000)).astype(np.int64)
    nowhere = np.zeros(len(numbers), np.int64)
    encoder = Encoder()
    encoder.code(number_model(1, 1), (nowhere, nowhere), numbers)
    counts = np.unique(numbers, return_counts=True)[1]
    entropy = -(counts * np.log2(counts / len(numbers))).sum() / 8
    assert sum(map(len, encoder.finish())) < 1.03 * entropy + 50


def test_contexts_pay():
    """Bits that their context tells take next to nothing."""
    bits = np.random.default_rng(0).integers(0, 2, 20_000)
    encoder = Encoder()
    encoder.code(bit_model(np.full(2, 0.5), np.full(2, 0.5)), (bits, bits), bits)
    assert sum(map(len, encoder.finish())) < 60


def test_bytes_that_end_early_are_refused():
    """Reading on behind the last number ends in an error, before much is read."""
    numbers = np.arange(-200, 200)
    nowhere = np.zeros(len(numbers), np.int64)
    encoder = Encoder()
    encoder.code(number_model(1, 1), (nowhere, nowhere), numbers)
    tokens, plain = encoder.finish()
    many = np.zeros(10**6, np.int64)
    for damaged in ((tokens, plain), (tokens[:101], plain), (tokens, plain[:9]), (b"", b""), (b"\xff" * 5, b"")):
        with pytest.raises(InputError, match="damaged"):
            Decoder(*damaged).code(number_model(1, 1), (many, many), None)


def test_coded_bytes_do_not_change():
    """A file of today is read tomorrow: the range coder's bytes are part of the format."""
    numbers = np.array([0, 0, 1, -1, 3, 0, 12, -70, 0, 5])
    nowhere = np.zeros(len(numbers), np.int64)
    encoder = Encoder()
    encoder.code(number_model(1, 1), (nowhere, nowhere), numbers)
    assert [part.hex() for part in encoder.finish()] == ["18dbcf93d1d6a2327f", "0680"]
