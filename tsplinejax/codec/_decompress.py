"""`decompress`: the height map of a compressed file, on its own grid or on another."""

import os
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from .._errors import InputError
from ..data import HeightMap
from ..io._files import MOST_VALUES, existing_file, reading
from ..surface import heights_on_grid
from ._compressed import CompressedHeader, parse_compressed
from ._entropy import Decoder
from ._grid import UNITS, HeightCoder
from ._lossless import decode_exactly
from ._mask import code_mask
from ._model import RoundedModel, code_model, require_x64, surface_of_model
from ._sections import MARK, opened

NO_MODEL = (
    "it holds the pixels of a height map, and no T-spline; read it with decompress, or compress the map with "
    "mode='model' (--mode model)"
)


def decompress(source: bytes | str | os.PathLike, *, shape: Sequence[int] | None = None) -> HeightMap:
    """The height map of a compressed file.

    **Arguments:**

    - `source`: the bytes from `compress`, or the path of a file that holds them.
    - `shape`: (rows, columns) of another grid over the same extent: heights are then interpolated, bilinearly between
      pixels, or by the T-spline where the file is one without corrections; they are missing where a pixel next to them
      is. The bound holds on the file's own grid.

    **Returns:** the map, with unit, spacing, origin, provenance, and NaN where pixels are missing.

    **Raises:** `InputError` for a file that is missing, truncated, corrupted or no compressed height map, and for a
    shape that is no pair of counts of at least 2.

    >>> from tsplinejax.codec import compress
    >>> content = compress([[0.0, 1.0], [2.0, float("nan")]], max_error=0.1)
    >>> decompress(content).valid.sum(), decompress(content, shape=(3, 5)).shape
    (np.int64(3), (3, 5))
    """
    with named(source):
        decoded = decode(content_of(source))
        header = decoded.header
        data = HeightMap(
            decoded.heights, header.spacing, header.unit, origin=header.origin, provenance=header.provenance
        )
    if shape is None:
        return data
    size = _checked_shape(shape, data.shape)
    other = resampled(data, size)
    if decoded.model is None or header.model is None or header.model.residual:
        return other
    exact = heights_on_grid(surface_of_model(header, decoded.model, np.float64), size)
    return other.with_heights(np.where(other.valid, exact, np.nan).astype(header.dtype))


def compressed_header(source: bytes | str | os.PathLike) -> CompressedHeader:
    """What a compressed file says about its map, without decoding it.

    **Raises:** `InputError` as for [`decompress`][tsplinejax.decompress].

    >>> from tsplinejax.codec import compress
    >>> compressed_header(compress([[0.0, 1.0], [2.0, 3.0]], max_error=0.1)).shape
    (2, 2)
    """
    with named(source):
        content = content_of(source)
        return parse_compressed(opened(content)[0], len(content))


def content_of(source: bytes | str | os.PathLike) -> bytes:
    """The bytes of a compressed file."""
    if isinstance(source, bytes | bytearray | memoryview):
        return bytes(source)
    return existing_file(source).read_bytes()


def is_compressed(path: str | os.PathLike) -> bool:
    """Whether a file starts as compressed height maps do."""
    with Path(path).open("rb") as stream:
        return stream.read(len(MARK)) == MARK


def named(source: bytes | str | os.PathLike) -> AbstractContextManager[None]:
    """Say in every error which file it is about."""
    held = isinstance(source, bytes | bytearray | memoryview)
    return reading(Path("compressed.tspl") if held else existing_file(source))  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class Decoded:
    """What a compressed file holds; `model` is `None` where there is no T-spline."""

    header: CompressedHeader
    heights: Float[np.ndarray, "rows columns"]
    model: RoundedModel | None


