"""Holes filled by the covariance of the map itself: kriging.

How much a known pixel tells about a missing one is said by the map: direction and length of a lay, roughness, noise,
and the period of a structure that repeats. What is counted are increments of some order m, for heights drift, and in
the spectrum of a smooth map its large waves would leak over its small ones (Tukey's prewhitening; increments: Matheron
1973). With D = ∂x², ∂y² by differences, the spectra of all increments of order m add up to (Dx + Dy)^m S, S that of the
heights: from their mean products at lags of up to some pixels, missing ones left out, follows S, and from it r(h), the
covariance of the heights of pixels a lag h apart.

The best linear prediction of the missing heights z_m from known ones z_k is C_mk C_kk⁻¹ z_k (Matheron 1963), with a
plane of free slope added. The pixels that tell most are near the hole, and, on surfaces that repeat, where the hole
would be one period on.
"""

from dataclasses import dataclass
from math import comb

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.fft import irfft2, next_fast_len, rfft2
from scipy.linalg import cho_factor, cho_solve
from scipy.ndimage import distance_transform_edt, maximum_filter

from ._filler import AbstractFiller, Field, Predict, Window

#: Known pixels this near a missing one all count, those further off are thinned.
_NEAR, _THIN = 3.0, 3
#: Lags at most: windows are smaller.
_FARTHEST = 256
#: Correlations above which pixels that lie periods away are asked, and the most periods.
_REPEATS, _MOST_PERIODS = 0.4, 6
_MOST_KNOWN = 1500
#: The least spectrum over the mean one, and the least variance of a pixel of its own over that of the heights.
_FLOOR, _LEAST = 2e-2, 1e-10
_NOWHERE = np.zeros((0, 2), int)


@dataclass(frozen=True)
class CovarianceFiller(AbstractFiller):
    """The best linear prediction under the map's own covariance.

    **Arguments:**

    - `order`: of the increments whose products are counted: 0 heights, 1 slopes, 2 curvatures, 3; the smoother the
      map, the higher.
    - `reach`: lags at most, in pixels; half of the shorter side by default, which sees lay and period, while few lags
      are counted more surely.
    - `nearby`: count only within so many pixels of a hole, for maps that differ from place to place.

    >>> CovarianceFiller(2, 6).name
    'covariance of curvatures, 6 lags'
    """

    order: int = 1
    reach: int | None = None
    nearby: int | None = None

    @property
    def name(self) -> str:
        """What is counted, and where."""
        counted = ("heights", "slopes", "curvatures", "third differences")[self.order]
        lags = "" if self.reach is None else f", {self.reach} lags"
        return f"covariance of {counted}{lags}{'' if self.nearby is None else ' nearby'}"

    @property
    def margin(self) -> int:
        """A fixed number, thinned outwards."""
        return 8

    def prepare(self, field: Field) -> Predict:
        """Find the covariance and its periods, unless both are a matter of each window."""
        if (nearby := self.nearby) is not None:
            return lambda window: self._fill_by_what_is_near(field, window, nearby)
        covariance = covariance_of(field.heights, self.order, self.reach)
        periods = _NOWHERE if self.reach is not None else _periods(covariance_of(field.heights))
        return lambda window: _predicted(field, window, covariance, periods)

    def _fill_by_what_is_near(self, field: Field, window: Window, nearby: int) -> Float[np.ndarray, " wanted"]:
        part = tuple(slice(max(side.start - nearby, 0), side.stop + nearby) for side in (window.rows, window.columns))
        return _predicted(field, window, covariance_of(field.heights[part], self.order, self.reach), _NOWHERE)


