"""`mra`: a height map as a sum of bands in nested spaces.

With P_k the least-squares projection onto V_k and V_0 ⊂ V_1 ⊂ ... (Eq. 9 of the paper), the bands are P_0 z and
P_k (z - P_(k-1) z): each is fitted to what the coarser ones left (Fig. 8). As all projections are global, they are
orthogonal on the samples, so their mean squares add up. Where gaps leave control points undetermined, projections are
nearly exact only, and what a band still has of those before it is taken off.

A cubic spline over elements of size h takes on average half the energy of a wave of length 2 h, 0.95 of it at 2.5 h,
and 0.05 at 1.6 h: a band over h, with the one before over 2 h, holds waves of 2 h to 4 h, and from 2.5 h to 3.2 h
almost all of them.
"""

import time
from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .._errors import InputError
from .._version import __version__
from ..data import HeightMap, PointCloud, as_data
from ..filtration._tolerance import resolved_tolerance, tolerance_warnings
from ..mesh import TMesh
from ..space import resolve_dtype
from ..surface import TSpline, heights_on_grid, make_surface, transfer
from ._projection import AbstractProjection, LatticeProjection, MeshProjection
from ._result import Band, Multiresolution
from ._spaces import Level, Spaces, adaptive_spaces, first_lattice, uniform_spaces

Length = float | str

_ROUND_OFF = 1e-12


def mra(
    data: Any,
    *,
    levels: int | None = None,
    tolerance: Length | None = None,
    relative_tolerance: float | None = None,
    lattice: tuple[int, int] | None = None,
) -> Multiresolution:
    """Take a height map apart into bands from coarse to fine, which add up to a fitted surface.

    Without a tolerance the spaces are uniform lattices, each twice as fine as the one before: every band has its range
    of wavelengths. With a tolerance they are meshes refined where the surface needs it, for tolerances that fall by
    half from band to band: fine bands are then spent on fine features alone.

    **Arguments:**

    - `data`: a height map (see `as_data`); missing pixels do not count.
    - `levels`: how many bands; by default as many as leave elements of four pixels, or six with a tolerance.
    - `tolerance`: largest remainder at any pixel, in the map's unit, or with one: `"5nm"`; `relative_tolerance`: the
      same as a share of the range.
    - `lattice`: (M, N) elements of the first band; by default three along the shorter side.

    **Returns:** a [`Multiresolution`][tsplinejax.Multiresolution].

    **Raises:** `InputError` for a point cloud, for more levels than the pixels determine, and for other bad options.

    >>> x = np.linspace(0, 1, 97)
    >>> analysis = mra(np.sin(4 * np.pi * x) + 0.1 * np.sin(32 * np.pi * x) * np.ones((97, 1)), levels=4)
    >>> len(analysis), round(analysis.sq_fitted, 2), analysis.leak < 1e-8
    (4, 0.7, True)
    """
    started = time.perf_counter()
    height_map = _checked(data, levels, tolerance, relative_tolerance)
    dtype = resolve_dtype(height_map.heights.dtype)
    coarsest = first_lattice(height_map, lattice)
    if tolerance is None and relative_tolerance is None:
        spaces, limit = uniform_spaces(height_map, coarsest, levels), None
    else:
        limit = resolved_tolerance(height_map, tolerance, relative_tolerance)
        spaces = adaptive_spaces(height_map, coarsest, levels, limit)
        said = tolerance_warnings(height_map, limit, relative=tolerance is None, what="the finest band")
        spaces = replace(spaces, warnings=(*said, *spaces.warnings))
    bands, total = _projected(height_map, spaces, dtype)
    return _analysis(height_map, spaces, limit, bands, total, started)


def _checked(data: Any, levels: int | None, *tolerances: Length | None) -> HeightMap:
    """The data as a height map, and options that go together."""
    height_map = as_data(data)
    if isinstance(height_map, PointCloud):
        raise InputError("bands are of a height map, but got a point cloud; take its texture_map (remove_form)")
    if not height_map.valid.any():
        raise InputError(f"every one of the {height_map.heights.size} heights is missing (NaN); nothing to analyse")
    if levels is not None and (int(levels) != levels or levels < 1):
        raise InputError(f"levels is a whole number of bands, at least 1; received {levels!r}")
    if all(limit is not None for limit in tolerances):
        raise InputError("give at most one of tolerance and relative_tolerance; both were given")
    return height_map


