"""The samples that count: heights about their weighted mean, scaled to about one, and their weights.

Missing samples keep their place, with height and weight zero, so shapes do not depend on how many there are.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.lax import stop_gradient
from jaxtyping import Array, ArrayLike, Bool, Float

from .._errors import InputError


class Measured(NamedTuple):
    """Heights about their mean in units of `scale`, weights of at most one, and what heights are multiplied by."""

    heights: Float[Array, "*shape"]
    weights: Float[Array, "*shape"]
    scale: Float[Array, ""]

    @property
    def present(self) -> Bool[Array, "*shape"]:
        """True where a sample counts."""
        return self.weights > 0

    def mean(self, values: Float[Array, "*shape"]) -> Float[Array, ""]:
        """The weighted mean of one value per sample; NaN where nothing counts."""
        return jnp.sum(self.weights * values) / jnp.sum(self.weights)


def checked(
    heights: Float[ArrayLike, "*shape"], weights: Float[ArrayLike, "*shape"] | None, *, dimensions: Sequence[int] = ()
) -> tuple[Array, Array | None]:
    """Heights and weights as floating-point device arrays, or an error.

    **Arguments:**

    - `heights`: real numbers; NaN is missing.
    - `weights`: of the same shape, finite, not negative; `None` is one everywhere.
    - `dimensions`: how many the heights may have; any number by default.

    **Raises:** `InputError` for anything else. Values that are traced are not looked at.
    """
    array = _floating(heights, "heights")
    if dimensions and array.ndim not in dimensions:
        raise InputError(
            f"these parameters need heights over a grid, (rows, columns), but got an array of shape {array.shape}"
        )
    if not array.size:
        raise InputError(f"areal parameters need at least one height, but got an empty array of shape {array.shape}")
    if not isinstance(array, Tracer) and bool(jnp.isinf(array).any()):
        raise InputError("heights must be finite or NaN (missing), but some are infinite; make them NaN")
    if weights is None:
        return array, None
    chosen = _floating(weights, "weights").astype(array.dtype)
    if chosen.shape != array.shape:
        raise InputError(f"weights must have the shape of the heights, {array.shape}, but got {chosen.shape}")
    if not isinstance(chosen, Tracer) and not bool((jnp.isfinite(chosen) & (chosen >= 0)).all()):
        raise InputError("weights must be finite and not negative; a missing sample has the height NaN or the weight 0")
    return array, chosen


def _floating(values: ArrayLike, what: str) -> Array:
    if not isinstance(values, jax.Array) and np.asarray(values).dtype.kind not in "iuf":
        raise InputError(f"{what} are real numbers, but got {np.asarray(values).dtype}; convert them first")
    array = jnp.asarray(values)
    return array if jnp.issubdtype(array.dtype, jnp.floating) else array.astype(float)


def measured(heights: Float[Array, "*shape"], weights: Float[Array, "*shape"] | None) -> Measured:
    """Remove the weighted mean of what is present, and scale.

    The scales are constants to a derivative: every parameter is homogeneous in them. They keep fourth powers of heights
    in metres within single precision.
    """
    present = ~jnp.isnan(heights)
    if weights is None:
        weights = present.astype(heights.dtype)
    else:
        present &= weights > 0
        weights = jnp.where(present, weights / stop_gradient(_positive(jnp.max(weights))), 0)
    heights = jnp.where(present, heights, 0)
    total = jnp.sum(weights)
    for _ in range(2):  # the second time for what rounding left of a large offset
        heights = jnp.where(present, heights - jnp.sum(weights * heights) / total, 0)
    scale = stop_gradient(_positive(jnp.max(jnp.abs(heights))))
    return Measured(heights / scale, weights, scale)


def _positive(value: Array) -> Array:
    """The value, or one where it is zero."""
    return jnp.where(value > 0, value, 1)


def root(value: Array) -> Array:
    """The square root, whose derivative at zero is zero instead of infinite."""
    return jnp.where(value > 0, jnp.sqrt(jnp.where(value > 0, value, 1)), value)


def ratio(numerator: Array, denominator: Array, otherwise: float) -> Array:
    """The quotient, or `otherwise` where the denominator is zero."""
    return jnp.where(denominator == 0, otherwise, numerator / jnp.where(denominator == 0, 1, denominator))
