"""Tolerances as numbers, and what a user should know about them."""

from ..data import HeightMap, is_spiked, quick_noise, robust_span, tolerance_cautions
from ..fitting import resolved_limit

_NEAR_NOISE = 3.0  # standard deviations: below it a residual cannot hold the noise


def resolved_tolerance(height_map: HeightMap, tolerance: float | str | None, relative_tolerance: float | None) -> float:
    """The tolerance in the map's unit, of which one is given.

    **Raises:** `InputError` where it is not above zero, or relative to a range of zero.

    >>> resolved_tolerance(HeightMap([[0.0, 4.0]], unit="µm"), None, 0.25)
    1.0
    """
    return resolved_limit(tolerance, relative_tolerance, height_map.range, height_map.unit)


def tolerance_warnings(height_map: HeightMap, tolerance: float, *, relative: bool, what: str) -> tuple[str, ...]:
    """What the map gives reason to say; `what` would follow the noise."""
    spread = height_map.range
    warnings = tolerance_cautions(
        tolerance,
        spread,
        quick_noise(height_map),
        result=what,
        remedy="relax the tolerance, or leave it out",
        deviations=_NEAR_NOISE,
    )
    if relative and is_spiked(spread, robust_span(height_map.heights[height_map.valid])):
        warnings.append("spikes stretch the range that the tolerance is a share of; give it as a length, or mask them")
    return tuple(warnings)
