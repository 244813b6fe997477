"""How noisy are the data? An estimate from the data alone, and what it cannot tell.

Height maps: second differences in both directions at once, of pixels k apart, vanish on every sum f(x) + g(y) of smooth
shapes (and on edges along the axes) and keep a known share of the noise (after Immerkaer, CVIU 64, 1996). Their size is
taken from those blocks of the map that agree on the lowest value, so features elsewhere do not count. White noise gives the same
figure at k = 1, 2, 4, 8; noise correlated over a Gaussian of s pixels rises to a plateau, which gives s; texture that
reaches down to the pixel rises without one, and then texture and noise cannot be told apart. Noise that grows with the
slope is found by regressing fourth differences, on which even narrow features leave little, on the slope.

Scattered points: distances from the plane of the twelve nearest neighbours.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ._as_data import as_data
from ._height_map import HeightMap
from ._rounding import height_step
from ._samples import Samples
from ._slope_noise import slope_dependence

_BLOCK = 16
_STRIDES = (1, 2, 4, 8)
_SMOOTH = 1e-4  # of the range: below it at every stride the map is taken to be smooth
_ALL = 0.7  # of the data's own deviation: above it there is nothing but "noise"
_MEDIAN = 0.6744897501960817  # median of |x| for a standard normal
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
    - `correlation_length`: standard deviation in pixels of the Gaussian whose smoothing of white noise would correlate it
      as much; 0 for white noise.
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
    floor: float = 0.0
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
    """The estimate for a grid: levels of differences, then what their growth with the lag means."""
    step = height_step(heights[np.isfinite(heights)])
    extra = step**2 / 12
    if step:
        # Uniform noise of one count makes rounded differences continuous; its variance is taken off again.
        heights = heights + np.random.default_rng(0).uniform(-step / 2, step / 2, heights.shape)
    table = levels(heights)
    if not np.isfinite(table[:, :, 0]).any():
        return NoiseEstimate(0.0, quantisation=step, note="too few neighbouring samples to estimate the noise")
    plateaus = [_plateau(of_direction[-1]) for of_direction in table]
    table = np.sqrt(np.maximum(table**2 - extra, 0.25 * extra))
    least = float(np.sqrt(extra))
    if _is_smooth(table):
        return NoiseEstimate(max(float(np.nanmin(table[:, -1, 0])), least), quantisation=step, note="no noise found")
    sigma = _common_level(table, plateaus)
    if sigma is None:
        return _texture(table, least, step)
    correlation, length = _correlation(table, sigma, plateaus)
    if sigma <= least:
        return NoiseEstimate(least, correlation, length, step, note="rounding is all the noise there is")
    dependence = slope_dependence(heights, spacing, extra)
    if dependence is None:
        return NoiseEstimate(sigma, correlation, length, step)
    # Differences at lag 1 show only a part of correlated noise, but the same part everywhere.
    floor, coefficient, whole = np.array(dependence) * sigma / np.nanmean(table[:, -1, 0])
    return NoiseEstimate(
        float(whole), correlation, length, step, float(floor), float(coefficient), note="noise grows with the slope"
    )


def _plateau(growing: Float[np.ndarray, " lags"]) -> int | None:
    """Index of the first lag whose level stays when the lag doubles, `None` if there is none.

    A filter blurs noise at the pixel far more than roughness of all sizes: after a steep start the last doubling may
    still rise a little.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        rises = np.array([np.log2(growing[j] / growing[i]) for i, j in _DOUBLINGS])
    flat = np.flatnonzero(np.abs(rises) <= _FLAT)
    if len(flat):
        return int(flat[0])
    ends = np.isfinite(rises).all() and rises[-1] <= min(_LAST_RISE, rises[0] / 4)
    return len(_DOUBLINGS) - 1 if ends else None


def _is_smooth(table: Float[np.ndarray, "2 orders lags"]) -> bool:
    """Whether the highest order leaves next to nothing of what the lowest leaves, in both directions."""
    low, high = table[:, 0, 0], table[:, -1, 0]
    known = np.isfinite(low) & np.isfinite(high)
    return bool(known.any() and np.all(high[known] <= _SMOOTH * low[known]))


