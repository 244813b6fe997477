"""What a caller asks of a fit, checked and turned into numbers in the data's unit."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import ArrayLike, Bool

from .._errors import InputError
from ..data import (
    HeightMap,
    NoiseEstimate,
    PointCloud,
    Samples,
    StoredMap,
    as_data,
    estimate_noise,
    find_outliers,
    parse_length,
    quick_noise,
)
from ._distributed import surveyed
from ._engines import AbstractEngine
from ._source import AbstractSource, HeldSource, StoredSource

Length = float | str


@dataclass(frozen=True, eq=False)
class Request:
    """The data and the criterion of a fit.

    **Attributes:**

    - `source`: what is fitted, and which samples are set aside.
    - `tolerance`: in the data's unit, or `None` for a fit to noise.
    - `noise`: what is known of the noise, or `None`.
    - `robust`: whether outliers were looked for.
    - `warnings`: what the data give reason to say.
    """

    source: AbstractSource
    tolerance: float | None
    noise: NoiseEstimate | None
    robust: bool
    warnings: tuple[str, ...]

    @property
    def range(self) -> float:
        """Max - min of the inliers, or the diagonal of their box for points in space."""
        return self.source.range

    @property
    def held(self) -> HeldSource:
        """The source of samples in memory."""
        assert isinstance(self.source, HeldSource)
        return self.source

    @property
    def samples(self) -> Samples:
        """The samples in memory."""
        return self.held.samples

    @property
    def outliers(self) -> Bool[np.ndarray, " m"]:
        """Which samples are set aside, (m,)."""
        return self.held.outliers

    @property
    def counted(self) -> Bool[np.ndarray, " m"]:
        """Samples that count: neither outliers nor of weight zero."""
        return self.held.counted


def read_request(
    data: object,
    *,
    tolerance: Length | None,
    relative_tolerance: float | None,
    noise: Length | None,
    weights: ArrayLike | None,
    robust: bool,
    as_surface: bool,
) -> Request:
    """Check a caller's wishes against the data."""
    _require_one_criterion(tolerance, relative_tolerance, noise)
    source = data if isinstance(data, Samples) else as_data(data)
    samples = _samples_of(source, weights, as_surface)
    outliers = _outliers_of(source, samples, as_surface) if robust else np.zeros(len(samples), bool)
    held = HeldSource(samples, outliers)
    if not held.counted.any():
        raise InputError("no sample is left to fit: all have weight 0 or are outliers; check the weights")
    warnings = list(_data_warnings(samples, held.counted, robust))
    if tolerance is None and relative_tolerance is None:
        estimate = _noise_of(source, noise, samples.frame.unit)
        if estimate.texture_limited:
            warnings.append(estimate.note)
        return Request(held, None, estimate, robust, tuple(warnings))
    limit = _limit_of(tolerance, relative_tolerance, held.range, samples.frame.unit)
    sigma = quick_noise(source) if samples.dimension == 1 else 0.0
    warnings.extend(_limit_warnings(limit, held.range, sigma))
    return Request(held, limit, None, robust, tuple(warnings))


def read_stored_request(
    stored: StoredMap,
    *,
    tolerance: Length | None,
    relative_tolerance: float | None,
    noise: Length | None,
    max_memory: float,
    engine: AbstractEngine | None,
) -> Request:
    """Check a caller's wishes against a map that stays where it is; noise and tilt are judged by part of its rows."""
    _require_one_criterion(tolerance, relative_tolerance, noise)
    stored = stored if engine is None else surveyed(stored, engine)
    source = StoredSource(stored, max_memory, engine)
    part = stored.mosaic()
    warnings = []
    if part.valid.sum() > 3:
        samples = part.samples()
        warnings = _data_warnings(samples, np.ones(len(samples), bool), False)
    if tolerance is None and relative_tolerance is None:
        if noise in (None, "auto") and not part.valid.any():
            raise InputError(
                "the noise is estimated from blocks all over the map, but every pixel in them is missing (NaN); give "
                "noise= as a number, or a tolerance"
            )
        estimate = _noise_of(part, noise, stored.unit)
        if estimate.texture_limited:
            warnings.append(estimate.note)
        return Request(source, None, replace(estimate, slope_coefficient=0.0), False, tuple(warnings))
    limit = _limit_of(tolerance, relative_tolerance, source.range, stored.unit)
    warnings.extend(_limit_warnings(limit, source.range, estimate_noise(part).sigma))
    return Request(source, limit, None, False, tuple(warnings))


