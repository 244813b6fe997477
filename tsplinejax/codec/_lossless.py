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
    size = (missing.size - int(np.count_nonzero(missing))) * words.itemsize
    if size > _MOST_INFLATED * len(content):
        raise InputError(
            f"its heights take {size} bytes, more than {len(content)} can hold; it was damaged: copy it again"
        )
    inflate = zlib.decompressobj()
    try:
        planes = inflate.decompress(content, size + 1)
    except zlib.error as error:
        raise InputError(f"its heights cannot be unpacked: {error}") from error
    if len(planes) != size:
        raise InputError(f"its heights take {len(planes)} bytes, where {size} are needed")
    # In place where it can be: the largest maps that fit into memory shall be read.
    steps = np.frombuffer(planes, np.uint8).reshape(words.itemsize, -1).T.copy()
    del planes
    ordered = steps.view(words.newbyteorder("<")).ravel().astype(words, copy=False)
    np.cumsum(ordered, out=ordered)
    top = words.type(1) << words.type(8 * words.itemsize - 1)
    negative = ordered < top
    np.bitwise_xor(ordered, top, out=ordered, where=~negative)
    np.invert(ordered, out=ordered, where=negative)
    heights = np.full(missing.shape, np.nan, dtype)
    heights[~missing] = ordered.view(dtype)
    return heights


def _unsigned(dtype: np.dtype) -> np.dtype:
    """Whole numbers of a float's size."""
    return np.dtype(np.uint64 if dtype.itemsize == 8 else np.uint32)
