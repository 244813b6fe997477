"""`compress`: a height map as few bytes, every valid pixel within a bound; whichever way is smallest.

Three ways are known: predicted pixels (`grid`), a T-spline with rounded control points and, where these do not pay,
corrections of single pixels (`model`), and every bit (`lossless`). Each candidate is decoded again, and kept only if
every valid pixel is within the bound after rounding to the written dtype.
"""

from collections.abc import Iterator
from typing import Any, Literal

import numpy as np
from numpy.typing import DTypeLike

from .._errors import InputError
from ..data import HeightMap, as_data, parse_length
from ._candidates import (
    Task,
    corrected_models,
    grid_file,
    largest_error,
    lossless_file,
    pays,
    pure_models,
)

Choice = Literal["smallest", "grid", "model", "lossless"]
_CHOICES = ("smallest", "grid", "model", "lossless")


def compress(
    data: Any,
    *,
    max_error: float | str | None = None,
    relative_max_error: float | None = None,
    dtype: DTypeLike | None = None,
    mode: Choice = "smallest",
) -> bytes:
    """Compress a height map so that every valid pixel comes back within a bound.

    The bytes are a `.tspl` file: write them, and `decompress` or `load` (for the T-spline) reads them. Missing pixels
    stay missing, and spacing, unit, origin and provenance are kept.

    **Arguments:**

    - `data`: a `HeightMap` or plain arrays (see `as_data`).
    - `max_error`: the bound, in the map's unit or with one: `"5nm"`. Zero keeps every bit.
    - `relative_max_error`: the same as a share of the range (max - min) of the valid pixels. Give one of the two.
    - `dtype`: `"float32"` or `"float64"` of the heights that come back; by default the map's. The bound holds after
      rounding to it.
    - `mode`: `"smallest"` keeps what takes fewest bytes; `"model"` insists on a T-spline, so that the file can be
      opened as one; `"grid"` leaves the fit out, which takes most of the time; `"lossless"` keeps every bit.

    **Returns:** the file's bytes.

    **Raises:** `InputError` for a point cloud, a map without valid pixels, a bound that is negative or that the dtype
    cannot keep, where a T-spline is insisted on but the bound is too tight for one, and where a fit is due but JAX's
    x64 mode is off.

    >>> x, y = np.meshgrid(np.linspace(0, 1, 60), np.linspace(0, 1, 50))
    >>> heights = np.exp(-50 * ((x - 0.5) ** 2 + (y - 0.4) ** 2))
    >>> content = compress(heights, max_error=1e-3, mode="grid")
    >>> from tsplinejax.codec import decompress
    >>> len(content) < 1000, bool(abs(decompress(content).heights - heights).max() <= 1e-3)
    (True, True)

    Predictions are those of Zhao et al., "Optimizing error-bounded lossy compression for scientific data by dynamic
    spline interpolation", ICDE 2021, in two directions at once and with weights of the map's own.
    """
    if mode not in _CHOICES:
        raise InputError(f"mode is one of {', '.join(_CHOICES)}, but got {mode!r}")
    task = _task(data, max_error, relative_max_error, dtype)
    best = min((content for content in _candidates(task, mode) if content is not None), key=len, default=None)
    if best is None:
        raise InputError(
            f"no {mode} file keeps the bound {task.bound:.4g} in {task.dtype}; use mode='smallest', a larger bound or "
            "another dtype"
        )
    return best


def _task(data: Any, max_error: float | str | None, relative_max_error: float | None, dtype: DTypeLike | None) -> Task:
    """The map and the bound, checked."""
    surface = as_data(data)
    if not isinstance(surface, HeightMap):
        raise InputError("height maps are compressed, but got a point cloud; fit it and save the model instead")
    valid = surface.valid
    if not valid.any():
        raise InputError(f"every one of the {valid.size} heights is missing (NaN): there is nothing to compress")
    bound = _bound(surface, max_error, relative_max_error)
    written = _written_dtype(dtype, surface.heights.dtype)
    with np.errstate(over="ignore"):
        heights = surface.heights.astype(written)
    largest = float(np.abs(heights[valid]).max())
    if not np.isfinite(largest) or largest_error(heights, surface.heights) > bound:
        raise InputError(
            f"heights cannot be written as {written} within a bound of {bound:.4g}: rounding alone exceeds it; use "
            "dtype='float64' or a larger bound"
        )
    # Rounding to the dtype, and evaluation that differs in its last digits from machine to machine.
    slack = float(np.spacing(written.type(largest))) + 64 * float(np.spacing(largest))
    return Task(surface, written, ~valid, bound, bound - slack)


def _bound(data: HeightMap, max_error: float | str | None, relative_max_error: float | None) -> float:
    """The bound in the map's unit."""
    if (max_error is None) == (relative_max_error is None):
        raise InputError("give either max_error or relative_max_error: the bound that every pixel keeps")
    bound = 0.0 if relative_max_error is None else float(relative_max_error) * data.range
    if max_error is not None:
        bound = parse_length(max_error, data.unit)
    if not np.isfinite(bound) or bound < 0:
        raise InputError(f"a bound is finite and at least zero, but got {bound!r}; zero keeps every bit")
    return bound


def _written_dtype(dtype: DTypeLike | None, own: np.dtype) -> np.dtype:
    """float32 or float64."""
    try:
        written = np.dtype(own if dtype is None else dtype)
    except TypeError as error:
        raise InputError(f"heights are written as float32 or float64, but got {dtype!r}") from error
    if written not in (np.dtype(np.float32), np.dtype(np.float64)):
        raise InputError(f"heights are written as float32 or float64, but got {written}; pass dtype='float64'")
    return written


def _candidates(task: Task, mode: Choice) -> Iterator[bytes | None]:
    """Files of the modes asked for; `None` for those that do not keep the bound."""
    if mode == "lossless" or not task.lossy:
        if mode in ("smallest", "lossless"):
            yield lossless_file(task)
        return
    if mode == "model":
        yield from _first(pure_models(task))
        return
    grid = grid_file(task)
    yield grid
    if mode == "smallest":
        yield lossless_file(task)
        if grid is not None and task.smooth and pays(task, grid):
            yield from corrected_models(task, grid)


def _first(contents: Iterator[bytes | None]) -> Iterator[bytes]:
    """The first file that keeps the bound."""
    for content in contents:
        if content is not None:
            yield content
            return