def _require_one_criterion(*options: Length | None) -> None:
    """Raise where several of tolerance, relative tolerance and noise are given."""
    if sum(option is not None for option in options) > 1:
        raise InputError("give at most one of tolerance, relative_tolerance and noise; several were given")


def _limit_of(tolerance: Length | None, relative_tolerance: float | None, spread: float, unit: str | None) -> float:
    """The largest error allowed, in the data's unit."""
    if tolerance is not None:
        return _positive(parse_length(tolerance, unit), "a tolerance", tolerance)
    assert relative_tolerance is not None
    if spread == 0:
        raise InputError(
            "a relative tolerance is a share of the range, but this surface is constant (range 0); give tolerance="
        )
    return _positive(relative_tolerance, "a relative tolerance", relative_tolerance) * spread


def _limit_warnings(limit: float, spread: float, sigma: float) -> list[str]:
    """A tolerance that shows nothing of the surface, or follows the noise."""
    warnings = []
    if spread > 0 and limit > spread / 2:
        warnings.append(
            f"the tolerance {limit:.4g} is above half the range {spread:.4g}: the fit will hardly show the surface"
        )
    if limit < sigma:
        warnings.append(
            f"the tolerance {limit:.4g} is below the estimated noise {sigma:.4g}: the fit will follow the noise; "
            "use noise='auto' (--noise auto) to stop there"
        )
    return warnings


def _samples_of(source: HeightMap | PointCloud | Samples, weights: ArrayLike | None, as_surface: bool) -> Samples:
    """The samples of any kind of data."""
    if isinstance(source, Samples):
        if weights is not None:
            return Samples(
                source.parameters,
                source.values,
                np.asarray(weights),
                source.frame,
                source.grid_shape,
                source.grid_index,
            )
        return source
    if isinstance(source, HeightMap):
        if as_surface:
            raise InputError("as_surface=True is for point clouds; a height map is fitted as heights")
        return source.samples(weights)
    samples = source.samples(as_surface=as_surface)
    return samples if weights is None else _samples_of(samples, weights, as_surface)


def _outliers_of(
    source: HeightMap | PointCloud | Samples, samples: Samples, as_surface: bool
) -> Bool[np.ndarray, " m"]:
    """Isolated spikes, one boolean a sample."""
    if isinstance(source, HeightMap):
        return find_outliers(source).ravel()[samples.grid_index]
    if isinstance(source, PointCloud):
        return find_outliers(source, as_surface=as_surface)
    return find_outliers(source)


def _noise_of(source: HeightMap | PointCloud | Samples, noise: Length | None, unit: str | None) -> NoiseEstimate:
    """The noise estimated from the data, or the standard deviation given."""
    if noise is None or noise == "auto":
        return estimate_noise(source)
    return NoiseEstimate(sigma=_positive(parse_length(noise, unit), "a noise standard deviation", noise))


def _positive(value: float, what: str, given: object) -> float:
    """The number, refused unless it is finite and above zero."""
    if not np.isfinite(value) or value <= 0:
        raise InputError(f"{what} is a finite number above zero; received {given!r}; use a small positive one")
    return float(value)


def _data_warnings(samples: Samples, counted: Bool[np.ndarray, " m"], robust: bool) -> list[str]:
    """Spikes and tilt: what makes a tolerance relative to the range mean something else than intended."""
    if samples.dimension != 1:
        return []
    values, places = samples.values[counted, 0].astype(np.float64), samples.parameters[counted]
    spread = np.ptp(values)
    warnings = []
    low, high = np.quantile(values, [0.001, 0.999])
    if not robust and spread > 3 * (high - low) and len(values) > 100:
        warnings.append(
            f"the range {spread:.4g} is more than three times the 0.1-99.9 % span {high - low:.4g}: spikes: "
            "use robust=True (--robust)"
        )
    if spread > 0 and len(values) > 3:
        # Squares of the best plane, from the normal equations: parameters lie between 0 and 1.
        centred, middle = (values - values.mean()) / spread, np.full(len(places), 1 / len(places)) @ places
        slope, form = places.T @ centred, places.T @ places - len(places) * np.outer(middle, middle)
        explained = slope @ np.linalg.lstsq(form, slope, rcond=None)[0]
        if explained > 0.9 * (centred @ centred):
            warnings.append("a plane explains over 90 % of the variance: tilt: level the data first (--level)")
    return warnings
