"""Adaptive entropy coding of whole numbers, in batches: small tokens with contexts, larger numbers with plain bits.

A number is split into a token and a few plain bits. Tokens are range-coded with a distribution for each context, and
distributions are counts that both sides update after every batch, so nothing but the tokens is written. All arithmetic
on counts is on integers: encoder and decoder agree on every machine. The range coder is constriction's (Bamler,
"Understanding entropy coding with asymmetric numeral systems", arXiv 2201.01741).
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from .._errors import InputError

#: Numbers of at most this magnitude have tokens of their own, one for each sign.
_PLAIN = 8
#: No coded number has more binary digits than this.
MOST_DIGITS = 40
N_TOKENS = 2 * _PLAIN + 1 + 2 * (MOST_DIGITS - 3)
_FIRST_BATCH, _LAST_BATCH = 128, 4096
_GROWTH = 32  # what a coded token adds to its count
_GUESSED = 2 * _GROWTH  # what a guess about a bit counts
_HALVED_AT = 1 << 18

#: One context of each family for every number.
Contexts = tuple[np.ndarray, np.ndarray]


def split(values: Int[np.ndarray, " n"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tokens, plain bits, and how many plain bits, of numbers below 2**MOST_DIGITS in magnitude.

    >>> split(np.array([0, 1, -1, 8, 9, -13]))[0].tolist()
    [0, 1, 2, 15, 17, 18]
    """
    size = np.abs(values)
    small = size <= _PLAIN
    tokens = np.where(values > 0, 2 * size - 1, 2 * size)
    large = np.where(small, _PLAIN, size)
    digits = _digits(large)
    half = (large >> (digits - 2)) & 1
    tokens = np.where(small, tokens, 2 * _PLAIN + 1 + 2 * (digits - 4) + half)
    lengths = np.where(small, 0, digits - 1)  # below the two leading digits, and the sign
    rest = ((large & ((np.int64(1) << (digits - 2)) - 1)) << 1) | (values < 0)
    return tokens, np.where(small, 0, rest), lengths


def _digits(values: np.ndarray) -> np.ndarray:
    """Number of binary digits of numbers from 1 to 2**52, exactly."""
    return np.frexp(values.astype(np.float64))[1].astype(np.int64)


