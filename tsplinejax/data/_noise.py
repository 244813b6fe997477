"""How noisy are the data? An estimate from the data alone, and what it cannot tell.

Height maps: second differences in both directions at once, of pixels k apart, vanish on every sum f(x) + g(y) of
smooth shapes (and on edges along the axes) and keep a known share of the noise (after Immerkaer, CVIU 64, 1996).
Their size is taken from those blocks of the map that agree on the lowest value, so features elsewhere do not count.
White noise gives the same figure at k = 1, 2, 4, 8; noise correlated by a Gaussian or a moving average rises to a
plateau, which gives its width; texture that reaches down to the pixel rises without one. Then texture and noise
cannot be told apart, and the figure at k = 2 stands for both. Noise that grows with the slope is found by
regressing fourth differences, on which even narrow features leave little, on the slope.

Scattered points: distances from the plane of the twelve nearest neighbours.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ._as_data import as_data
from ._height_map import HeightMap
from ._point_cloud import PointCloud
from ._rounding import height_step
from ._samples import Samples

_BLOCK = 16
# Pixels that a quick estimate looks at, in bands of this many rows.
_ENOUGH, _BAND = 1 << 16, 32
_STRIDES = (1, 2, 4, 8)
_SMOOTH = 1e-4  # of the range: below it at every stride the map is taken to be smooth
_ALL = 0.7  # of the data's own deviation: above it there is nothing but "noise"
_MEDIAN = 0.6744897501960817  # median of |x| for a standard normal
_UNLIKE = 0.12  # scatter of the logarithms above which levels do not look like those of filtered white noise
_LONGEST = 2.2  # pixels; noise correlated over more is taken for texture
_NEAREST = 12
_PROBES = 20_000
_TEXTURE_NOTE = (
    "roughness reaches down to the pixel: texture and noise cannot be told apart, so the noise is an upper bound; "
    "give noise= or a tolerance if you know better"
)


@dataclass(frozen=True)
class NoiseEstimate:
    """What is known of the measurement noise; lengths of height are in the data's unit.

    **Attributes:**

    - `sigma`: standard deviation (on flat parts, where it grows with the slope).
    - `correlation_length`: standard deviation in pixels of the Gaussian whose smoothing of white noise would correlate
      it as much; 0 for white noise.
    - `quantisation`: the step to which heights are rounded, or 0.
    - `slope_coefficient`: c in σ² + c² |∇z|², 0 where the noise does not grow with the slope.
    - `texture_limited`: whether roughness reaches down to the pixel, so that `sigma` may hold texture.
    - `note`: what the user should know, or empty.

    >>> NoiseEstimate(0.5).neighbour_correlation
    0.0
    """

    sigma: float
    correlation_length: float = 0.0
    quantisation: float = 0.0
    slope_coefficient: float = 0.0
    texture_limited: bool = False
    note: str = ""

    @property
    def neighbour_correlation(self) -> float:
        """Correlation of the noise at neighbouring pixels."""
        s = self.correlation_length
        return float(np.exp(-1 / (4 * s**2))) if s > 0 else 0.0

    @property
    def correlated_samples(self) -> float:
        """The sum of the noise's correlations over all pixels: how many samples count as one."""
        return max(1.0, 4 * np.pi * self.correlation_length**2)


def estimate_noise(data: Any) -> NoiseEstimate:
    """Estimate the noise of measured data from the data alone.

    **Arguments:**

    - `data`: a `HeightMap`, `PointCloud`, `Samples`, or what `as_data` accepts. Points in space are judged by z.

    **Raises:** `InputError` for anything else. Data too small to judge (fewer than 5 × 5 pixels) give a sigma of 0.

    >>> rng = np.random.default_rng(0)
    >>> x = np.linspace(0, 6, 200)
    >>> estimate = estimate_noise(np.add.outer(np.sin(x), np.cos(x)) + rng.normal(0, 0.01, (200, 200)))
    >>> bool(abs(estimate.sigma / 0.01 - 1) < 0.05)
    True
    """
    data = data if isinstance(data, Samples) else as_data(data)
    if isinstance(data, HeightMap):
        return _of_grid(np.asarray(data.heights, np.float64), data.spacing)
    samples = data if isinstance(data, Samples) else data.samples()
    if samples.grid_shape is not None and samples.dimension == 1:
        rows, columns = samples.grid_shape
        width, height = samples.frame.extent
        spacing = (width / max(columns - 1, 1), height / max(rows - 1, 1))
        return _of_grid(samples.scatter(samples.values[:, 0].astype(np.float64)), spacing)
    places = samples.frame.xy_of(samples.parameters)
    return NoiseEstimate(_of_scattered(places, samples.values[:, -1].astype(np.float64)))


