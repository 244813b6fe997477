"""Tolerances as numbers, and what a user should know about them."""

import numpy as np

from .._errors import InputError
from ..data import HeightMap, parse_length, quick_noise

_NEAR_NOISE = 3.0  # standard deviations: below it a residual cannot hold the noise
_SPIKED = 3.0


def resolved_tolerance(height_map: HeightMap, tolerance: float | str | None, relative_tolerance: float | None) -> float:
    """The tolerance in the map's unit, of which one is given.

    **Raises:** `InputError` where it is not above zero, or relative to a range of zero.

    >>> resolved_tolerance(HeightMap([[0.0, 4.0]], unit="µm"), None, 0.25)
    1.0
    """
    if tolerance is not None:
        value = parse_length(tolerance, height_map.unit)
    else:
        value = float(relative_tolerance or 0.0) * height_map.range
    if not np.isfinite(value) or value <= 0:
        given = relative_tolerance if tolerance is None else tolerance
        raise InputError(f"a tolerance is above zero, and relative only to a range above zero; received {given!r}")
    return value


def tolerance_warnings(height_map: HeightMap, tolerance: float, *, relative: bool, what: str) -> tuple[str, ...]:
    """What the map gives reason to say; `what` would follow the noise."""
    warnings = []
    spread, noise = height_map.range, quick_noise(height_map)
    if tolerance > spread / 2 > 0:
        warnings.append(
            f"the tolerance {tolerance:.4g} is above half the range {spread:.4g}: {what} will hardly show the surface"
        )
    if tolerance < _NEAR_NOISE * noise:
        warnings.append(
            f"the tolerance {tolerance:.4g} is below three times the estimated noise {noise:.4g}: {what} will follow "
            "the noise; relax the tolerance, or leave it out"
        )
    heights = height_map.heights[height_map.valid].astype(np.float64)
    if relative and spread > _SPIKED * float(np.ptp(np.quantile(heights, [0.001, 0.999]))):
        warnings.append("spikes stretch the range that the tolerance is a share of; give it as a length, or mask them")
    return tuple(warnings)
