"""Height parameters: Sq, Sa, Sz, Sp, Sv, Ssk and Sku (ISO 25178-2:2021, 4.2)."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from ._measured import checked, measured, ratio, root


class HeightParameters(NamedTuple):
    """Height parameters, in the heights' unit; Ssk and Sku have none."""

    Sq: Float[Array, ""]
    Sa: Float[Array, ""]
    Sz: Float[Array, ""]
    Sp: Float[Array, ""]
    Sv: Float[Array, ""]
    Ssk: Float[Array, ""]
    Sku: Float[Array, ""]


def height_parameters(
    heights: Float[ArrayLike, "*shape"], weights: Float[ArrayLike, "*shape"] | None = None
) -> HeightParameters:
    """Height parameters of a map or of scattered samples, about the weighted mean of what is present.

    Sq² = ⟨z²⟩, Sa = ⟨|z|⟩, Sp = max z, Sv = -min z, Sz = Sp + Sv, Ssk = ⟨z³⟩ / Sq³, Sku = ⟨z⁴⟩ / Sq⁴
    (ISO 25178-2:2021, 4.2).

    **Arguments:**

    - `heights`: any shape; NaN is missing.
    - `weights`: of the same shape, not negative: the area that each sample stands for. By default all are equal.

    **Returns:** `HeightParameters`; NaN where nothing is present, and Ssk and Sku of equal heights are NaN.
    Differentiable with respect to heights and weights; works under `jit` and `vmap`.

    **Raises:** `InputError` for heights that are infinite or no real numbers, and weights that do not fit.

    >>> parameters = height_parameters([3.0, -1.0, float("nan"), -1.0, -1.0])
    >>> round(float(parameters.Sa), 6), round(float(parameters.Sz), 6), round(float(parameters.Sku), 6)
    (1.5, 4.0, 2.333333)
    """
    return _height_parameters(*checked(heights, weights))


@jax.jit
def _height_parameters(heights: Array, weights: Array | None) -> HeightParameters:
    samples = measured(heights, weights)
    z, scale = samples.heights, samples.scale
    variance = samples.mean(z**2)
    deviation = root(variance)
    missing = jnp.where(jnp.any(samples.present), 0.0, jnp.nan)
    top, bottom = (jnp.max(jnp.where(samples.present, side, -jnp.inf)) + missing for side in (z, -z))
    return HeightParameters(
        Sq=scale * deviation,
        Sa=scale * samples.mean(jnp.abs(z)),
        Sz=scale * (top + bottom),
        Sp=scale * top,
        Sv=scale * bottom,
        Ssk=ratio(samples.mean(z**3), deviation**3, jnp.nan),
        Sku=ratio(samples.mean(z**4), variance**2, jnp.nan),
    )
