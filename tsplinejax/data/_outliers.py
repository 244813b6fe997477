"""Outliers: samples, alone or in small clusters, that stand off everything around them.

The idea, after rank-ordered differences (Garnett et al., IEEE Trans. Image Process. 14, 2005) but for clusters: sort
the heights of a neighbourhood (7 × 7 pixels, or the 32 nearest points). Where a sample belongs to a small upper group,
at most a third of the neighbourhood and at most sixteen, and the gap between that group and the rest exceeds
`contrast` times the spread of the rest, it is a candidate. Steps, rims, ridges and peaks spread the rest as much as
they lift the sample, so there the gap is smaller than the spread; noise of standard deviation σ spreads 49 heights by
some 4 σ. Lower groups are upper groups of the negated heights.

A candidate cluster counts only when it is isolated: no neighbour outside it lies in its half of the gap (the
end of a wall is not a spike). Beside missing samples, what is left of a pillar looks like a spike, so there the gap
must also exceed the steps between the map's other neighbours.

No fit takes part, so nothing depends on how closely a coarse surface follows the data. What cannot be told apart: a
real feature of at most sixteen pixels with vertical walls (dust) and a cluster of bad pixels.
"""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from .._errors import InputError
from ._as_data import as_data
from ._height_map import HeightMap
from ._neighbourhood import Gap, pixel_half_widths, pixel_neighbourhoods, top_hat, upper_gap
from ._rounding import height_step
from ._samples import Samples

_CONTRAST = 2.0
_CHUNK = 1 << 16
_NEAREST = 32
_SHARE = 0.34
_FEW = 16
_ENOUGH = 36
_WIDER = (4, 6)
_SPARSE = 0.25
_STRAY = 20.0
_LARGEST_CLUSTER = 16
_LONGEST_EDGE = 30


def find_outliers(data: Any, *, contrast: float = _CONTRAST, as_surface: bool = False) -> Bool[np.ndarray, "..."]:
    """Find isolated samples, alone or in clusters of at most sixteen, far from all their neighbours.

    **Arguments:**

    - `data`: a `HeightMap`, a `PointCloud`, `Samples`, or what `as_data` accepts.
    - `contrast`: how many times the spread of its neighbourhood an outlier stands off it; scale-free.
    - `as_surface`: judge a point cloud by its distance off the tangent plane in space, not by z over (x, y); samples
      of points in space are always judged so.

    **Returns:** booleans, true for outliers: (rows, columns) for a height map, where missing pixels are false; (m,)
    for clouds and samples.

    **Raises:** `InputError` if `contrast` is not positive.

    >>> heights = np.add.outer(np.arange(20.0), np.arange(30.0))
    >>> heights[7, 9] = 1000.0
    >>> np.argwhere(find_outliers(heights))
    array([[7, 9]])
    """
    if not contrast > 0:
        raise InputError(f"contrast must be positive, but got {contrast}; {_CONTRAST:g} is the default")
    data = data if isinstance(data, Samples) else as_data(data)
    if isinstance(data, HeightMap):
        return _of_grid(data.heights, contrast)
    if not isinstance(data, Samples):
        data = data.samples(as_surface=as_surface)
    if data.dimension == 3:
        return _of_space(data.values, contrast)
    if data.grid_shape is None or data.grid_index is None:
        return _of_scattered(data.frame.xy_of(data.parameters), data.values[:, 0], contrast)
    return _of_grid(data.scatter(data.values[:, 0]), contrast).ravel()[data.grid_index]


def _of_grid(heights: Float[np.ndarray, "rows cols"], contrast: float) -> Bool[np.ndarray, "rows cols"]:
    """Outliers of a grid; one so sparse that windows are empty is judged as scattered points."""
    valid = np.isfinite(heights)
    result = np.zeros(heights.shape, bool)
    if valid.mean() < _SPARSE:
        result[valid] = _of_scattered(np.argwhere(valid).astype(float), heights[valid], contrast)
        return result
    floor = _floor(heights[valid])
    upper = _candidates(heights, valid, floor, contrast)
    lower = _candidates(-heights, valid, floor, contrast)
    ordinary = _ordinary_step(heights) if len(upper[0]) + len(lower[0]) else 0.0
    result.flat[_isolated(heights, *upper, ordinary)] = True
    result.flat[_isolated(-heights, *lower, ordinary)] = True
    return result


