"""Two unknowns a point: symmetric 2 × 2 matrices as rows (a, b, c), and parameters that the border holds."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


def held(parameters: Float[Array, "m 2"], gradient: Float[Array, "m 2"]) -> Bool[Array, "m 2"]:
    """Parameters on the border of the square that descent along the gradient would push out of it."""
    return ((parameters <= 0) & (gradient > 0)) | ((parameters >= 1) & (gradient < 0))


def invert_two(form: Float[Array, "*m 3"], fixed: Bool[Array, "*m 2"]) -> Float[Array, "*m 3"]:
    """Inverses of symmetric 2 × 2 matrices (a, b, c), zero in the fixed unknowns; finite where they are singular."""
    a, c = (jnp.where(fixed[..., k], 1, form[..., 2 * k]) for k in range(2))
    b = jnp.where(fixed[..., 0] | fixed[..., 1], 0, form[..., 1])
    floor = jnp.maximum(jnp.finfo(form.dtype).eps * a * c, jnp.finfo(form.dtype).tiny)
    inverse = jnp.stack([c, -b, a], axis=-1) / jnp.maximum(a * c - b * b, floor)[..., None]
    free = ~fixed
    return inverse * jnp.stack([free[..., 0], free[..., 0] & free[..., 1], free[..., 1]], axis=-1)


def multiply_two(form: Float[Array, "*m 3"], load: Float[Array, "*m 2"]) -> Float[Array, "*m 2"]:
    """Products of symmetric 2 × 2 matrices (a, b, c) and vectors."""
    return form[..., :2] * load[..., :1] + form[..., 1:] * load[..., 1:]