@dataclass(frozen=True, eq=False)
class Covariance:
    """r(h) for lags of up to `reach` pixels: `values[reach + rows, reach + columns]`, zero beyond."""

    values: Float[np.ndarray, "lags lags"]
    reach: int

    def between(self, first: Int[np.ndarray, "m 2"], second: Int[np.ndarray, "n 2"]) -> Float[np.ndarray, "m n"]:
        """Covariances of pixels."""
        rows, columns = (np.subtract.outer(first[:, k], second[:, k]) for k in range(2))
        width = 2 * self.reach + 1
        if max(np.abs(rows).max(), np.abs(columns).max()) <= self.reach:
            return self.values.ravel().take(rows * width + columns + (width * width) // 2)
        near = (np.abs(rows) <= self.reach) & (np.abs(columns) <= self.reach)
        result = np.zeros(rows.shape)
        result[near] = self.values.ravel().take(rows[near] * width + columns[near] + (width * width) // 2)
        return result

    @property
    def variance(self) -> float:
        """r(0)."""
        return float(self.values[self.reach, self.reach])


def covariance_of(heights: Float[np.ndarray, "rows columns"], order: int = 0, reach: int | None = None) -> Covariance:
    """The covariance of a map whose quadratic trend is removed, from its increments.

    >>> covariance_of(np.random.default_rng(0).normal(size=(40, 50))).reach
    20
    """
    shorter, longer = min(heights.shape), max(heights.shape)
    order = min(order, shorter - 1)
    most = min(shorter // 2, _FARTHEST)
    counted = most if reach is None else min(reach, most)
    known = np.isfinite(heights)
    rest = np.where(known, heights - _quadratic(heights, known), np.nan)
    products = np.zeros((2 * counted + 1, 2 * counted + 1))
    for k in range(order + 1):
        products += comb(order, k) * _mean_products(np.diff(np.diff(rest, k, axis=1), order - k, axis=0), counted)
    # What is left of increments of an order > 0 never fades: the table holds every lag that a window can ask for.
    span = min(longer, _FARTHEST) if order else counted
    size = _fast(2 * span + counted + 1)
    circular = np.zeros((size, size))
    lags = np.arange(-counted, counted + 1)
    circular[np.ix_(lags, lags)] = products
    # Without a floor the noise of the count says of some waves that there are none, which nothing can be sure of.
    floor = _FLOOR * circular[0, 0] if order else 0.0
    spectrum = np.maximum(np.real(np.asarray(rfft2(circular))), floor)
    if order:
        along, across = (4 * np.sin(np.pi * f(size)) ** 2 for f in (np.fft.rfftfreq, np.fft.fftfreq))
        gain = np.add.outer(across, along) ** order
        gain[0, 0] = np.inf  # the mean is free
        spectrum = spectrum / gain
    lags = np.arange(-span, span + 1)
    return Covariance(np.asarray(irfft2(spectrum, (size, size)))[np.ix_(lags, lags)], span)


def _mean_products(part: Float[np.ndarray, "rows columns"], reach: int) -> Float[np.ndarray, "lags lags"]:
    """Mean products of known values a lag apart, counted under a taper, so that the border leaves no trace, and faded
    out towards long lags, so that the spectrum can be made positive.
    """
    taper = np.outer(*(np.sin(np.pi * (np.arange(n) + 1) / (n + 1)) for n in part.shape))
    window = np.where(np.isfinite(part), taper, 0.0)
    values = window * np.nan_to_num(part)
    shape = tuple(_fast(n + reach) for n in part.shape)
    spectra = [np.abs(np.asarray(rfft2(each, shape))) ** 2 for each in (values, window)]
    products, counts = (np.asarray(irfft2(spectrum, shape)) for spectrum in spectra)
    lags = np.arange(-reach, reach + 1)
    place = np.ix_(lags, lags)
    distance = np.minimum(np.hypot(lags[:, None], lags) / (reach + 1), 1)
    fade = 0.5 + 0.5 * np.cos(np.pi * distance)
    return fade * products[place] / np.maximum(counts[place], 1e-9 * counts[0, 0] + np.finfo(float).tiny)


def _fast(length: int) -> int:
    """The next length of which transforms are quick."""
    return int(next_fast_len(length, real=True))  # pyright: ignore[reportArgumentType] -- scipy states no type


def _quadratic(heights: Float[np.ndarray, "r c"], known: Bool[np.ndarray, "r c"]) -> Float[np.ndarray, "r c"]:
    """The polynomial of order two through the known heights."""
    t, s = (np.linspace(-1, 1, n) for n in heights.shape)
    terms = [t[:, None] ** a * s**b for a in range(3) for b in range(3 - a)]
    columns = np.stack([term[known] for term in terms], axis=1)
    factors = np.linalg.lstsq(columns.T @ columns, columns.T @ heights[known], rcond=None)[0]
    return np.tensordot(factors, np.stack(terms), 1)


def _periods(covariance: Covariance) -> Int[np.ndarray, "n 2"]:
    """Lags other than zero at which the map is most like itself."""

    correlation = covariance.values / max(covariance.variance, np.finfo(float).tiny)
    reach = covariance.reach
    peaks = (correlation == maximum_filter(correlation, 7)) & (correlation > _REPEATS)
    lags = np.argwhere(peaks) - reach
    # What lies within the first valley around zero is the pixel's own neighbourhood.
    rays = np.minimum.accumulate(correlation[reach, reach:])
    valley = int(np.argmax(rays < _REPEATS / 2)) if (rays < _REPEATS / 2).any() else reach
    lags = lags[np.abs(lags).max(axis=1) > max(valley, 4)]
    order = np.argsort(-correlation[lags[:, 0] + reach, lags[:, 1] + reach], kind="stable")
    return lags[order[:_MOST_PERIODS]]


def _predicted(
    field: Field, window: Window, covariance: Covariance, periods: Int[np.ndarray, "n 2"]
) -> Float[np.ndarray, " wanted"]:
    """The best prediction of a window's wanted pixels."""

    corner = np.array([window.rows.start, window.columns.start])
    wanted = np.argwhere(window.wanted) + corner
    known = _asked(field.heights, window, wanted, periods)
    if not len(known):
        return np.full(len(wanted), np.nan)
    values = field.heights[known[:, 0], known[:, 1]]
    mean, variance = float(values.mean()), covariance.variance
    centre, size = wanted.mean(axis=0), float(max(window.wanted.shape))

    def plane(places: np.ndarray) -> np.ndarray:
        return np.column_stack([np.ones(len(places)), (places - centre) / size])

    matrix, across = covariance.between(known, known), covariance.between(wanted, known)
    least = _LEAST * max(variance, np.finfo(float).tiny)
    for _ in range(5):
        matrix[np.diag_indices_from(matrix)] += least
        try:
            factor = cho_factor(matrix, lower=True, check_finite=False)
        except np.linalg.LinAlgError:
            least *= 30
            continue
        drift = plane(known)
        solved = cho_solve(factor, np.column_stack([drift, values - mean]), check_finite=False)
        slope = np.linalg.lstsq(drift.T @ solved[:, :-1], drift.T @ solved[:, -1], rcond=None)[0]
        return mean + plane(wanted) @ slope + across @ (solved[:, -1] - solved[:, :-1] @ slope)
    return np.full(len(wanted), mean)


def _asked(
    heights: Float[np.ndarray, "rows columns"],
    window: Window,
    wanted: Int[np.ndarray, "m 2"],
    periods: Int[np.ndarray, "n 2"],
) -> Int[np.ndarray, "k 2"]:
    """The known pixels that are asked: all near ones, some further off, and those a period away."""

    part = heights[window.rows, window.columns]
    known = np.isfinite(part)
    distance = np.asarray(distance_transform_edt(~window.wanted))
    i, j = np.indices(part.shape)
    thinned = (i % _THIN == 0) & (j % _THIN == 0)
    near = np.argwhere(known & ((distance <= _NEAR) | thinned)) + np.array([window.rows.start, window.columns.start])
    chosen = [near]
    count = len(near)
    for period in periods:
        there = wanted + period
        there = there[np.all((there >= 0) & (there < heights.shape), axis=1)]
        there = there[np.isfinite(heights[there[:, 0], there[:, 1]])]
        count += len(there)
        if count > _MOST_KNOWN:
            break
        chosen.append(there)
    return np.unique(np.concatenate(chosen), axis=0)