def _floor(values: np.ndarray) -> float:
    """The least spread to measure against: the step of rounded heights, or the rounding of the number format."""
    ulp = 8.0 * float(np.finfo(values.dtype).eps) * float(np.abs(values).max(initial=0.0))
    return max(ulp, height_step(values), float(np.finfo(np.float32).tiny))


def _candidates(heights: np.ndarray, valid: np.ndarray, floor: float, contrast: float) -> tuple[np.ndarray, Gap]:
    """Flat indices of pixels that stand above a gap: a cheap morphological screen, then the sorted neighbourhoods."""
    half = pixel_half_widths(heights.shape)
    pixels = np.flatnonzero(_screen(heights, valid, contrast * floor)) if half[0] == half[1] else np.flatnonzero(valid)
    gap, count = _gaps(heights, pixels, half, floor)
    for wider in _WIDER:
        # At a border or beside a hole a window of seven pixels holds too few for a cluster to be the smaller part.
        thin = np.flatnonzero(count < _ENOUGH)
        if half[0] == half[1] and len(thin):
            better, count[thin] = _gaps(heights, pixels[thin], (wider, wider), floor)
            for field, value in zip(gap, better, strict=True):
                field[thin] = value
    lonely = np.flatnonzero(count < _FEW)
    if len(lonely):
        for field, better in zip(gap, _lonely_gaps(heights, valid, pixels[lonely], floor), strict=True):
            field[lonely] = better
    strong = gap.contrast > contrast
    return pixels[strong], Gap(*(field[strong] for field in gap))


def _gaps(
    heights: np.ndarray, pixels: Int[np.ndarray, " m"], half: tuple[int, int], floor: float
) -> tuple[Gap, Int[np.ndarray, " m"]]:
    """The gap below each pixel in the window around it, and how many of the window's pixels are valid."""
    padded = np.pad(heights, ((half[0],) * 2, (half[1],) * 2), constant_values=np.nan)
    result, counts = np.zeros((3, len(pixels))), np.zeros(len(pixels), int)
    for start in range(0, len(pixels), _CHUNK):
        part = slice(start, start + _CHUNK)
        around = pixel_neighbourhoods(padded, np.stack(np.unravel_index(pixels[part], heights.shape)), half)
        result[:, part] = upper_gap(around, heights.flat[pixels[part]], floor, share=_SHARE)
        counts[part] = np.count_nonzero(np.isfinite(around), axis=1)
    return Gap(*result), counts


