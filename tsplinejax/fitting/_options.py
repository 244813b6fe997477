"""What a caller asks of a fit, checked and turned into numbers in the data's unit."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import ArrayLike, Bool

from .._errors import InputError
from ..data import (
    HeightMap,
    NoiseEstimate,
    PointCloud,
    Samples,
    as_data,
    estimate_noise,
    find_outliers,
    parse_length,
    quick_noise,
)

Length = float | str


@dataclass(frozen=True, eq=False)
class Request:
    """The data and the criterion of a fit.

    **Attributes:**

    - `samples`, `outliers`: what is fitted and which samples are set aside.
    - `range`: max - min of the inliers, or the diagonal of their box for points in space.
    - `tolerance`: in the data's unit, or `None` for a fit to noise.
    - `noise`: what is known of the noise, or `None`.
    - `robust`: whether outliers were looked for.
    - `warnings`: what the data give reason to say.
    """

    samples: Samples
    outliers: Bool[np.ndarray, " m"]
    range: float
    tolerance: float | None
    noise: NoiseEstimate | None
    robust: bool
    warnings: tuple[str, ...]


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
    if sum(option is not None for option in (tolerance, relative_tolerance, noise)) > 1:
        raise InputError("give at most one of tolerance, relative_tolerance and noise; several were given")
    source = data if isinstance(data, Samples) else as_data(data)
    samples = _samples_of(source, weights, as_surface)
    outliers = _outliers_of(source, samples, as_surface) if robust else np.zeros(len(samples), bool)
    counted = ~outliers if samples.weights is None else ~outliers & (samples.weights > 0)
    if not counted.any():
        raise InputError("no sample is left to fit: all have weight 0 or are outliers; check the weights")
    values = samples.values[counted].astype(np.float64)
    spread = float(np.linalg.norm(np.ptp(values, axis=0)))
    unit = samples.frame.unit
    warnings = list(_data_warnings(samples, counted, robust))
    if tolerance is not None:
        limit = _positive(parse_length(tolerance, unit), "a tolerance", tolerance)
    elif relative_tolerance is not None:
        if spread == 0:
            raise InputError(
                "a relative tolerance is a share of the range, but this surface is constant (range 0); give tolerance="
            )
        limit = _positive(relative_tolerance, "a relative tolerance", relative_tolerance) * spread
    else:
        estimate = _noise_of(source, samples, noise, unit)
        if estimate.texture_limited:
            warnings.append(estimate.note)
        return Request(samples, outliers, spread, None, estimate, robust, tuple(warnings))
    if spread > 0 and limit > spread / 2:
        warnings.append(
            f"the tolerance {limit:.4g} is above half the range {spread:.4g}: the fit will hardly show the surface"
        )
    sigma = quick_noise(source) if samples.dimension == 1 else 0.0
    if limit < sigma:
        warnings.append(
            f"the tolerance {limit:.4g} is below the estimated noise {sigma:.4g}: the fit will follow the noise; "
            "use noise='auto' (--noise auto) to stop there"
        )
    return Request(samples, outliers, spread, limit, None, robust, tuple(warnings))


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


def _noise_of(
    source: HeightMap | PointCloud | Samples, samples: Samples, noise: Length | None, unit: str | None
) -> NoiseEstimate:
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
        columns = np.column_stack([np.ones(len(values)), places])
        centred = (values - values.mean()) / spread
        plane = columns @ np.linalg.lstsq(columns, centred, rcond=None)[0]
        if np.var(plane) > 0.9 * np.var(centred):
            warnings.append("a plane explains over 90 % of the variance: tilt: level the data first (--level)")
    return warnings
