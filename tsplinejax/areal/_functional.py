"""Functional parameters: the material ratio curve, the Sk family and volumes (ISO 25178-2:2021, 4.5).

The material ratio curve is the heights in falling order over the share of the area that lies at least as high. It is
exact: a sample stands for the interval of ratios that its weight occupies. Areas under the curve are sums over those
intervals; between the middles of two intervals the height is interpolated.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.lax import stop_gradient
from jaxtyping import Array, ArrayLike, Float

from .._errors import InputError
from ._measured import checked, measured, ratio

#: The central region's share of the material ratio (ISO 25178-2:2021; ISO 13565-2), the places tried for its start,
#: and how much two drops may differ and count as equal: by what sampling does to a symmetric curve.
_CORE = 0.4
_STARTS = (1 << 14) + 1
_EQUAL = 1e-4


class FunctionalParameters(NamedTuple):
    """Sk family, Smc and volumes per area in the heights' unit; Smr1, Smr2 and Smr in %."""

    Sk: Float[Array, ""]
    Spk: Float[Array, ""]
    Svk: Float[Array, ""]
    Smr1: Float[Array, ""]
    Smr2: Float[Array, ""]
    Smr: Float[Array, ""]
    Smc: Float[Array, ""]
    Vmp: Float[Array, ""]
    Vmc: Float[Array, ""]
    Vvc: Float[Array, ""]
    Vvv: Float[Array, ""]


class _Curve(NamedTuple):
    """The material ratio curve: falling heights, each over the ratios from `start` to `end`."""

    heights: Float[Array, " n"]
    start: Float[Array, " n"]
    end: Float[Array, " n"]

    def height_at(self, ratios: Array) -> Array:
        return jnp.interp(ratios, (self.start + self.end) / 2, self.heights)

    def ratio_at(self, height: Array) -> Array:
        return jnp.interp(-height, -self.heights, (self.start + self.end) / 2, left=0.0, right=1.0)

    def material_above(self, height: Array) -> Array:
        return jnp.sum((self.end - self.start) * jnp.maximum(self.heights - height, 0))

    def void_below(self, height: Array) -> Array:
        return jnp.sum((self.end - self.start) * jnp.maximum(height - self.heights, 0))


def functional_parameters(
    heights: Float[ArrayLike, "*shape"],
    weights: Float[ArrayLike, "*shape"] | None = None,
    *,
    cut_height: Float[ArrayLike, ""] = 0.0,
    material_ratio: Float[ArrayLike, ""] = 10.0,
    volume_ratios: tuple[float, float] = (10.0, 80.0),
    ordered: bool = False,
) -> FunctionalParameters:
    """Parameters of the material ratio curve of a map or of scattered samples.

    The core is the least-squares line over the 40 % of the curve whose secant falls least, the first of equals. Sk is
    its drop from 0 to 100 %, Smr1 and Smr2 are the ratios at its ends, Spk and Svk the heights of the triangles with
    the areas of what stands out above and below (ISO 25178-2:2021, 4.5; there they are Smrk1 and Smrk2). With
    Vm(p) the material above the height at ratio p and Vv(p) the void below it, each per area: Vmp = Vm(10 %),
    Vmc = Vm(80 %) - Vm(10 %), Vvc = Vv(10 %) - Vv(80 %), Vvv = Vv(80 %).

    **Arguments:**

    - `heights`: any shape; NaN is missing.
    - `weights`: of the same shape, not negative: the area that each sample stands for.
    - `cut_height`: height above the mean at which Smr is taken, in the heights' unit.
    - `material_ratio`: ratio in % at which Smc is taken, a height above the mean.
    - `volume_ratios`: the two ratios in % that bound the core in Vmp, Vmc, Vvc and Vvv.
    - `ordered`: whether the heights fall already, missing ones and weights of zero last; sorting is most of the work.

    **Returns:** `FunctionalParameters`, NaN where nothing is present. Differentiable with respect to heights and
    weights, the central region held in place; works under `jit` and `vmap`.

    **Raises:** `InputError` for heights or weights that do not fit, and ratios that do not rise from 0 to 100.

    >>> parameters = functional_parameters(jnp.linspace(0.0, 1.0, 1001))
    >>> round(float(parameters.Sk), 2), round(float(parameters.Smr), 2), round(float(parameters.Vvc), 3)
    (1.0, 50.0, 0.385)
    """
    low, high = volume_ratios
    if not 0 < low < high < 100:
        raise InputError(f"volume_ratios are two rising percentages between 0 and 100, but got {low} and {high}")
    array, chosen = checked(heights, weights)
    ratios = jnp.asarray([low, high], array.dtype)
    return _functional_parameters(array, chosen, cut_height, material_ratio, ratios, ordered=ordered)


