"""Heights to the last bit: whole numbers in the order of the floats, their differences, byte planes, deflate."""

import zlib

import numpy as np
from jaxtyping import Bool, Float

from .._errors import InputError

#: Deflate packs no more bytes than this into one.
_MOST_INFLATED = 1032


def encode_exactly(heights: Float[np.ndarray, "rows columns"], missing: Bool[np.ndarray, "rows columns"]) -> bytes:
    """The valid heights, so that they come back to the last bit."""
    words = _unsigned(heights.dtype)
    bits = np.ascontiguousarray(heights).view(words)[~missing]
    # Floats are ordered as their bits are, negative ones backwards.
    top = words.type(1) << words.type(8 * words.itemsize - 1)
    ordered = np.where(bits & top, ~bits, bits | top)
    steps = np.diff(ordered, prepend=words.type(0)).astype(words.newbyteorder("<"))
    planes = np.ascontiguousarray(steps.view(np.uint8).reshape(-1, words.itemsize).T)
    return zlib.compress(planes.tobytes(), 9)


def decode_exactly(
    content: bytes | memoryview, dtype: np.dtype, missing: Bool[np.ndarray, "rows columns"]
) -> Float[np.ndarray, "rows columns"]:
    """The heights that were encoded, NaN where they are missing.

    **Raises:** `InputError` where there are not as many as there are valid pixels.
    """
    words = _unsigned(dtype)
    # In place where it can be: the largest maps that fit into memory shall be read.
    ordered = _inflated(content, missing.size - int(np.count_nonzero(missing)), words)
    np.cumsum(ordered, out=ordered)
    top = words.type(1) << words.type(8 * words.itemsize - 1)
    negative = ordered < top
    np.bitwise_xor(ordered, top, out=ordered, where=~negative)
    np.invert(ordered, out=ordered, where=negative)
    heights = np.full(missing.shape, np.nan, dtype)
    heights[~missing] = ordered.view(dtype)
    return heights


def _inflated(content: bytes | memoryview, count: int, words: np.dtype) -> np.ndarray:
    """As many numbers as asked for, from their byte planes one by one."""
    size = count * words.itemsize
    if size > _MOST_INFLATED * len(content):
        raise InputError(
            f"its heights take {size} bytes, which {len(content)} cannot hold: it was damaged; copy it again"
        )
    numbers = np.empty((count, words.itemsize), np.uint8)
    inflate, rest = zlib.decompressobj(), content
    try:
        for k in range(words.itemsize):
            plane, rest = inflate.decompress(rest, count), inflate.unconsumed_tail
            if len(plane) < count:
                raise ValueError("they end too early")
            numbers[:, k] = np.frombuffer(plane, np.uint8)
        more = inflate.decompress(rest, 1)
    except (zlib.error, ValueError) as error:
        raise InputError(f"its heights cannot be unpacked: {error}; it was damaged: copy it again") from error
    if more:
        raise InputError(f"its heights take more than the {size} bytes that are needed; it was damaged: copy it again")
    return numbers.view(words.newbyteorder("<")).ravel().astype(words, copy=False)


def _unsigned(dtype: np.dtype) -> np.dtype:
    """Whole numbers of a float's size."""
    return np.dtype(np.uint64 if dtype.itemsize == 8 else np.uint32)
