"""How noisy is a measured surface? An estimate from the data alone, without a fit.

**Grids.** Differences of orders 3, 4 and 6 at lags of 1 to 8 pixels, along x and along y (see `_differences`), have one
level on white noise, whatever the order and lag. What the level does as the lag grows tells what is there:

- it is flat from lag 1: white noise, and the level is σ;
- it rises and then stays: noise correlated over a few pixels (a smoothing filter, an instrument's resolution); the
  plateau is σ, and the way up gives the correlation;
- it rises as a high power of the lag, and the sixth difference is far below the third: a smooth surface without noise;
- it keeps rising slowly, all orders alike: roughness of all sizes down to the pixel. Nothing in the data then tells
  texture from noise (`texture_limited`), and σ is a convention: the level at two pixels, so that whatever is finer
  than some four pixels counts as noise.

**Scattered points.** Residuals of local polynomials of degree 1, 2 and 3 through the nearest points: where the
degrees agree, they are noise.

**What it cannot know.** Texture that is white at the pixel is taken for noise, and so is a repeated error of the
instrument. Noise that is correlated over more than about three pixels is taken for texture. Line noise (every row with
an offset of its own) shows along y only: σ is the larger of both directions. Rounding to counts of q is white with
σ = q / √12 only where the surface crosses several counts between neighbours; on terraces it is not noise at all, but
q / √12 is reported. A share of outliers does no harm; find them with `find_outliers`.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ._as_data import as_data
from ._differences import LAGS, correlation_of, levels
from ._height_map import HeightMap
from ._local_fits import scattered_noise
from ._rounding import height_step
from ._samples import Samples
from ._slope_noise import slope_dependence, slopes

_SPARSE = 0.25
_DOUBLINGS = ((0, 1), (1, 3), (2, 4), (3, 5))  # of LAGS: 1 to 2, 2 to 4, 3 to 6, 4 to 8 pixels
_FLAT = 0.18
_LAST_RISE = 0.5
_SMOOTH = 0.1
_AGREE = 0.85
_TOO_FEW = "too few neighbouring samples to estimate the noise"


@dataclass(frozen=True, repr=False)
class NoiseEstimate:
    """Measurement noise, in the data's unit.

    **Attributes:**

    - `sigma`: standard deviation of the noise at a sample; its root mean square where it varies.
    - `correlation`: the noise's own correlation between neighbours along x and along y; 0 for white noise.
    - `correlation_length`: pixels along a side over which noise is one (the mean over both directions of the sum of
      the correlation over all lags); 1 for white noise.
    - `quantisation`: the step of rounded heights, 0 if they are not rounded.
    - `floor`, `slope_coefficient`: noise where the surface has the slope g is `floor + slope_coefficient · g`.
    - `texture_limited`: roughness reaches down to the pixel, so that texture and noise cannot be told apart.
    - `note`: one line for the reader, empty if there is nothing to say.

    >>> NoiseEstimate(0.25)
    NoiseEstimate(sigma=0.25, white)
    """

    sigma: float
    correlation: tuple[float, float] = (0.0, 0.0)
    correlation_length: float = 1.0
    quantisation: float = 0.0
    floor: float = 0.0
    slope_coefficient: float = 0.0
    texture_limited: bool = False
    note: str = ""

    @property
    def signal_dependent(self) -> bool:
        """Whether noise grows with the slope."""
        return self.slope_coefficient > 0

    @property
    def correlated_samples(self) -> float:
        """How many samples of a grid share one independent value of the noise; 1 for white noise."""
        return self.correlation_length**2

    def __repr__(self) -> str:
        """Say how much noise there is and of what kind."""
        kind = "white" if self.correlation_length <= 1 else f"correlated over {self.correlation_length:.2g} pixels"
        more = f", rounded to {self.quantisation:.3g}" if self.quantisation else ""
        more += f", growing with slope by {self.slope_coefficient:.3g}" if self.signal_dependent else ""
        more += ", texture_limited" if self.texture_limited else ""
        return f"NoiseEstimate(sigma={self.sigma:.4g}, {kind}{more})"


def estimate_noise(data: Any, *, as_surface: bool = False) -> NoiseEstimate:
    """Estimate the standard deviation and the kind of the noise of measured data.

    **Arguments:**

    - `data`: a `HeightMap`, a `PointCloud`, `Samples`, or what `as_data` accepts.
    - `as_surface`: the points of a cloud lie on a surface in space: measure along its normals, not along z. Samples of
      points in space are always measured so.

    **Returns:** a `NoiseEstimate`; its sigma is 0, with a note, where there are too few samples to judge.

    >>> rng = np.random.default_rng(0)
    >>> smooth = np.add.outer(np.sin(np.arange(200) / 30), np.cos(np.arange(300) / 50))
    >>> noise = estimate_noise(smooth + rng.normal(0, 0.05, smooth.shape))
    >>> abs(noise.sigma - 0.05) < 0.0025, noise.texture_limited
    (True, False)
    """
    data = data if isinstance(data, Samples) else as_data(data)
    if isinstance(data, HeightMap):
        if data.valid.mean() < _SPARSE:
            return _of_points(data.samples()) if data.valid.sum() > 1 else NoiseEstimate(0.0, note=_TOO_FEW)
        return _of_grid(data.heights.astype(np.float64), data.spacing)
    samples = data if isinstance(data, Samples) else data.samples(as_surface=as_surface)
    if not _on_grid(samples):
        return _of_points(samples)
    return _of_grid(samples.scatter(samples.values[:, 0]).astype(np.float64), _spacing_of(samples))


def local_noise(data: Any, estimate: NoiseEstimate | None = None) -> Float[np.ndarray, "..."]:
    """Return the noise at each sample: constant, unless it grows with the slope.

    **Arguments:**

    - `data`: what `estimate_noise` accepts.
    - `estimate`: its estimate, if that is known already.

    **Returns:** standard deviations in the data's unit, (rows, columns) for a height map, NaN where missing; (m,) for
    clouds and samples.

    >>> local_noise([[1.0, 2.0], [3.0, np.nan]], NoiseEstimate(0.5))
    array([[0.5, 0.5],
           [0.5, nan]])
    """
    data = data if isinstance(data, Samples) else as_data(data)
    estimate = estimate_noise(data) if estimate is None else estimate
    if isinstance(data, HeightMap):
        return _over_grid(data.heights, data.spacing, estimate)
    if isinstance(data, Samples) and data.grid_index is not None and _on_grid(data):
        return _over_grid(data.scatter(data.values[:, 0]), _spacing_of(data), estimate).ravel()[data.grid_index]
    return np.full(len(data), estimate.sigma)


def noise_deviation(estimate: NoiseEstimate, samples: Samples) -> Float[np.ndarray, " m"]:
    """Return the noise at each sample for an estimate: `local_noise` in the order a fit asks for it.

    >>> noise_deviation(NoiseEstimate(2.0), Samples([[0.0, 0.0], [1.0, 1.0]], [1.0, 2.0]))
    array([2., 2.])
    """
    return local_noise(samples, estimate)


def _over_grid(heights: np.ndarray, spacing: tuple[float, float], estimate: NoiseEstimate) -> np.ndarray:
    if estimate.signal_dependent:
        return estimate.floor + estimate.slope_coefficient * slopes(heights, spacing)
    return np.where(np.isfinite(heights), estimate.sigma, np.nan)


def _on_grid(samples: Samples) -> bool:
    """Whether samples are heights on a grid, and most neighbours are there."""
    if samples.grid_shape is None or samples.dimension != 1:
        return False
    return len(samples) >= _SPARSE * samples.grid_shape[0] * samples.grid_shape[1]


def _spacing_of(samples: Samples) -> tuple[float, float]:
    """Pixel spacing (dx, dy) of samples that come from a grid."""
    rows, cols = samples.grid_shape or (1, 1)
    across, down = samples.frame.extent
    return across / (cols - 1) if cols > 1 else 1.0, down / (rows - 1) if rows > 1 else 1.0


def _of_grid(heights: Float[np.ndarray, "rows cols"], spacing: tuple[float, float]) -> NoiseEstimate:
    """The estimate for a grid: levels of differences, then what their growth with the lag means."""
    step = height_step(heights[np.isfinite(heights)])
    extra = step**2 / 12
    if step:
        # Uniform noise of one count makes rounded differences continuous; its variance is taken off again.
        heights = heights + np.random.default_rng(0).uniform(-step / 2, step / 2, heights.shape)
    table = levels(heights)
    if not np.isfinite(table[:, -1, 0]).any():
        return NoiseEstimate(0.0, quantisation=step, note=_TOO_FEW)
    plateaus = [_plateau(of_direction[-1]) for of_direction in table]
    table = np.sqrt(np.maximum(table**2 - extra, 0.25 * extra))
    least = float(np.sqrt(extra))
    if _is_smooth(table):
        return NoiseEstimate(max(float(np.nanmin(table[:, -1, 0])), least), quantisation=step, note="no noise found")
    sigma = _common_level(table, plateaus)
    if sigma is not None and sigma <= 1.5 * least:
        return NoiseEstimate(max(sigma, least), quantisation=step, note="rounding is all the noise there is")
    dependence = slope_dependence(heights, spacing, extra)
    growing = None if dependence is None else _growing(heights, spacing, step, dependence)
    if growing is not None:
        return growing
    if sigma is None:
        return _texture(table, least, step)
    correlation, length = _correlation(table, sigma, plateaus)
    return NoiseEstimate(sigma, correlation, length, step)


def _growing(
    heights: np.ndarray, spacing: tuple[float, float], step: float, dependence: tuple[float, float, float]
) -> NoiseEstimate | None:
    """The estimate where noise grows with the slope: levels relative to the noise at each place, as seen at lag 1."""
    floor, coefficient, whole = dependence
    table = levels(heights, np.sqrt((floor + coefficient * slopes(heights, spacing)) ** 2 + step**2 / 12))
    plateaus = [_plateau(of_direction[-1]) for of_direction in table]
    level = None if _is_smooth(table) else _common_level(table, plateaus)
    if level is None:
        return None
    correlation, length = _correlation(table, level, plateaus)
    # Lag 1 shows only a part of correlated noise, but the same part everywhere.
    part = level / float(np.nanmean(table[:, -1, 0]))
    note = "noise grows with the slope"
    return NoiseEstimate(part * whole, correlation, length, step, part * floor, part * coefficient, note=note)


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
    if plateau == len(_DOUBLINGS) - 1:
        # Differences this wide hold some of the surface too: the least of the orders holds least of it.
        return float(np.nanmin(of_direction[:, first + 1]))
    values = of_direction[1:][:, [first, second]]
    values = values[np.isfinite(values) & (values > 0)]
    return float(np.exp(np.log(values).mean())) if len(values) else 0.0


def _common_level(table: Float[np.ndarray, "2 orders lags"], plateaus: list[int | None]) -> float | None:
    """The noise of both directions; `None` if one of them keeps rising and so might pass the other's plateau."""
    found = [_level_at(part, i) for part, i in zip(table, plateaus, strict=True) if i is not None]
    if not found:
        return None
    sigma = max(found)
    for part, plateau in zip(table, plateaus, strict=True):
        rising = part[-1][np.isfinite(part[-1])]
        if plateau is None and len(rising) and rising[-1] > 0.3 * sigma:
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
        neighbours.append(max(float(correlation[0]), 0.0))
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
        return NoiseEstimate(0.0, quantisation=step, note=_TOO_FEW)
    if third <= _SMOOTH * first:
        return NoiseEstimate(sigma, quantisation=step, note="no noise found")
    if third < _AGREE * second:
        note = "points too sparse for their surface: detail between neighbours and noise cannot be told apart"
        return NoiseEstimate(sigma, quantisation=step, texture_limited=True, note=note)
    return NoiseEstimate(sigma, quantisation=step)