@partial(jax.jit, static_argnames="ordered")
def _functional_parameters(
    heights: Array, weights: Array | None, cut_height: Array, material_ratio: Array, volume_ratios: Array, ordered: bool
) -> FunctionalParameters:
    samples = measured(heights, weights)
    falling, shares = samples.heights.ravel(), samples.weights.ravel()
    lowest = jnp.min(jnp.where(shares > 0, falling, jnp.inf))
    falling = jnp.where(shares > 0, falling, lowest)  # what is missing comes last and occupies no ratio
    if not ordered:
        falling, shares = _sorted(falling, shares, equal=weights is None)
    curve = _curve(falling, shares, equal=weights is None)
    top, bottom = _core(curve)
    # The core is the smallest that holds its ends: a plateau at one of them is inside, whatever the line's rounding.
    rounding = 64 * jnp.finfo(curve.heights.dtype).eps
    above, below = curve.ratio_at(top + rounding), curve.ratio_at(bottom - rounding)
    peak, valley = curve.height_at(volume_ratios / 100)
    scale = samples.scale + jnp.where(jnp.any(samples.present), 0.0, jnp.nan)
    percent = 100 * scale / samples.scale
    return FunctionalParameters(
        Sk=scale * (top - bottom),
        Spk=scale * ratio(2 * curve.material_above(top), above, 0.0),
        Svk=scale * ratio(2 * curve.void_below(bottom), 1 - below, 0.0),
        Smr1=percent * above,
        Smr2=percent * below,
        Smr=percent * curve.ratio_at(cut_height / samples.scale),
        Smc=scale * curve.height_at(jnp.asarray(material_ratio) / 100),
        Vmp=scale * curve.material_above(peak),
        Vmc=scale * (curve.material_above(valley) - curve.material_above(peak)),
        Vvc=scale * (curve.void_below(peak) - curve.void_below(valley)),
        Vvv=scale * curve.void_below(valley),
    )


def _sorted(heights: Array, weights: Array, *, equal: bool) -> tuple[Array, Array]:
    """Heights, highest first, and their weights, which need not be carried along where all are equal."""
    if equal:
        return -jnp.sort(-heights), weights
    order = jnp.argsort(-heights)
    return heights[order], weights[order]


def _curve(heights: Array, weights: Array, *, equal: bool) -> _Curve:
    """Each height over the ratios that its weight occupies; weights that are all equal are only counted."""
    if equal:
        count = jnp.sum(weights > 0)
        end = jnp.minimum(jnp.arange(1, heights.size + 1), count) / count.astype(heights.dtype)
    else:
        sums = jnp.cumsum(weights)
        end = sums / sums[-1]
    return _Curve(heights, jnp.concatenate([jnp.zeros(1, end.dtype), end[:-1]]), end)


def _core(curve: _Curve) -> tuple[Array, Array]:
    """Heights of the equivalent straight line at the ratios 0 and 1."""
    first = _central_region(_Curve(*map(stop_gradient, curve)))
    start, end = (jnp.clip(side, first, first + _CORE) for side in (curve.start, curve.end))
    middle = first + _CORE / 2
    share = (end - start) / _CORE
    mean = jnp.sum(share * curve.heights)
    # The least-squares line of a function over an interval of length c has the slope 12 / c³ ∫ z(p) (p - middle) dp.
    slope = 12 / _CORE**2 * jnp.sum(share * ((start + end) / 2 - middle) * curve.heights)
    return mean - slope * middle, mean + slope * (1 - middle)


def _central_region(curve: _Curve) -> Array:
    """Where the 40 % begin whose secant falls least; of equal minima the first (ISO 13565-2:1996)."""
    starts = jnp.linspace(0, 1 - _CORE, _STARTS, dtype=curve.heights.dtype)
    drops = curve.height_at(starts) - curve.height_at(starts + _CORE)
    least = drops <= (1 + _EQUAL) * jnp.min(drops)
    places = jnp.arange(_STARTS)
    beyond = ~least & (places > jnp.argmax(least))
    end = jnp.where(jnp.any(beyond), jnp.argmax(beyond), _STARTS)
    return starts[jnp.argmin(jnp.where(places < end, drops, jnp.inf))]