def quick_noise(data: HeightMap | PointCloud | Samples) -> float:
    """The noise's standard deviation, on a large map from a part of its rows: enough to warn by.

    >>> quick_noise(HeightMap(np.random.default_rng(0).normal(size=(1000, 300)))) > 0.9
    True
    """
    if not isinstance(data, HeightMap) or data.heights.size <= 2 * _ENOUGH or len(data.heights) < 4 * _BAND:
        return estimate_noise(data).sigma
    count = int(np.clip(_ENOUGH // (_BAND * data.heights.shape[1]), 1, len(data.heights) // _BAND))
    first = np.linspace(0, len(data.heights) - _BAND, count).astype(int)
    bands = np.concatenate([data.heights[row : row + _BAND] for row in first]).astype(np.float64)
    return _of_grid(bands, data.spacing).sigma if np.isfinite(bands).any() else 0.0


def noise_deviation(estimate: NoiseEstimate, samples: Samples) -> Float[np.ndarray, " m"]:
    """Standard deviation of the noise at each sample; it differs from place to place where noise grows with the slope.

    >>> noise_deviation(NoiseEstimate(2.0), Samples([[0.0, 0.0], [1.0, 1.0]], [1.0, 2.0]))
    array([2., 2.])
    """
    sigma = np.full(len(samples), estimate.sigma)
    if estimate.slope_coefficient == 0 or samples.grid_shape is None:
        return sigma
    rows, columns = samples.grid_shape
    width, height = samples.frame.extent
    heights = samples.scatter(samples.values[:, 0].astype(np.float64))
    slope = _smooth_slope(heights, (width / max(columns - 1, 1), height / max(rows - 1, 1)))
    return np.hypot(sigma, estimate.slope_coefficient * slope.ravel()[samples.grid_index])


def _of_grid(heights: Float[np.ndarray, "rows cols"], spacing: tuple[float, float]) -> NoiseEstimate:
    """The estimate of a height map."""
    valid = heights[np.isfinite(heights)]
    if min(heights.shape) < 5 or valid.size < 25:
        return NoiseEstimate(0.0)
    step = height_step(valid)
    centred = heights - valid.mean()
    levels = {k: _lowest_level(_mixed_differences(centred, k) / 6) for k in _STRIDES if min(heights.shape) > 4 * k}
    floor = max(
        step / np.sqrt(12), 4 * float(np.finfo(np.float64).eps) * float(np.abs(centred[np.isfinite(centred)]).max())
    )
    if levels[1] <= floor or max(levels.values()) <= _SMOOTH * float(np.ptp(valid)):
        return NoiseEstimate(max(floor, levels[1]) if step > 0 else levels[1], quantisation=step)
    sigma, length, texture = _correlation(levels)
    texture = texture or sigma > _ALL * float(valid.std())
    slope = 0.0 if length > 0 else _growth_with_slope(centred, spacing, sigma)
    return NoiseEstimate(max(sigma, step / np.sqrt(12)), length, step, slope, texture, _TEXTURE_NOTE if texture else "")


def _mixed_differences(heights: np.ndarray, stride: int) -> np.ndarray:
    """Second differences along both axes of pixels `stride` apart; 36 times the variance of white noise."""
    for axis in range(2):
        moved = np.moveaxis(heights, axis, 0)
        heights = np.moveaxis(moved[2 * stride :] - 2 * moved[stride:-stride] + moved[: -2 * stride], 0, axis)
    return heights


def _lowest_level(differences: np.ndarray) -> float:
    """Robust standard deviation over the blocks that agree on the lowest one."""
    rows, columns = (max(1, size // _BLOCK) for size in differences.shape)
    height, width = differences.shape[0] // rows, differences.shape[1] // columns
    blocks = np.abs(differences[: rows * height, : columns * width]).reshape(rows, height, columns, width)
    blocks = blocks.transpose(0, 2, 1, 3).reshape(rows * columns, -1)
    held = np.isfinite(blocks).sum(axis=1) >= max(8, blocks.shape[1] // 4)
    if not held.any():
        finite = np.abs(differences[np.isfinite(differences)])
        return float(np.median(finite) / _MEDIAN) if finite.size else 0.0
    blocks = blocks[held]
    median = np.median if np.isfinite(blocks).all() else np.nanmedian  # the former is several times faster
    medians = median(blocks, axis=1)
    level = float(np.quantile(medians, 0.15))
    for _ in range(6):
        agreeing = medians <= 1.4 * level
        level = float(median(blocks[agreeing]))
    return level / _MEDIAN


def _correlation(levels: dict[int, float]) -> tuple[float, float, bool]:
    """Marginal standard deviation, correlation length, and whether the levels rise without a plateau."""
    strides = np.array(sorted(levels))
    measured = np.array([levels[k] for k in strides])
    if len(strides) < 3 or measured[1] < 1.12 * measured[0]:
        return float(measured[0]), 0.0, False
    lengths = np.linspace(0.3, 4, 75)
    sides = lengths * np.sqrt(4 * np.pi)  # of the square window that correlates as many samples
    shapes = [np.exp(-(_lags(strides)[None] ** 2) / (4 * lengths[:, None, None] ** 2))]
    shapes.append(np.maximum(1 - _lags(strides)[None] / sides[:, None, None], 0))
    gains = np.concatenate([(6 - 8 * near[:, 0] + 2 * near[:, 1]) / 6 for near in shapes])
    logs = np.log(measured) - np.log(np.maximum(gains, 1e-12))
    misfit = logs.std(axis=1)
    best = int(np.argmin(misfit))
    length = float(lengths[best % len(lengths)])
    if misfit[best] > _UNLIKE or length > _LONGEST:
        return float(measured[1]), 0.0, True
    return float(np.exp(logs[best].mean())), length, False


def _lags(strides: np.ndarray) -> np.ndarray:
    """The distances of the pixels in a second difference: one stride and two, (2, strides)."""
    return np.stack([strides, 2 * strides]).astype(float)


def _smooth_slope(heights: np.ndarray, spacing: tuple[float, float]) -> np.ndarray:
    """Slope of the heights smoothed over two pixels, missing ones left out."""
    from scipy import ndimage

    known = np.isfinite(heights)
    weight = ndimage.gaussian_filter(known.astype(float), 2.0)
    smooth = ndimage.gaussian_filter(np.where(known, heights, 0.0), 2.0) / np.maximum(weight, 1e-12)
    down, across = np.gradient(smooth, spacing[1], spacing[0])
    return np.hypot(down, across)


def _growth_with_slope(heights: np.ndarray, spacing: tuple[float, float], sigma: float) -> float:
    """The coefficient c of σ² + c² |∇z|², 0 unless the noise clearly grows with the slope."""
    fourth = _mixed_differences(_mixed_differences(heights, 1), 1) / 70
    slope = _smooth_slope(heights, spacing)[2:-2, 2:-2]
    if min(fourth.shape) < 2 * _BLOCK:
        return 0.0
    known = np.isfinite(fourth)
    if known.sum() < 1000:
        return 0.0
    order = np.argsort(slope[known])
    groups = np.array_split(order, 20)
    squares, slopes = np.abs(fourth[known]), slope[known]
    levels = np.array([np.median(squares[group]) / _MEDIAN for group in groups])
    middles = np.array([np.sqrt(np.mean(slopes[group] ** 2)) for group in groups])
    if levels[-1] < 1.5 * levels[0] or np.corrcoef(levels, middles)[0, 1] < 0.8:
        return 0.0
    excess = np.clip(levels**2 - sigma**2, 0, None)
    return float(np.sqrt(np.sum(excess * middles**2) / np.sum(middles**4)))


def _of_scattered(places: Float[np.ndarray, "m 2"], values: Float[np.ndarray, " m"]) -> float:
    """Robust standard deviation from the planes of nearest neighbours."""
    if len(values) < 2 * _NEAREST:
        return 0.0
    from scipy.spatial import KDTree

    chosen = np.arange(0, len(values), max(1, len(values) // _PROBES))
    _, near = KDTree(places).query(places[chosen], k=_NEAREST)
    offsets = places[near] - places[chosen][:, None]
    scale = np.maximum(np.abs(offsets).max(axis=(1, 2), keepdims=True), np.finfo(float).tiny)
    columns = np.concatenate([np.ones((*near.shape, 1)), offsets / scale], axis=2)
    heights = values[near] - values[near].mean(axis=1, keepdims=True)
    basis = np.linalg.qr(columns)[0]
    rest = heights - np.einsum("mki,mi->mk", basis, np.einsum("mki,mk->mi", basis, heights))
    freedom = _NEAREST - 3
    # The median of χ²(f) / f, by Wilson and Hilferty.
    median = (1 - 2 / (9 * freedom)) ** 3
    return float(np.sqrt(np.median(np.sum(rest**2, axis=1)) / freedom / median))
