"""Many height maps over one spline space, which share one factorisation.

The control points of map V solve (Bᵀ B + λ K) P = Bᵀ V, where row j of B holds the blending functions at pixel j, of
which sixteen are not zero. The matrix depends on the places of the pixels alone, so it is factorised once (sparse, on
the host), and each further map is one more right-hand side. Maps with other missing pixels have another B: maps are
grouped by equal masks, and each group has its own factorisation.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import ArrayLike, Float, Int

from .._errors import InputError
from ..data import Frame, HeightMap, as_data
from ..data._arrays import frozen
from ..space import SplineSpace
from ..surface import TSpline, make_surface
from ._design import Design, Factor, energy_matrix, factorise
from ._energy import default_smoothing

MAPS_AT_A_TIME = 64
PIXELS_A_COPY = 512  # of all maps of a chunk: what is written stays in the cache until its lines are full


@dataclass(frozen=True, eq=False, repr=False)
class SharedFit:
    """Many height maps fitted over one space; lengths are in the maps' unit.

    **Attributes:**

    - `space`, `frame`: what the surfaces share.
    - `control_points`: one row a map, (k, n).
    - `max_errors`, `rms_errors`: largest and root-mean-square error at the valid pixels of each map, (k,).
    - `smoothing`: the weight λ of the bending energy.
    - `factorisations`: how many were needed: one for each mask of missing pixels.
    - `seconds`: wall time.
    - `warnings`: what the user should know, in sentences.
    """

    space: SplineSpace
    frame: Frame
    control_points: Float[np.ndarray, "k n"]
    max_errors: Float[np.ndarray, " k"]
    rms_errors: Float[np.ndarray, " k"]
    smoothing: float
    factorisations: int
    seconds: float
    warnings: tuple[str, ...]

    def __len__(self) -> int:
        """Return the number of maps."""
        return len(self.control_points)

    def __repr__(self) -> str:
        unit = f" {self.frame.unit}" if self.frame.unit else ""
        return (
            f"SharedFit({len(self)} maps, {self.control_points.shape[1]} control points each, "
            f"largest error {self.max_errors.max():.4g}{unit}, factorisations: {self.factorisations})"
        )

    def surface(self, index: int) -> TSpline:
        """The surface of one map; a negative index counts from the end, as in a list."""
        return make_surface(self.space, self.control_points[index], self.frame)


def fit_shared(
    maps: Float[ArrayLike, "k rows columns"] | Sequence[Any],
    space: SplineSpace,
    *,
    smoothing: float | Literal["auto"] = "auto",
) -> SharedFit:
    """Fit many height maps over one space by least squares, with one factorisation for all.

    **Arguments:**

    - `maps`: k maps over the same pixels: an array (k, rows, columns), which may be mapped from a file, or a sequence
      of what `as_data` takes for a height map. NaN is missing; each other set of missing pixels costs a factorisation.
    - `space`: the spline space, for instance `tsj.fit(maps[0], tolerance=...).surface.space`.
    - `smoothing`: weight λ of the bending energy; `"auto"` is the trace that only fills gaps, as in `fit`. With 0 each
      row of control points is that of [`lstsq`][tsplinejax.lstsq].

    **Returns:** a [`SharedFit`][tsplinejax.SharedFit].

    **Raises:** `InputError` for maps of differing shape, place or unit, infinite heights, a map without a valid pixel,
    and pixels that do not determine the control points.

    >>> import tsplinejax as tsj
    >>> y, x = np.mgrid[0:30, 0:40] / 20
    >>> maps = np.stack([np.sin(x + phase) * y for phase in range(5)])
    >>> tsj.fit_shared(maps, tsj.spline_space(tsj.b_lattice(8, 6))).control_points.shape
    (5, 99)
    """
    started = time.perf_counter()
    stack = _read_stack(maps)
    rows, columns = stack.shape
    groups = _equal_masks(stack)
    weight = _smoothing_weight(smoothing, stack.shape[0] * stack.shape[1])
    energy = energy_matrix(space, stack.frame) if weight > 0 else None
    points = np.empty((len(stack), int(space.n_functions)))
    largest, rms = np.empty(len(stack)), np.empty(len(stack))
    for mask, members in groups:
        pixels = np.flatnonzero(~mask)
        places = np.stack([pixels % columns / (columns - 1), pixels // columns / (rows - 1)], axis=1)
        design = Design(space, places)
        factor = factorise(design, energy, weight, _named(members))
        for first in range(0, len(members), MAPS_AT_A_TIME):
            chosen = members[first : first + MAPS_AT_A_TIME]
            points[chosen], largest[chosen], rms[chosen] = _solve(stack, chosen, pixels, design, factor)
    return SharedFit(
        space=space,
        frame=stack.frame,
        control_points=frozen(points.astype(space.dtype)),
        max_errors=frozen(largest),
        rms_errors=frozen(rms),
        smoothing=weight,
        factorisations=len(groups),
        seconds=time.perf_counter() - started,
        warnings=_warnings(len(stack), len(groups)),
    )


@dataclass(frozen=True, eq=False)
class _Stack:
    """Maps over the same pixels: an array, or a list of arrays, and their place."""

    heights: np.ndarray | list[np.ndarray]
    shape: tuple[int, int]
    frame: Frame

    def __len__(self) -> int:
        return len(self.heights)

    def pixels(self, chosen: Int[np.ndarray, " c"], pixels: Int[np.ndarray, " m"]) -> Float[np.ndarray, "m c"]:
        """Some pixels of some maps, one column a map."""
        values = np.empty((len(pixels), len(chosen)))
        gapless = pixels[-1] - pixels[0] + 1 == len(pixels)
        taken = slice(pixels[0], pixels[-1] + 1) if gapless else pixels
        rows = [np.asarray(self.heights[index]).ravel()[taken] for index in chosen]
        for first in range(0, len(pixels), PIXELS_A_COPY):
            part = slice(first, first + PIXELS_A_COPY)
            for column, row in enumerate(rows):
                values[part, column] = row[part]
        return values


def _read_stack(maps: object) -> _Stack:
    """The maps as a stack, checked for what can be told without looking at the heights."""
    if isinstance(maps, np.ndarray) and not isinstance(maps, np.ma.MaskedArray) and maps.ndim == 3:
        if maps.dtype.kind not in "iuf" or not maps.size:
            raise InputError(f"maps (k, rows, columns) hold real numbers; received {maps.dtype} of shape {maps.shape}")
        rows, columns = maps.shape[1:]
        return _Stack(maps, (rows, columns), HeightMap(np.zeros((rows, columns))).frame)
    if isinstance(maps, HeightMap) or not hasattr(maps, "__iter__"):
        raise InputError(f"fit_shared takes a sequence of maps; received {type(maps).__name__}; put it in a list")
    listed = [_height_map(index, item) for index, item in enumerate(maps)]  # type: ignore[arg-type]
    if not listed:
        raise InputError("fit_shared needs at least one map; received none")
    first = listed[0]
    for index, item in enumerate(listed):
        if (item.shape, item.frame) != (first.shape, first.frame):
            raise InputError(
                "maps that share a space lie over the same pixels, in one unit; received "
                f"{first.shape} in {first.frame} and, as item {index}, {item.shape} in {item.frame}; use fit_batch"
            )
    return _Stack([item.heights for item in listed], first.shape, first.frame)


def _height_map(index: int, item: object) -> HeightMap:
    """An item of the sequence as a height map."""
    data = as_data(item)
    if not isinstance(data, HeightMap):
        raise InputError(f"fit_shared takes height maps; received, as item {index}, a point cloud; use fit_batch")
    return data


def _equal_masks(stack: _Stack) -> list[tuple[np.ndarray, Int[np.ndarray, " members"]]]:
    """Masks of missing pixels (flat), each with the maps that have it, in the order in which they come."""
    groups: dict[bytes, list[int]] = {}
    for index in range(len(stack)):
        heights = np.asarray(stack.heights[index])
        missing = np.isnan(heights)
        if np.isinf(heights).any():
            raise InputError(f"heights must be finite or NaN (missing), but map {index} holds infinite ones")
        if missing.all():
            raise InputError(f"every height of map {index} is missing (NaN): there is nothing to fit; leave it out")
        groups.setdefault(np.packbits(missing).tobytes(), []).append(index)
    size = stack.shape[0] * stack.shape[1]
    masks = (np.unpackbits(np.frombuffer(key, np.uint8), count=size).astype(bool) for key in groups)
    return [(mask, np.asarray(members)) for mask, members in zip(masks, groups.values(), strict=True)]


def _smoothing_weight(smoothing: float | str, n_samples: int) -> float:
    """λ as a number."""
    if isinstance(smoothing, str):
        if smoothing != "auto":
            raise InputError(f"smoothing is 'auto' or a number λ of at least zero; received {smoothing!r}")
        return default_smoothing(n_samples)
    weight = float(smoothing)
    if not np.isfinite(weight) or weight < 0:
        raise InputError(f"smoothing λ is finite and at least zero; received {smoothing!r}; try 'auto'")
    return weight


def _named(members: np.ndarray) -> str:
    shown = ", ".join(map(str, members[:3]))
    return f"map {shown}" if len(members) == 1 else f"maps {shown}{', ...' if len(members) > 3 else ''}"


def _warnings(maps: int, groups: int) -> tuple[str, ...]:
    """Say so where masks differ: it costs the time that sharing saves."""
    if groups == 1:
        return ()
    return (
        f"the {maps} maps have {groups} different masks of missing pixels; maps share a factorisation only where the "
        f"same pixels are missing, so {groups} were made",
    )


def _solve(
    stack: _Stack, chosen: np.ndarray, pixels: np.ndarray, design: Design, factor: Factor
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Control points (c, n), largest and root-mean-square errors (c,) of some maps of one mask."""
    loads = np.zeros((int(design.space.n_functions), len(chosen)))
    for taken, band in design:
        loads += band.T @ stack.pixels(chosen, pixels[taken])
    points = factor.solve(loads)
    largest, squares = np.zeros(len(chosen)), np.zeros(len(chosen))
    for taken, band in design:
        residuals = band @ points
        residuals -= stack.pixels(chosen, pixels[taken])
        squares += np.einsum("mc,mc->c", residuals, residuals)
        np.maximum(largest, np.maximum(residuals.max(axis=0), -residuals.min(axis=0)), out=largest)
    return points.T, largest, np.sqrt(squares / len(pixels))
