"""`filter`: the smooth version of a height map, and what was taken off."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from .._errors import InputError
from .._version import __version__
from ..characterise._filters import checked_cutoff, require_scale
from ..data import HeightMap, PointCloud, as_data, estimate_noise, find_outliers, parse_length
from ..fitting import StopReason
from ..mesh import b_lattice
from ..space import resolve_dtype
from ..surface import TSpline
from ._edges import default_cutoff, keep_edges
from ._features import find_features
from ._filtered import Filtered
from ._lattice import gridded_surface
from ._linear import linear
from ._tolerance import resolved_tolerance, tolerance_warnings

Length = float | str

_NOISE_REACH = 5.0  # standard deviations: what noise does not exceed on maps of up to a few million pixels


def filter(
    data: Any,
    *,
    tolerance: Length | None = None,
    relative_tolerance: float | None = None,
    cutoff: Length | None = None,
    finest_spacing: Length | None = None,
    robust: bool = False,
    max_control_points: int | None = None,
    max_seconds: float | None = None,
) -> Filtered:
    """Filter a height map by a T-spline: by a cut-off, by a tolerance with edges kept, or both.

    - A *cut-off* λc makes a linear filter, a smoothing spline that lets 1 / (1 + (λc / λ)⁴) of a wave of length λ
      through, in every direction (ISO 16610-62): half at λc.
    - A *tolerance* ε makes a non-linear filter that keeps edges: what is lower than ε and short is taken off, steps
      higher than ε stay as steep as they were measured, and no residual exceeds ε. Waves count as short below a
      quarter of the map's shorter side.
    - *Both*: the linear filter of λc, except around what it would take off by more than ε / 2: there edges are kept,
      and no residual exceeds ε.
    - A *finest spacing* limits the elements of the mesh, with or without the others; waves shorter than twice as much
      do not pass. It has no sharp transmission: use a cut-off for that.
    - *None of them*: a tolerance of five standard deviations of the noise, estimated from the map.

    **Arguments:**

    - `data`: a height map (see `as_data`); for lengths along the surface its spacing must be known.
    - `tolerance`: ε, in the map's unit, or with one: `"50nm"`; `relative_tolerance`: the same as a share of the range.
    - `cutoff`: λc, from two pixels to the map's longer side.
    - `finest_spacing`: from one pixel to the map's longer side, and at most λc / 4.
    - `robust`: set isolated spikes aside first (`find_outliers`); the filtered map has no trace of them.
    - `max_control_points`, `max_seconds`: budgets of the refinement.

    **Returns:** a [`Filtered`][tsplinejax.Filtered]. That a tolerance is not met is said there, not raised.

    **Raises:** `InputError` for a point cloud, options that contradict each other or are out of range, and lengths on
    a map whose spacing is unknown.

    >>> step = np.where(np.arange(64) < 32, 0.0, 1.0) + 0.02 * np.random.default_rng(0).normal(size=(64, 64))
    >>> filtered = filter(step, tolerance=0.25)
    >>> filtered.max_error <= 0.25, filtered.sq_removed < 0.04
    (True, True)
    """
    started = time.perf_counter()
    task = _read(data, tolerance, relative_tolerance, cutoff, finest_spacing, robust)
    if task.tolerance is None:
        work = _linear(task)
    else:
        work = _edge_preserving(task, {"max_control_points": max_control_points, "max_seconds": max_seconds})
    return _filtered(task, work, time.perf_counter() - started)


@dataclass(frozen=True, eq=False)
class _Task:
    """What is asked, in the map's unit; `kept` is the map without outliers."""

    height_map: HeightMap
    kept: HeightMap
    outliers: Bool[np.ndarray, "rows columns"]
    tolerance: float | None
    cutoff: float | None
    finest_spacing: float | None
    dtype: np.dtype
    warnings: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Work:
    """What either way of filtering comes to."""

    heights: Float[np.ndarray, "rows columns"]
    surface: Callable[[], TSpline]
    control_points: int
    edge_share: float = 0.0
    stop: StopReason | None = None
    warnings: tuple[str, ...] = ()


def _read(
    data: Any,
    tolerance: Length | None,
    relative_tolerance: float | None,
    cutoff: Length | None,
    finest_spacing: Length | None,
    robust: bool,
) -> _Task:
    """Check a caller's wishes against the map."""
    height_map = as_data(data)
    if isinstance(height_map, PointCloud):
        raise InputError(
            "a filter works on a height map, but got a point cloud; take its texture_map (remove_form), or fit it"
        )
    if tolerance is not None and relative_tolerance is not None:
        raise InputError("give at most one of tolerance and relative_tolerance; both were given")
    dtype = resolve_dtype(height_map.heights.dtype)
    if not height_map.valid.any():
        raise InputError(f"every one of the {height_map.heights.size} heights is missing (NaN); nothing to filter")
    length = None if cutoff is None else checked_cutoff(height_map, cutoff, "cut-off")[1]
    finest = None if finest_spacing is None else _checked_spacing(height_map, finest_spacing, length)
    outliers = find_outliers(height_map) if robust else np.zeros(height_map.shape, bool)
    kept = height_map.with_heights(np.where(outliers, np.nan, height_map.heights)) if outliers.any() else height_map
    plain = cutoff is None and finest_spacing is None
    limit, warnings = _limit(kept, tolerance, relative_tolerance, plain)
    return _Task(height_map, kept, outliers, limit, length, finest, dtype, warnings)