def _level_at(of_direction: Float[np.ndarray, "orders lags"], plateau: int) -> float:
    """The level of a plateau: the two highest orders, at its first lag and twice that."""
    first, second = _DOUBLINGS[plateau]
    lags = [first, second] if plateau < len(_DOUBLINGS) - 1 else [first + 1]
    values = of_direction[1:][:, lags]
    values = values[np.isfinite(values) & (values > 0)]
    return float(np.exp(np.log(values).mean())) if len(values) else 0.0


def _common_level(table: Float[np.ndarray, "2 orders lags"], plateaus: list[int | None]) -> float | None:
    """The noise of both directions; `None` if one of them keeps rising above the other's plateau."""
    found = [_level_at(part, i) for part, i in zip(table, plateaus, strict=True) if i is not None]
    if not found:
        return None
    sigma = max(found)
    for part, plateau in zip(table, plateaus, strict=True):
        rising = part[-1][np.isfinite(part[-1])]
        if plateau is None and len(rising) and rising[-1] > 1.3 * sigma:
            return None
    return sigma


def _correlation(
    table: Float[np.ndarray, "2 orders lags"], sigma: float, plateaus: list[int | None]
) -> tuple[tuple[float, float], float]:
    """Correlation of neighbours along x and y, and the correlation length."""
    neighbours, lengths = [], []
    for part, plateau in zip(table, plateaus, strict=True):
        far = 0.0 if plateau is None else max(0.0, 1 - (_level_at(part, plateau) / sigma) ** 2)
        far = far if far > 0.2 else 0.0
        if (plateau == 0 and far == 0) or not np.isfinite(part).any():
            neighbours.append(0.0)
            lengths.append(1.0)
            continue
        squares = (part / sigma) ** 2
        if plateau is not None:
            squares[:, _DOUBLINGS[plateau][1] + 1 :] = np.nan
        correlation = correlation_of(np.minimum(squares, 1.2), far)
        neighbours.append(float(correlation[0]))
        lengths.append(1 + 2 * float(np.maximum(correlation, 0).sum()))
    return (neighbours[0], neighbours[1]), float(np.sqrt(lengths[0] * lengths[1]))


def _texture(table: Float[np.ndarray, "2 orders lags"], least: float, step: float) -> NoiseEstimate:
    """Roughness down to the pixel: by convention its level at two pixels counts as noise."""
    lag = 1 if np.isfinite(table[:, -1, 1]).any() else 0
    sigma = max(float(np.nanmax(table[:, -1, lag])), least)
    short = np.where(np.arange(len(LAGS)) <= lag, table, np.nan)
    correlation, length = _correlation(short, sigma, [None, None])
    note = "roughness reaches down to the pixel: texture and noise cannot be told apart"
    return NoiseEstimate(sigma, correlation, length, step, texture_limited=True, note=note)


def _of_points(samples: Samples) -> NoiseEstimate:
    """The estimate for scattered points: local polynomials of growing degree."""
    in_space = samples.dimension == 3
    points = samples.values if in_space else np.column_stack([samples.frame.xy_of(samples.parameters), samples.values])
    step = 0.0 if in_space else height_step(samples.values[:, 0])
    first, second, third = scattered_noise(points.astype(np.float64), in_space=in_space)
    sigma = max(float(third), step / np.sqrt(12)) if np.isfinite(third) else 0.0
    if not np.isfinite(third):
        return NoiseEstimate(0.0, quantisation=step, note="too few samples to estimate the noise")
    if third <= _SMOOTH * first:
        return NoiseEstimate(sigma, quantisation=step, note="no noise found")
    if third < _AGREE * second:
        note = "points too sparse for their surface: detail between neighbours and noise cannot be told apart"
        return NoiseEstimate(sigma, quantisation=step, texture_limited=True, note=note)
    return NoiseEstimate(sigma, quantisation=step)