def _lonely_gaps(heights: np.ndarray, valid: np.ndarray, pixels: Int[np.ndarray, " m"], floor: float) -> Gap:
    """The gap below pixels in nearly empty windows, among the nearest valid pixels (of very many, a part) anywhere."""
    from scipy.spatial import cKDTree  # pyright: ignore[reportAttributeAccessIssue] -- compiled, without annotations

    others = np.flatnonzero(valid)
    others = others[:: max(1, len(others) // 500_000)]
    tree = cKDTree(np.stack(np.unravel_index(others, heights.shape), axis=1))
    places = np.stack(np.unravel_index(pixels, heights.shape), axis=1)
    nearest = others[tree.query(places, np.arange(1, min(48, len(others)) + 1))[1]]
    values = heights.flat[pixels]
    return upper_gap(np.column_stack([values, heights.flat[nearest]]), values, floor)


def _screen(heights: np.ndarray, valid: np.ndarray, least: float) -> Bool[np.ndarray, "rows cols"]:
    """Pixels that stand well above every 5 × 5 square around them, by the measure of most of the map."""
    hat = top_hat(heights, valid)
    part = hat[np.isfinite(hat)]
    part = part[:: max(1, len(part) // 200_000)]
    usual = np.quantile(part, 0.35) if len(part) else 0.0
    with np.errstate(invalid="ignore"):
        return hat > max(least, 4.0 * usual)


def _ordinary_step(heights: np.ndarray) -> float:
    """The largest step between neighbours that is common on the map (on an edge of thirty pixels).

    Judged after opening and closing by 7 × 7 squares, which no small cluster survives.
    """
    surface = heights
    for sign in (1, -1):
        with np.errstate(invalid="ignore"):
            surface = surface - sign * top_hat(sign * surface, np.isfinite(surface), width=7)
        surface = np.where(np.isfinite(surface), surface, np.nan)
    steps = np.concatenate([np.abs(np.diff(surface, axis=axis)).ravel() for axis in (0, 1)])
    steps = steps[np.isfinite(steps)]
    rank = min(_LONGEST_EDGE, len(steps) // 1000 + 1)
    return float(np.partition(steps, -rank)[-rank]) if len(steps) else 0.0


def _isolated(heights: np.ndarray, pixels: Int[np.ndarray, " m"], gap: Gap, ordinary: float) -> Int[np.ndarray, " n"]:
    """Those candidates whose whole cluster is small and cut off: no other neighbour lies in its half of the gap."""
    from scipy import ndimage

    member = np.zeros(heights.shape, bool)
    member.flat[pixels] = True
    labels = np.zeros(heights.shape, np.int32)
    ndimage.label(member, np.ones((3, 3)), output=labels)
    cluster, clusters = labels.flat[pixels] - 1, int(labels.max(initial=0))
    padded = np.pad(np.where(member, -np.inf, heights), 1, constant_values=np.nan)
    around = pixel_neighbourhoods(padded, np.stack(np.unravel_index(pixels, heights.shape)), (1, 1))
    with np.errstate(invalid="ignore"):
        attached = (around > (gap.level + gap.size / 2)[:, None]).any(axis=1)
    beside_missing = np.isnan(around).any(axis=1) & (gap.size < 1.5 * ordinary)
    bad = np.bincount(cluster, attached, clusters) > 0
    bad |= np.bincount(cluster, minlength=clusters) > _LARGEST_CLUSTER
    tall = np.bincount(cluster, gap.size > 1.5 * ordinary, clusters) > 0
    bad |= (np.bincount(cluster, beside_missing, clusters) > 0) & ~tall
    return pixels[~bad[cluster]]


def _of_scattered(places: Float[np.ndarray, "m 2"], heights: np.ndarray, contrast: float) -> Bool[np.ndarray, " m"]:
    """Outliers of scattered heights: the same gap, among the nearest points."""
    result = np.zeros(len(heights), bool)
    if len(heights) < 10:
        return result
    nearest, _ = _nearest(places)
    floor = _floor(heights)
    for start in range(0, len(heights), _CHUNK):
        rows = slice(start, start + _CHUNK)
        result[rows] = _apart(heights[nearest[rows]], floor, contrast)
    return result


def _nearest(points: np.ndarray) -> tuple[Int[np.ndarray, "m k"], Float[np.ndarray, " m"]]:
    """Indices of the nearest points, the point itself first, and the distance to more of them than a cluster has."""
    from scipy.spatial import cKDTree  # pyright: ignore[reportAttributeAccessIssue] -- compiled, without annotations

    spread = np.ptp(points, axis=0).max()
    tree = cKDTree(points / (spread if spread > 0 else 1.0))
    distances, nearest = tree.query(tree.data, k=min(_NEAREST, len(points)), workers=-1)
    # Among coincident points the tree may name another one first.
    nearest[:, 0] = np.arange(len(points))
    return nearest, distances[:, min(_LARGEST_CLUSTER + 1, distances.shape[1] - 1)]


def _apart(around: Float[np.ndarray, "m k"], floor: float, contrast: float) -> Bool[np.ndarray, " m"]:
    """Whether the first of each row stands, up or down, beyond a gap."""
    upper = upper_gap(around, around[:, 0], floor, share=0.15)
    lower = upper_gap(-around, -around[:, 0], floor, share=0.15)
    return np.maximum(upper.contrast, lower.contrast) > contrast


def _of_space(points: Float[np.ndarray, "m 3"], contrast: float) -> Bool[np.ndarray, " m"]:
    """Outliers of points in space: far from all others, or beyond a gap off the plane through the nearest others."""
    result = np.zeros(len(points), bool)
    if len(points) < 10:
        return result
    nearest, reach = _nearest(points)
    floor = _floor(points.ravel())
    for start in range(0, len(points), _CHUNK):
        around = points[nearest[start : start + _CHUNK]]
        # A stray among the others would tilt the plane: it is farther from its neighbours than they are from theirs.
        reaches = reach[nearest[start : start + _CHUNK, 1:]]
        usual = (reaches <= 2.0 * np.median(reaches, axis=1, keepdims=True))[:, :, None]
        centre = (usual * around[:, 1:]).sum(axis=1, keepdims=True) / usual.sum(axis=1, keepdims=True)
        others = usual * (around[:, 1:] - centre)
        normals = np.linalg.eigh(np.einsum("mki,mkj->mij", others, others))[1][:, :, 0]
        offsets = np.einsum("mki,mi->mk", around - around[:, :1], normals)
        result[start : start + _CHUNK] = _apart(offsets, floor, contrast)
    return result | (reach > _STRAY * np.median(reach))