def plain_lengths(tokens: np.ndarray) -> np.ndarray:
    """How many plain bits follow each token."""
    return np.where(tokens <= 2 * _PLAIN, 0, (tokens - 2 * _PLAIN - 1) // 2 + 3)


def join(tokens: Int[np.ndarray, " n"], rest: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """Numbers from tokens and plain bits: the inverse of `split`.

    >>> numbers = np.array([5, -8, 9, -9, 1000, -123456789])
    >>> tokens, rest, _ = split(numbers)
    >>> join(tokens, rest).tolist() == numbers.tolist()
    True
    """
    small = tokens <= 2 * _PLAIN
    plain = np.where(tokens % 2 == 1, (tokens + 1) // 2, -(tokens // 2))
    which = np.where(small, 0, tokens - 2 * _PLAIN - 1)
    digits = which // 2 + 4
    size = ((np.int64(2) + which % 2) << (digits - 2)) | (rest >> 1)
    return np.where(small, plain, np.where(rest & 1, -size, size))


def packed(values: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """The bits of numbers one after another, the most significant first, as uint8 zeros and ones."""
    ends = np.cumsum(lengths)
    bits = np.zeros(int(ends[-1]) if len(ends) else 0, np.uint8)
    for place in range(int(lengths.max(initial=0))):
        holds = lengths > place
        bits[ends[holds] - 1 - place] = (values[holds] >> place) & 1
    return bits


def unpacked(bits: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Numbers from their bits: the inverse of `packed`."""
    ends = np.cumsum(lengths)
    values = np.zeros(len(lengths), np.int64)
    for place in range(int(lengths.max(initial=0))):
        holds = lengths > place
        values[holds] |= bits[ends[holds] - 1 - place].astype(np.int64) << place
    return values


@cache
def _start_counts() -> Int[np.ndarray, "widths tokens"]:
    """Counts before anything was seen: two-sided geometric distributions, from nearly all zeros to nearly flat."""
    counts = np.ones((len(_RATIOS), N_TOKENS), np.int64)
    for row, (up, down) in enumerate(_RATIOS):
        weight = 1 << 20
        counts[row, 0] = weight
        for size in range(1, _PLAIN + 1):
            weight = weight * up // down
            counts[row, 2 * size - 1 : 2 * size + 1] = weight
        for token in range(2 * _PLAIN + 1, N_TOKENS):
            weight = weight * up // down
            counts[row, token] = 2 * weight
        # As much as sixteen tokens seen, and never nothing.
        counts[row] = counts[row] * (_GROWTH * 16) // counts[row].sum() + 1
    return counts


#: Decay of the start distributions, from nearly all zeros to nearly flat.
_RATIOS = (
    (1, 64), (1, 32), (1, 20), (1, 13), (1, 8), (1, 6), (1, 4), (1, 3), (2, 5), (1, 2), (3, 5), (2, 3), (3, 4), (4, 5),
    (6, 7), (9, 10), (14, 15), (19, 20), (29, 30), (39, 40),
)  # fmt: skip


@dataclass(eq=False)
class Model:
    """The distributions of one kind of symbol: counts for each of its contexts, mixed from two families of contexts."""

    first: Int[np.ndarray, "contexts tokens"]
    second: Int[np.ndarray, "contexts tokens"]

    def frequencies(self, contexts: Contexts, n_tokens: int) -> np.ndarray:
        """Frequencies of each symbol's tokens, whole numbers in float64: what the range coder takes exactly."""
        parts = [
            table[:, :n_tokens] * (_SHARE // table[:, :n_tokens].sum(axis=1, keepdims=True))
            for table in (self.first, self.second)
        ]
        return (parts[0][contexts[0]] + parts[1][contexts[1]]).astype(np.float64)

    def update(self, contexts: Contexts, tokens: np.ndarray) -> None:
        """Count what was coded."""
        for table, context in zip((self.first, self.second), contexts, strict=True):
            np.add.at(table, (context, tokens), _GROWTH)
            large = table.sum(axis=1) > _HALVED_AT
            table[large] = (table[large] >> 1) | 1


_SHARE = 1 << 40
_DAMAGED = "its coded numbers end too early or make no sense; it was damaged: copy it again"


def number_model(first: int, second: int) -> Model:
    """A model of numbers, whose contexts of each family start with distributions that widen with their number."""
    widest = len(_RATIOS) - 1
    tables = [_start_counts()[np.minimum(np.arange(contexts), widest)] for contexts in (first, second)]
    return Model(*tables)


def bit_model(first: Float[np.ndarray, " contexts"], second: Float[np.ndarray, " contexts"]) -> Model:
    """A model of bits, from a guess for each context of either family how often the bit is one."""
    tables = [np.ones((len(guess), N_TOKENS), np.int64) for guess in (first, second)]
    for table, guess in zip(tables, (first, second), strict=True):
        ones = np.rint(np.clip(guess, 1 / 64, 63 / 64) * _GUESSED).astype(np.int64)
        table[:, 0], table[:, 1] = _GUESSED - ones, ones
    return Model(*tables)


class AbstractCoder(ABC):
    """What encoder and decoder share: one call codes a batch of numbers, or reads it."""

    @abstractmethod
    def code(self, model: Model, contexts: Contexts, values: np.ndarray | None) -> np.ndarray:
        """Write the values, or read as many as there are contexts; both return them."""


def _batches(count: int):
    """Slices of a count that grow: short ones while little is known."""
    start, length = 0, _FIRST_BATCH
    while start < count:
        yield slice(start, min(start + length, count))
        start, length = start + length, min(2 * length, _LAST_BATCH)


def _streams() -> Any:
    """The range coder and its distributions, imported when first used."""
    import constriction

    # An extension module whose parts its type stubs do not show.
    return constriction.stream  # pyright: ignore[reportAttributeAccessIssue]


def _family() -> Any:
    """Distributions given with every symbol."""
    return _streams().model.Categorical(perfect=False)


@dataclass(eq=False)
class Encoder(AbstractCoder):
    """Collects numbers, and writes them once it is known which tokens occur."""

    calls: list[tuple[Model, Contexts, np.ndarray]] = field(default_factory=list)

    def code(self, model: Model, contexts: Contexts, values: np.ndarray | None) -> np.ndarray:
        """Take the values to write; a model is left alone until `finish`."""
        assert values is not None
        self.calls.append((model, contexts, values))
        return values

    def finish(self) -> tuple[bytes, bytes]:
        """The coded tokens, with the number of different tokens in the first byte, and the plain bits."""
        parts = [split(values) for _, _, values in self.calls]
        n_tokens = max([int(tokens.max(initial=0)) for tokens, _, _ in parts], default=0) + 1
        n_tokens = max(n_tokens, 2)
        coder: Any = _streams().queue.RangeEncoder()
        family = _family()
        for (model, contexts, _), (tokens, _, _) in zip(self.calls, parts, strict=True):
            for part in _batches(len(tokens)):
                now = (contexts[0][part], contexts[1][part])
                coder.encode(tokens[part].astype(np.int32), family, model.frequencies(now, n_tokens))
                model.update(now, tokens[part])
        words = np.asarray(coder.get_compressed()).astype("<u4").tobytes()
        bits = np.concatenate([packed(rest, lengths) for _, rest, lengths in parts] or [np.zeros(0, np.uint8)])
        return bytes([n_tokens]) + words, np.packbits(bits).tobytes()


@dataclass(eq=False)
class Decoder(AbstractCoder):
    """Reads numbers from what an encoder wrote.

    **Raises:** `InputError` where the bytes end too early or are none of an encoder's.
    """

    tokens: bytes | memoryview
    plain: bytes | memoryview

    def __post_init__(self) -> None:
        if len(self.tokens) % 4 != 1 or not 2 <= self.tokens[0] <= N_TOKENS:
            raise InputError(_DAMAGED)
        self._n_tokens = self.tokens[0]
        words = np.frombuffer(self.tokens, "<u4", offset=1).astype(np.uint32, copy=False)
        # One word more than was written is read ahead of the last symbols.
        self._coder: Any = _streams().queue.RangeDecoder(np.concatenate([words, np.zeros(2, np.uint32)]))
        self._family = _family()
        self._plain = np.frombuffer(self.plain, np.uint8)
        self._place = 0

    def code(self, model: Model, contexts: Contexts, values: np.ndarray | None) -> np.ndarray:
        """Read as many numbers as there are contexts."""
        values = np.empty(len(contexts[0]), np.int64)
        for part in _batches(len(values)):
            now = (contexts[0][part], contexts[1][part])
            tokens = self._tokens(model.frequencies(now, self._n_tokens))
            model.update(now, tokens)
            values[part] = join(tokens, self._rest(plain_lengths(tokens)))
        return values

    def _rest(self, lengths: np.ndarray) -> np.ndarray:
        """The next numbers of plain bits."""
        start, end = self._place, self._place + int(lengths.sum())
        if end > 8 * len(self._plain):
            raise InputError(_DAMAGED)
        self._place = end
        return unpacked(np.unpackbits(self._plain[start >> 3 : (end + 7) >> 3])[start & 7 :], lengths)

    def _tokens(self, frequencies: np.ndarray) -> np.ndarray:
        """The next tokens; what is read beyond the end was never written."""
        if self._coder.maybe_exhausted():
            raise InputError(_DAMAGED)
        try:
            return self._coder.decode(self._family, frequencies).astype(np.int64)
        except (AssertionError, ValueError) as error:
            raise InputError(_DAMAGED) from error
