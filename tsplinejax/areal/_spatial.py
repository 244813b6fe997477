"""Spatial parameters: Sal, Str and Std (ISO 25178-2:2021, 4.3).

All three look at a picture with the origin in its middle along rays: Sal and Str at the autocorrelation, along the ray
until it falls to the threshold; Std at the power spectrum, summed along the ray. Directions are those of the
physical plane, angles from x towards y; both pictures are symmetric, so half a turn is enough.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.lax import stop_gradient
from jaxtyping import Array, ArrayLike, Float

from .._errors import InputError
from ._autocorrelation import autocorrelation
from ._measured import checked, measured

#: Rays over half a turn, how many of the refined ones lie on each side of the best, and how often it is refined.
_RAYS, _FINER, _ROUNDS = 720, 8, 2
#: The pixels about a place, by which a picture is interpolated, and how far each is from each.
_NODES = np.arange(-2, 4, dtype=np.int32)
_APART = _NODES[:, None] - _NODES
_ON_LINE = 1e-4  # a place this part of a pixel from a line of pixels lies on it


class SpatialParameters(NamedTuple):
    """Sal in the unit of the spacing, Str, and Std in degrees."""

    Sal: Float[Array, ""]
    Str: Float[Array, ""]
    Std: Float[Array, ""]


def spatial_parameters(
    heights: Float[ArrayLike, "rows columns"],
    spacing: tuple[float, float],
    weights: Float[ArrayLike, "rows columns"] | None = None,
    *,
    threshold: float = 0.2,
) -> SpatialParameters:
    """Autocorrelation length, texture aspect ratio and texture direction of a map.

    Sal is the shortest, Sal / Str the longest distance at which the autocorrelation, followed from the origin along a
    straight line, falls to the threshold (ISO 25178-2:2021, 4.3). It is not circular: the mean product over the pairs
    of pixels that lie a lag apart and are both present, over the mean square; lags reach half the extent in x and y,
    and need a twentieth of the pairs of lag zero. Std is the direction of the lay: at right angles to that in which the
    angular power spectrum, ∫ r F(r cos φ, r sin φ) dr, is largest, F being the transform of the autocorrelation under a
    Hann window. (Amplitudes in the place of powers lose a lay in noise of half its height.)

    **Arguments:**

    - `heights`: (rows, columns), NaN is missing.
    - `spacing`: (dx, dy), along columns and along rows.
    - `weights`: (rows, columns), not negative.
    - `threshold`: s, between 0 and 1.

    **Returns:** `SpatialParameters`. Sal is NaN if the autocorrelation never falls to the threshold, Str if it does
    not in some direction, as along grooves. Std is in [0, 180), from x (columns) towards y (rows). Sal and Str are
    differentiable; works under `jit` and `vmap`.

    **Raises:** `InputError` for heights or weights that do not fit, and a threshold out of range.

    >>> x, y = jnp.arange(200.0), jnp.arange(100.0)[:, None]
    >>> sal, _, std = spatial_parameters(jnp.sin(2 * jnp.pi * x / 20) + 0 * y, (1.0, 1.0))
    >>> round(float(sal), 1), round(float(std))
    (4.4, 90)
    """
    if not 0 < threshold < 1:
        raise InputError(f"the threshold of the autocorrelation lies between 0 and 1, but got {threshold}")
    array, chosen = checked(heights, weights, dimensions=(2,))
    return _spatial_parameters(array, spacing, chosen, threshold)


@jax.jit
def _spatial_parameters(
    heights: Array, spacing: tuple[Array, Array], weights: Array | None, threshold: Array
) -> SpatialParameters:
    correlation = autocorrelation(measured(heights, weights))
    held = stop_gradient(correlation)
    length = partial(_length, held, spacing, threshold)
    lengths = jax.vmap(length)(_directions(heights.dtype))

    def extreme(sign: Array) -> Array:
        angle = _best_direction(lambda angle: sign * length(angle), sign * lengths)
        return _length(correlation, spacing, threshold, angle)

    shortest, longest = jax.vmap(extreme)(jnp.array([-1, 1]))
    reached = jnp.all(jnp.isfinite(lengths)) & jnp.isfinite(longest)
    return SpatialParameters(
        Sal=jnp.where(jnp.isfinite(shortest), shortest, jnp.nan),
        Str=jnp.where(reached, shortest / longest, jnp.nan),
        Std=_lay(held, spacing),
    )


def _directions(dtype: jnp.dtype) -> Array:
    return jnp.pi / _RAYS * jnp.arange(_RAYS, dtype=dtype)


def _best_direction(value_of: Callable[[Array], Array], values: Array) -> Array:
    """The direction with the largest value: the best of all rays, refined about it; `values` are those of the rays."""
    angles = _directions(values.dtype)
    best = angles[jnp.argmax(values)]
    offsets = jnp.linspace(-1, 1, 2 * _FINER + 1, dtype=values.dtype)

    def refined(best: Array, width: Array) -> tuple[Array, None]:
        nearby = best + width * offsets
        return nearby[jnp.argmax(jax.vmap(value_of)(nearby))], None

    widths = angles[1] / _FINER ** jnp.arange(_ROUNDS, dtype=values.dtype)
    return jax.lax.scan(refined, best, widths)[0]


def _length(
    correlation: Float[Array, "lags_y lags_x"], spacing: tuple[Array, Array], threshold: Array, angle: Array
) -> Float[Array, ""]:
    """How far along a ray the autocorrelation first falls to the threshold; infinite if it ends before."""
    pitch, step = _half_pixel(spacing, angle)
    count = max(correlation.shape)
    bracket = ~(_along(correlation, step * jnp.arange(1, count)[:, None]) > threshold)  # the ray's end is NaN
    before = jnp.argmax(bracket)
    places = before + jnp.linspace(0, 1, _FINER + 1, dtype=correlation.dtype)
    values = _along(correlation, step * places[:, None])
    after = jnp.maximum(jnp.argmax(values <= threshold), 1)
    high, low = values[after - 1], values[after]
    part = (high - threshold) / (high - low)
    return jnp.where(low <= threshold, pitch * (places[after - 1] + part / _FINER), jnp.inf)


def _lay(correlation: Float[Array, "lags_y lags_x"], spacing: tuple[Array, Array]) -> Float[Array, ""]:
    """The direction of the lay in degrees."""
    rows, columns = correlation.shape
    window = jnp.outer(jnp.hanning(rows + 2)[1:-1], jnp.hanning(columns + 2)[1:-1]).astype(correlation.dtype)
    power = jnp.fft.fft2(jnp.fft.ifftshift(jnp.where(jnp.isnan(correlation), 0, window * correlation))).real
    power = jnp.fft.fftshift(jnp.maximum(power, 0))
    frequency = (1 / (columns * spacing[0]), 1 / (rows * spacing[1]))

    # Up to the ellipse that touches the border, a circle for square pixels: corners would favour the diagonals.
    semiaxes = jnp.array([rows // 2 - 3, columns // 2 - 3], power.dtype)

    def summed(angle: Array) -> Array:
        pitch, step = _half_pixel(frequency, angle)
        places = jnp.arange(max(power.shape))
        within = places * jnp.linalg.norm(step / semiaxes) <= 1
        return pitch**2 * jnp.nansum(places * jnp.where(within, _along(power, step * places[:, None]), 0))

    values = jax.vmap(summed)(_directions(correlation.dtype))
    across = jnp.degrees(_best_direction(summed, values))
    return jnp.where(jnp.all(jnp.isnan(correlation)), jnp.nan, (across + 90) % 180)


def _half_pixel(spacing: tuple[Array, Array], angle: Array) -> tuple[Array, Array]:
    """The length of a step of half a pixel in the larger of rows and columns, and the step (down, right) in pixels."""
    right, down = jnp.cos(angle) / spacing[0], jnp.sin(angle) / spacing[1]
    pitch = 0.5 / jnp.maximum(jnp.abs(right), jnp.abs(down))
    return pitch, pitch * jnp.stack([down, right])


def _along(picture: Float[Array, "rows columns"], steps: Float[Array, "m 2"]) -> Float[Array, " m"]:
    """The picture at places (down, right) from its middle, NaN beyond.

    Polynomials of fifth degree through 6 × 6 pixels, kept between those that surround the place: where those lie
    above a threshold, so does what is between them, however sharp the peak of noise at lag zero.
    """
    rows, columns = picture.shape
    place = steps + jnp.array([rows // 2, columns // 2], steps.dtype)
    corner = jnp.floor(place)
    row, column = corner.astype(jnp.int32).T
    inside = (row >= 2) & (row < rows - 3) & (column >= 2) & (column < columns - 3)
    row, column = (jnp.where(inside, index, 2)[:, None, None] for index in (row, column))
    values = picture[row + _NODES[:, None], column + _NODES]
    parts = (place - corner).T
    down, right = (_polynomials(part) for part in parts)
    value = jnp.sum(down[:, :, None] * right[:, None, :] * values, axis=(1, 2))
    # On a line of pixels the neighbours on both sides surround the place: the picture's mirror image gives the same.
    above, beside = (jnp.abs(part[:, None] - _NODES) <= 1 + _ON_LINE for part in parts)
    around = above[:, :, None] & beside[:, None, :]
    least = jnp.min(jnp.where(around, values, jnp.inf), axis=(1, 2))
    most = jnp.max(jnp.where(around, values, -jnp.inf), axis=(1, 2))
    return jnp.where(inside, jnp.clip(value, least, most), jnp.nan)


def _polynomials(t: Float[Array, " m"]) -> Float[Array, "m 6"]:
    """Lagrange's polynomials of the nodes about a place t of the way from the third to the fourth."""
    factors = (t[:, None, None] - _NODES) / np.where(_APART == 0, 1, _APART)
    return jnp.prod(jnp.where(_APART == 0, 1, factors), axis=2)
