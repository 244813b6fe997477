"""How much of a wave a filter lets through: measured, for any filter, from sines of known length and amplitude."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from .._errors import InputError
from ..data import HeightMap

_PERIODS, _FEWEST_PIXELS = 2, 16  # of the part of a map on which a wave is measured


@dataclass(frozen=True, eq=False, repr=False)
class Transmission:
    """Measured transmission of a filter.

    **Attributes:**

    - `wavelengths`: (w,), in `unit`; `amplitudes`: (a,), in `unit`.
    - `directions`: (d,), of the waves, in degrees from x towards y; `phases`: (p,), in radians.
    - `ratios`: (a, w, d, p), the part of each wave that is let through in phase.
    - `unit`: of the lengths, or `None`.
    """

    wavelengths: Float[np.ndarray, " w"]
    amplitudes: Float[np.ndarray, " a"]
    directions: Float[np.ndarray, " d"]
    phases: Float[np.ndarray, " p"]
    ratios: Float[np.ndarray, "a w d p"]
    unit: str | None

    @property
    def mean(self) -> Float[np.ndarray, "a w"]:
        """The mean over directions and phases."""
        return self.ratios.mean(axis=(2, 3))

    def __repr__(self) -> str:
        a, w, d, p = self.ratios.shape
        return f"Transmission({w} wavelengths × {a} amplitudes, {d} directions, {p} phases)"


def transmission(
    filter: Callable[[HeightMap], Any],
    wavelengths: ArrayLike,
    amplitudes: ArrayLike = 1.0,
    *,
    spacing: float | Sequence[float] | None = None,
    unit: str | None = "mm",
    directions: ArrayLike = (0.0, 30.0, 45.0, 90.0),
    phases: int = 8,
    margin: float | None = None,
) -> Transmission:
    """Measure what a filter lets through of sines, away from the borders of the map.

    Each wave A sin(k · x + φ) is filtered on a map of its own; the part in phase of what comes back, fitted by least
    squares where the borders are far, over A is its ratio. A linear filter has one curve; that of a non-linear one
    depends on the amplitude.

    **Arguments:**

    - `filter`: from a `HeightMap` to a `HeightMap` (or a `Filtered`): `lambda m: tsj.filter(m, cutoff=0.8)`.
    - `wavelengths`, `amplitudes`: above zero, in `unit`.
    - `spacing`: (dx, dy) of the maps, or one number; by default a quarter of the shortest wave. No wave may be shorter
      than two pixels.
    - `unit`: of all lengths.
    - `directions`: in degrees from x towards y.
    - `phases`: how many, evenly spread over a period.
    - `margin`: width of the border that is left out, by default half of the longest wave; at least a cut-off is wise.

    **Returns:** a [`Transmission`][tsplinejax.Transmission].

    **Raises:** `InputError` for lengths that are not positive, waves shorter than two pixels, and a filter that returns
    a map of another shape.

    >>> import tsplinejax as tsj
    >>> curve = transmission(lambda m: tsj.filter(m, cutoff=8.0), [8.0], spacing=1.0, margin=16.0, phases=2)
    >>> round(float(curve.mean[0, 0]), 2)
    0.5
    """
    lengths, heights = (
        _positive(values, name) for values, name in ((wavelengths, "wavelengths"), (amplitudes, "amplitudes"))
    )
    steps = np.broadcast_to(lengths.min() / 4 if spacing is None else np.asarray(spacing, float), (2,))
    if not (steps > 0).all() or lengths.min() < 2 * steps.max() * (1 - 1e-9):
        raise InputError(
            f"the shortest wave is two pixels long at least; received {lengths.min():g} with a spacing of {spacing!r}"
        )
    angles = np.atleast_1d(np.asarray(directions, float))
    starts = 2 * np.pi * np.arange(phases) / phases
    border = lengths.max() / 2 if margin is None else float(margin)
    ratios = np.empty((len(heights), len(lengths), len(angles), len(starts)))
    for index in np.ndindex(ratios.shape):
        places = zip((heights, lengths, angles, starts), index, strict=True)
        amplitude, length, angle, start = (float(values[k]) for values, k in places)
        ratios[index] = _ratio(filter, amplitude, length, angle, start, (steps[0], steps[1]), border, unit)
    return Transmission(lengths, heights, angles, starts, ratios, unit)


def _positive(values: ArrayLike, name: str) -> Float[np.ndarray, " k"]:
    array = np.atleast_1d(np.asarray(values, float))
    if array.ndim != 1 or not array.size or not (np.isfinite(array) & (array > 0)).all():
        raise InputError(f"{name} are numbers above zero; received {values!r}")
    return array


def _ratio(
    filter: Callable[[HeightMap], Any],
    amplitude: float,
    wavelength: float,
    direction: float,
    phase: float,
    spacing: tuple[float, float],
    border: float,
    unit: str | None,
) -> float:
    """The part of one wave that is let through."""
    skipped = [int(np.ceil(border / step)) for step in spacing]
    seen = [max(_FEWEST_PIXELS, int(np.ceil(_PERIODS * wavelength / step))) for step in spacing]
    columns, rows = (2 * left_out + kept for left_out, kept in zip(skipped, seen, strict=True))
    x, y = (np.arange(count) * step for count, step in zip((columns, rows), spacing, strict=True))
    angle = np.deg2rad(direction)
    argument = 2 * np.pi / wavelength * (np.cos(angle) * x[None, :] + np.sin(angle) * y[:, None]) + phase
    wave = np.sin(argument)
    result = filter(HeightMap(amplitude * wave, spacing, unit))
    heights = np.asarray(getattr(result, "filtered", result).heights)
    if heights.shape != wave.shape:
        raise InputError(f"a filter returns a map of the same shape; received {heights.shape} for {wave.shape}")
    window = (slice(skipped[1], rows - skipped[1]), slice(skipped[0], columns - skipped[0]))
    parts = [wave[window].ravel(), np.cos(argument[window]).ravel(), np.ones(wave[window].size)]
    return float(np.linalg.lstsq(np.stack(parts, axis=1), heights[window].ravel(), rcond=None)[0][0]) / amplitude