def decode(content: bytes) -> Decoded:
    """Everything in a compressed file."""
    header, sections = read_file(content)
    coder = Decoder(sections[0], sections[1])
    missing = _missing(header, coder)
    dtype, model = np.dtype(header.dtype), None
    if header.mode == "lossless":
        heights = decode_exactly(sections[2], dtype, missing)
    else:
        if header.model is not None:
            require_x64()
            model = code_model(coder, header.model, None)
        with np.errstate(over="ignore"):
            heights = _heights(header, coder, missing, model).astype(dtype, copy=False)
        heights[missing] = np.nan
    if not (np.isfinite(heights) | missing).all():
        raise InputError("its heights are not finite; it was damaged: copy it again")
    return Decoded(header, heights, model)


def decode_model(content: bytes) -> tuple[CompressedHeader, RoundedModel]:
    """The T-spline of a compressed file, its pixels left alone."""
    header, sections = read_file(content)
    if header.model is None:
        raise InputError(NO_MODEL)
    coder = Decoder(sections[0], sections[1])
    _missing(header, coder)
    return header, code_model(coder, header.model, None)


def read_file(content: bytes) -> tuple[CompressedHeader, list[memoryview]]:
    """The header and as many sections as its mode has."""
    entries, sections = opened(content)
    header = parse_compressed(entries, len(content))
    if len(sections) != (3 if header.mode == "lossless" else 2):
        raise InputError(f"it holds {len(sections)} sections, which is wrong for the mode {header.mode}")
    return header, sections


def _heights(
    header: CompressedHeader, coder: Decoder, missing: np.ndarray, model: RoundedModel | None
) -> Float[np.ndarray, "rows columns"]:
    """Pixels above the offset, or a T-spline with corrections of single pixels where there are any."""
    corrections = None
    if header.model is None or header.model.residual:
        # Before the T-spline is evaluated: damaged numbers end before memory is taken for all pixels.
        corrections = HeightCoder(coder, missing, None).run() * (header.step / UNITS)
    base = (
        header.offset if model is None else heights_on_grid(surface_of_model(header, model, np.float64), header.shape)
    )
    if corrections is None:
        return np.asarray(base)
    corrections += base
    return corrections


def _missing(header: CompressedHeader, coder: Decoder) -> np.ndarray:
    """The mask of missing pixels."""
    if header.missing == 0:
        return np.zeros(header.shape, bool)
    missing = code_mask(coder, header.shape, None)
    if np.count_nonzero(missing) != header.missing:
        raise InputError(
            f"its mask has {np.count_nonzero(missing)} missing pixels, but its header says {header.missing}"
        )
    return missing


def _checked_shape(shape: Sequence[int], own: tuple[int, int]) -> tuple[int, int]:
    try:
        rows, columns = (int(count) for count in shape)
    except (TypeError, ValueError) as error:
        raise InputError(f"a shape is (rows, columns), but got {shape!r}") from error
    if min(rows, columns, *own) < 2:
        raise InputError(f"grids of at least 2 × 2 pixels are interpolated; asked for {rows} × {columns} from {own}")
    if rows * columns > MOST_VALUES:
        raise InputError(
            f"a grid has at most {MOST_VALUES} pixels; asked for {rows} × {columns}; choose a smaller shape"
        )
    return rows, columns


def resampled(data: HeightMap, shape: tuple[int, int]) -> HeightMap:
    """The map on another grid over the same extent, bilinearly; missing where a pixel next to it is."""
    heights = data.heights.astype(np.float64)
    for axis in range(2):
        heights = _along(heights, axis, shape[axis])
    spacing = (data.extent[0] / (shape[1] - 1), data.extent[1] / (shape[0] - 1))
    return HeightMap(
        heights.astype(data.heights.dtype), spacing, data.unit, origin=data.origin, provenance=data.provenance
    )


def _along(heights: np.ndarray, axis: int, count: int) -> np.ndarray:
    """Linear interpolation along one axis."""
    last = heights.shape[axis] - 1
    places = np.linspace(0, last, count)
    below = np.minimum(places.astype(np.int64), last - 1)
    part = np.expand_dims(places - below, 1 - axis)
    first, second = heights.take(below, axis=axis), heights.take(below + 1, axis=axis)
    # A pixel of weight zero does not count, missing or not.
    return np.where(part == 0, first, np.where(part == 1, second, (1 - part) * first + part * second))
