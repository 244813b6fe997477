"""`compress`: a height map as few bytes, every valid pixel within a bound; whichever way is smallest.

Three ways are known: predicted pixels (`grid`), a T-spline with rounded control points and, where these do not pay,
corrections of single pixels (`model`), and every bit (`lossless`). Each candidate is decoded again, and kept only if
every valid pixel is within the bound after rounding to the written dtype.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import DTypeLike

from .._errors import InputError
from .._version import __version__
from ..data import HeightMap, as_data, parse_length
from ._compressed import most_pixels
from ._decompress import decode
from ._entropy import Encoder
from ._grid import MOST_UNITS, UNITS, HeightCoder
from ._lossless import encode_exactly
from ._mask import code_mask
from ._plain import plain
from ._sections import sealed

Choice = Literal["smallest", "grid", "model", "lossless"]
_CHOICES = ("smallest", "grid", "model", "lossless")


@dataclass(frozen=True, eq=False)
class Task:
    """What is compressed.

    **Attributes:**

    - `data`: the map; `heights`: its heights in the dtype that is written; `missing`: where they are NaN.
    - `bound`: largest error of a valid pixel, in the map's unit.
    - `inner`: the bound less what rounding to the dtype and different machines may add; not above zero where these
      leave nothing.
    """

    data: HeightMap
    heights: Float[np.ndarray, "rows columns"]
    missing: Bool[np.ndarray, "rows columns"]
    bound: float
    inner: float


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
    cannot keep, and where a T-spline is insisted on but the bound is too tight for one.

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
    best: bytes | None = None
    for content in _candidates(task, mode):
        if (best is None or len(content) < len(best)) and _keeps_bound(task, content):
            best = content
    if best is None:
        raise InputError(
            f"no {mode} file keeps the bound {task.bound:.4g} in {task.heights.dtype}; use mode='smallest', a larger "
            "bound or another dtype"
        )
    return best


def _task(
    data: Any, max_error: float | str | None, relative_max_error: float | None, dtype: DTypeLike | None
) -> Task:
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
    if not np.isfinite(largest) or _largest_error(heights, surface.heights) > bound:
        raise InputError(
            f"heights cannot be written as {written} within a bound of {bound:.4g}: rounding alone exceeds it; use "
            "dtype='float64' or a larger bound"
        )
    # Rounding to the dtype, and evaluation that differs in its last digits from machine to machine.
    slack = float(np.spacing(written.type(largest))) + 64 * float(np.spacing(largest))
    return Task(surface, heights, ~valid, bound, bound - slack)


def _bound(data: HeightMap, max_error: float | str | None, relative_max_error: float | None) -> float:
    """The bound in the map's unit."""
    if (max_error is None) == (relative_max_error is None):
        raise InputError("give either max_error or relative_max_error: the bound that every pixel keeps")
    if max_error is not None:
        bound = parse_length(max_error, data.unit)
    else:
        bound = float(relative_max_error) * data.range  # type: ignore[arg-type]
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


def _candidates(task: Task, mode: Choice) -> Iterator[bytes]:
    """Files that may keep the bound, the last resort last."""
    span = float(np.ptp(task.heights[~task.missing].astype(np.float64)))
    fits = task.inner > 0 and span / task.inner * UNITS < MOST_UNITS
    if fits and mode in ("smallest", "grid"):
        yield _grid_file(task)
    if mode in ("smallest", "lossless"):
        yield _lossless_file(task)


def _grid_file(task: Task) -> bytes:
    """Predicted pixels."""
    filled = filled_in(task)
    offset, step = _middle(filled), 2 * task.inner
    coder = Encoder()
    if task.missing.any():
        code_mask(coder, task.missing.shape, task.missing)
    HeightCoder(coder, task.missing, (filled - offset) / (step / UNITS)).run()
    return _file(task, "grid", list(coder.finish()), offset=offset, step=step)


def _lossless_file(task: Task) -> bytes:
    """Every bit."""
    coder = Encoder()
    if task.missing.any():
        code_mask(coder, task.missing.shape, task.missing)
    return _file(task, "lossless", [*coder.finish(), encode_exactly(task.heights, task.missing)])


def _middle(heights: np.ndarray) -> float:
    """A height that differences are small to."""
    return float(heights.min()) / 2 + float(heights.max()) / 2


def filled_in(task: Task) -> Float[np.ndarray, "rows columns"]:
    """The given heights in float64, each missing one replaced by that of the nearest valid pixel."""
    heights = task.data.heights.astype(np.float64)
    if not task.missing.any():
        return heights
    from scipy.ndimage import distance_transform_edt

    nearest: Any = distance_transform_edt(task.missing, return_distances=False, return_indices=True)
    return heights[tuple(nearest)]


def _file(
    task: Task, mode: str, sections: list[bytes], *, offset: float = 0.0, step: float = 0.0, model: Any = None
) -> bytes:
    """The whole file; its largest error is measured on what it decodes to."""
    data = task.data
    header = {
        "software": f"tsplinejax {__version__}",
        "provenance": plain(data.provenance),
        "unit": data.unit,
        "origin": list(data.origin),
        "spacing": list(data.spacing),
        "missing": int(np.count_nonzero(task.missing)),
        "dtype": str(task.heights.dtype),
        "shape": list(data.shape),
        "tolerance": task.bound,
        "max_error": 0.0,
        "offset": offset,
        "step": step,
        "mode": mode,
        "model": model,
    }
    draft = sealed(header, sections)
    if task.heights.size > most_pixels(len(draft)):
        return draft  # refused when it is checked
    error = _largest_error(decode(draft)[1], data.heights)
    return sealed({**header, "max_error": float(np.format_float_scientific(error, 6))}, sections)


def _keeps_bound(task: Task, content: bytes) -> bool:
    """Whether a file comes back with every valid pixel within the bound, and the missing ones missing."""
    try:
        _, heights = decode(content)
    except InputError:  # of more pixels than its bytes may declare
        return False
    return np.array_equal(np.isnan(heights), task.missing) and _largest_error(heights, task.data.heights) <= task.bound


def _largest_error(heights: np.ndarray, given: np.ndarray) -> float:
    """Largest difference of the valid pixels, rounded up."""
    differences = np.abs(heights.astype(np.float64) - given.astype(np.float64))
    worst = float(np.nanmax(differences))
    return worst if worst == 0 else float(np.nextafter(worst, np.inf))