def _checked_spacing(height_map: HeightMap, spacing: Length, cutoff: float | None) -> float:
    """The finest spacing as a number."""
    require_scale(height_map, "a spacing")
    length, unit = parse_length(spacing, height_map.unit), height_map.unit or ""
    finest, longest = min(height_map.spacing), max(height_map.extent)
    if not finest <= length <= longest:
        raise InputError(
            f"a finest spacing lies between a pixel and the map's longer side, {finest:g} to {longest:g} {unit}; "
            f"received {length:g} {unit}".rstrip()
        )
    if cutoff is not None and length > cutoff / 4:
        raise InputError(
            f"a cut-off needs elements of a quarter of it at most, but the finest spacing {length:g} is more than "
            f"{cutoff / 4:g} {unit}; leave one of the two out".replace("  ", " ")
        )
    return length


def _limit(
    kept: HeightMap, tolerance: Length | None, relative_tolerance: float | None, plain: bool
) -> tuple[float | None, tuple[str, ...]]:
    """The tolerance as a number, and what there is to say about it; `None` for a linear filter."""
    if tolerance is None and relative_tolerance is None:
        if not plain:
            return None, ()
        noise = estimate_noise(kept)
        if noise.sigma <= 0:
            raise InputError("this map shows no noise to take off; give a tolerance, a cutoff or a finest_spacing")
        return _NOISE_REACH * noise.sigma, (noise.note,) if noise.texture_limited else ()
    value = resolved_tolerance(kept, tolerance, relative_tolerance)
    return value, tolerance_warnings(kept, value, relative=tolerance is None, what="the filtered map")


def _linear(task: _Task) -> _Work:
    """Smooth over a uniform lattice."""
    work = linear(task.kept, task.cutoff, task.finest_spacing)

    def surface() -> TSpline:  # extraction over a fine lattice takes longer than the filter
        return gridded_surface(work.points, b_lattice(*work.lattice), task.height_map.frame, task.dtype)

    return _Work(work.heights, surface, work.points.size, warnings=work.warnings)


def _edge_preserving(task: _Task, options: dict[str, Any]) -> _Work:
    """Keep what the linear filter would take off by too much."""
    assert task.tolerance is not None
    cutoff = default_cutoff(task.kept) if task.cutoff is None else task.cutoff
    cutoff = cutoff if task.finest_spacing is None else max(cutoff, 4 * task.finest_spacing)
    before = linear(task.kept, cutoff, None)
    features = find_features(task.kept, task.kept.heights - before.heights, task.tolerance, cutoff)
    work = keep_edges(task.kept, features, task.tolerance, cutoff, task.finest_spacing, options)
    heights = np.full(task.height_map.shape, np.nan)
    heights[task.kept.valid] = task.kept.heights[task.kept.valid] - work.residuals
    if task.outliers.any():
        heights = np.where(task.outliers, _at_pixels(work.surface, task.height_map, task.outliers), heights)
    points = len(work.surface.control_points)
    return _Work(heights, lambda: work.surface, points, work.edge_share, work.stop, before.warnings)


def _at_pixels(
    surface: TSpline, height_map: HeightMap, chosen: Bool[np.ndarray, "rows columns"]
) -> Float[np.ndarray, "rows columns"]:
    """The surface at the chosen pixels, NaN at others."""
    rows, columns = height_map.shape
    row, column = np.nonzero(chosen)
    heights = np.full(height_map.shape, np.nan)
    heights[chosen] = surface(np.stack([column / (columns - 1), row / (rows - 1)], axis=1))
    return heights


def _filtered(task: _Task, work: _Work, seconds: float) -> Filtered:
    """The result, in the map's own precision."""
    height_map, unit = task.height_map, task.height_map.unit
    valid, heights = height_map.valid, height_map.heights
    smooth = np.where(valid, work.heights, np.nan)
    operation = _operation(task)
    rest = (heights - smooth)[valid & ~task.outliers]
    centred = rest - rest.mean()
    largest = float(np.abs(rest).max())
    converged = task.tolerance is None or largest <= task.tolerance * (1 + 1e-9)
    warnings = [*task.warnings, *work.warnings]
    if not converged:
        assert work.stop is not None
        warnings.append(
            f"the tolerance is not met ({work.stop}: {work.stop.message}); the largest residual is {largest:.4g}"
        )
    filtered = height_map.derived(smooth, operation)
    return Filtered(
        filtered=filtered,
        residual=height_map.derived(heights - smooth, f"residual of {operation}"),
        cutoff=task.cutoff,
        tolerance=task.tolerance,
        finest_spacing=task.finest_spacing,
        sq_removed=float(np.sqrt(np.mean(centred**2))),
        sa_removed=float(np.mean(np.abs(centred))),
        max_error=largest,
        rms_error=float(np.sqrt(np.mean(rest**2))),
        range=task.kept.range,
        edge_share=work.edge_share,
        outliers=int(np.count_nonzero(task.outliers)),
        control_points=work.control_points,
        stop=work.stop,
        converged=converged,
        unit=unit,
        seconds=seconds,
        warnings=tuple(warnings),
        operations=tuple(filtered.provenance["operations"]),
        provenance={"software": f"tsplinejax {__version__}", "input": dict(height_map.provenance)},
        _make_surface=work.surface,
    )


def _operation(task: _Task) -> str:
    """The filter in a line."""
    unit = f" {task.height_map.unit}" if task.height_map.unit else ""
    named = (("cut-off", task.cutoff), ("tolerance", task.tolerance), ("finest spacing", task.finest_spacing))
    limits = ", ".join(f"{name} {value:g}{unit}" for name, value in named if value is not None)
    kind = "smoothing T-spline" if task.tolerance is None else "edge-preserving T-spline"
    return f"filter {kind}, {limits}"