def _projected(height_map: HeightMap, spaces: Spaces, dtype: np.dtype) -> tuple[list[TSpline], TSpline]:
    """The bands, and their sum in the finest space."""
    valid, shape, frame = height_map.valid, height_map.shape, height_map.frame
    centre = float(np.mean(height_map.heights, where=valid, dtype=np.float64))
    rest = height_map.heights.astype(np.float64) - centre
    bands: list[TSpline] = []
    parts, at_pixels = None, [np.ones(np.count_nonzero(valid))]  # the constant, and every band about the centre
    for level in spaces.levels:
        raw = _projection(height_map, level, dtype).of(rest)
        before = np.ones((len(raw.control_points), 1), dtype)
        if parts is not None:
            before = np.asarray(transfer(parts, level.tmesh).control_points)
        shares, factor = _orthogonalised(heights_on_grid(raw, shape)[valid], at_pixels, rest[valid])
        band = make_surface(raw.space, factor * (raw.control_points - before @ shares), frame)
        heights = heights_on_grid(band, shape)
        rest = rest - heights
        at_pixels.append(heights[valid].astype(np.float64))
        parts = replace(band, control_points=jnp.concatenate([before, band.control_points[:, None]], axis=1))
        bands.append(band if bands else make_surface(band.space, band.control_points + centre, frame))
    assert parts is not None
    total = centre * parts.control_points[:, 0] + parts.control_points[:, 1:].sum(axis=1)
    return bands, make_surface(parts.space, total, frame)


def _orthogonalised(
    band: Float[np.ndarray, " m"], before: list[Float[np.ndarray, " m"]], rest: Float[np.ndarray, " m"]
) -> tuple[Float[np.ndarray, " k"], float]:
    """How much of each part before it a band still has, and the factor for it without them that leaves nothing of it in
    the rest.
    """
    least = max(_ROUND_OFF**2 * float(band @ band), np.finfo(float).tiny)  # parts of mere round-off do not count
    shares = np.array([part @ band / max(part @ part, least) for part in before])
    band = band - shares @ before
    factor = band @ rest / max(band @ band, np.finfo(float).tiny)
    return shares, float(np.clip(factor, 0.5, 2.0))  # a band of mere round-off may have any


def _projection(height_map: HeightMap, level: Level, dtype: np.dtype) -> AbstractProjection:
    """The projection onto a space."""
    if level.lattice is not None and height_map.valid.all():
        return LatticeProjection(height_map, level, dtype)
    return MeshProjection(height_map, level, dtype)


def _analysis(
    height_map: HeightMap, spaces: Spaces, limit: float | None, surfaces: list[TSpline], total: TSpline, started: float
) -> Multiresolution:
    """The result, with its statistics."""
    kind = "uniform lattices" if limit is None else f"meshes refined to {limit:g} {height_map.unit or ''}".rstrip()
    operation = f"multi-resolution analysis, {len(surfaces)} bands over {kind}"
    heights = heights_on_grid(total, height_map.shape).astype(np.float64)
    fitted = height_map.derived(heights, operation)
    remainder = height_map.derived(height_map.heights - heights, operation)
    sizes = [_sizes(level.tmesh, height_map.extent) for level in spaces.levels]
    bands = []
    for k, surface in enumerate(surfaces):
        part = height_map.derived(heights_on_grid(surface, height_map.shape), f"{operation}: band {k}")
        longest = np.inf if k == 0 else 2 * sizes[k - 1][1]
        bands.append(Band(surface, part, sizes[k][0], 2 * sizes[k][0], longest, _sq(part)))
    rest = remainder.heights[remainder.valid].astype(np.float64)
    largest, stop = float(np.abs(rest).max()), spaces.stop
    converged = limit is None or largest <= limit * (1 + 1e-9)
    warnings = list(spaces.warnings)
    if limit is not None and not converged:
        assert stop is not None
        warnings.append(f"the tolerance is not met ({stop}: {stop.message}); the largest remainder is {largest:.4g}")
    return Multiresolution(
        bands=tuple(bands),
        surface=total,
        fitted=fitted,
        remainder=remainder,
        sq_fitted=_sq(fitted),
        sq_remainder=_sq(remainder),
        tolerance=limit,
        max_error=largest,
        rms_error=float(np.sqrt(np.mean(rest**2))),
        range=height_map.range,
        stop=stop if limit is not None else None,
        converged=converged,
        unit=height_map.unit,
        seconds=time.perf_counter() - started,
        warnings=tuple(warnings),
        operations=tuple(fitted.provenance["operations"]),
        provenance={"software": f"tsplinejax {__version__}", "input": dict(height_map.provenance)},
    )


def _sizes(tmesh: TMesh, extent: tuple[float, float]) -> tuple[float, float]:
    """Sides of squares as large as the smallest and as the largest element."""
    boxes = tmesh.element_boxes
    sides = np.sqrt(np.prod((boxes[:, 2:] - boxes[:, :2]) * extent, axis=1))
    return float(sides.min()), float(sides.max())


def _sq(height_map: HeightMap) -> float:
    """Root mean square of the valid heights about their mean."""
    return float(np.std(height_map.heights[height_map.valid].astype(np.float64)))
