"""Hybrid parameters: the root mean square gradient Sdq and the developed area Sdr (ISO 25178-2:2021, 4.4)."""

from collections.abc import Sequence
from functools import partial
from typing import Literal, NamedTuple, get_args

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .._errors import InputError
from ._measured import Measured, checked, measured, root

Stencil = Literal["differences", "seven-point"]

#: Weights of the heights 1, 2 and 3 pixels ahead, less those behind (ISO 4287:1997, 3.2.9).
_SEVEN_POINT = (45 / 60, -9 / 60, 1 / 60)


class HybridParameters(NamedTuple):
    """Sdq, a slope without unit, and Sdr in %."""

    Sdq: Float[Array, ""]
    Sdr: Float[Array, ""]


def hybrid_parameters(
    heights: Float[ArrayLike, "rows columns"],
    spacing: tuple[float, float],
    weights: Float[ArrayLike, "rows columns"] | None = None,
    *,
    stencil: Stencil = "differences",
) -> HybridParameters:
    """Root mean square gradient and developed interfacial area ratio of a map.

    Sdq² = ⟨(∂z/∂x)² + (∂z/∂y)²⟩ and Sdr = ⟨√(1 + (∂z/∂x)² + (∂z/∂y)²) - 1⟩ (ISO 25178-2:2021, 4.4), with derivatives
    from complete stencils only: none reaches across a missing pixel or beyond the border.

    **Arguments:**

    - `heights`: (rows, columns), NaN is missing, in the unit of the spacing.
    - `spacing`: (dx, dy), along columns and along rows.
    - `weights`: (rows, columns), not negative.
    - `stencil`: `"differences"` of neighbours: Sdq from all pairs, Sdr from the four triangles at the corners of each
      cell of 2 × 2 pixels (ISO 25178-2:2021, Annex D). Of a shallow wave of length λ this misses the part
      (π dx / λ)² / 3 in Sdr and half of that in Sdq. `"seven-point"` is of sixth order (ISO 4287:1997, 3.2.9), but
      needs three pixels on all four sides and so leaves out more around missing ones.

    **Returns:** `HybridParameters`, NaN where no stencil is complete. Differentiable; works under `jit` and `vmap`.

    **Raises:** `InputError` for heights or weights that do not fit, and an unknown stencil.

    >>> ramp = 0.75 * jnp.arange(4.0) * jnp.ones((3, 1))
    >>> sdq, sdr = hybrid_parameters(ramp, (1.0, 1.0))
    >>> round(float(sdq), 6), round(float(sdr), 6)
    (0.75, 25.0)
    """
    if stencil not in get_args(Stencil):
        raise InputError(f"stencil is one of {', '.join(map(repr, get_args(Stencil)))}, but got {stencil!r}")
    array, chosen = checked(heights, weights, dimensions=(2,))
    return _hybrid_parameters(array, spacing, chosen, stencil=stencil)


@partial(jax.jit, static_argnames="stencil")
def _hybrid_parameters(
    heights: Array, spacing: Sequence[Array], weights: Array | None, *, stencil: Stencil
) -> HybridParameters:
    samples = measured(heights, weights)
    slopes = (samples.scale / spacing[0], samples.scale / spacing[1])
    squares, areas = (_from_differences if stencil == "differences" else _from_seven_points)(samples, slopes)
    return HybridParameters(root(squares), 100 * areas)


def _from_differences(samples: Measured, slopes: tuple[Array, Array]) -> tuple[Array, Array]:
    """Mean squared gradient over all pairs, mean excess of area over the triangles at the corners of the cells."""
    z, w = samples.heights, jnp.where(samples.present, samples.weights, jnp.nan)
    along_x, along_y = (z[:, 1:] - z[:, :-1]) * slopes[0], (z[1:] - z[:-1]) * slopes[1]
    squares = _mean(along_x**2, (w[:, 1:] + w[:, :-1]) / 2) + _mean(along_y**2, (w[1:] + w[:-1]) / 2)
    sums = jnp.zeros(2, z.dtype)
    # A triangle has a corner, its neighbour along x and its neighbour along y.
    ahead, behind = slice(1, None), slice(None, -1)
    for row, other_row in ((behind, ahead), (ahead, behind)):
        for column, other_column in ((behind, ahead), (ahead, behind)):
            gradient = along_x[row] ** 2 + along_y[:, column] ** 2
            weight = (w[row, column] + w[row, other_column] + w[other_row, column]) / 3
            sums += jnp.stack(_sums(_excess(gradient), weight))
    return squares, sums[0] / sums[1]


def _from_seven_points(samples: Measured, slopes: tuple[Array, Array]) -> tuple[Array, Array]:
    """Mean squared gradient and mean excess of area over the pixels with three neighbours on all sides."""
    z, present = samples.heights, samples.present
    rows, columns = z.shape
    if min(rows, columns) < 7:
        nothing = jnp.full((), jnp.nan, z.dtype)
        return nothing, nothing

    def shifted(array: Array, down: int, right: int) -> Array:
        return array[3 + down : rows - 3 + down, 3 + right : columns - 3 + right]

    complete = shifted(present, 0, 0)
    along_x, along_y = jnp.zeros((2, rows - 6, columns - 6), z.dtype)
    for distance, factor in enumerate(_SEVEN_POINT, start=1):
        along_x += factor * (shifted(z, 0, distance) - shifted(z, 0, -distance))
        along_y += factor * (shifted(z, distance, 0) - shifted(z, -distance, 0))
        for side in (distance, -distance):
            complete &= shifted(present, 0, side) & shifted(present, side, 0)
    gradient = (along_x * slopes[0]) ** 2 + (along_y * slopes[1]) ** 2
    weight = jnp.where(complete, shifted(samples.weights, 0, 0), jnp.nan)
    return _mean(gradient, weight), _mean(_excess(gradient), weight)


def _excess(gradient: Array) -> Array:
    """√(1 + g²) - 1 of g², without cancellation."""
    return gradient / (1 + jnp.sqrt(1 + gradient))


def _sums(values: Array, weights: Array) -> tuple[Array, Array]:
    """Sums of weighted values and of weights, where the weight is not NaN."""
    weights = jnp.where(jnp.isnan(weights), 0, weights)
    return jnp.sum(weights * values), jnp.sum(weights)


def _mean(values: Array, weights: Array) -> Array:
    total, weight = _sums(values, weights)
    return total / weight
