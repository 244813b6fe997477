"""The autocorrelation of a map with missing pixels, by fast Fourier transforms, without wrapping round."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from ._measured import Measured

#: The least share of the pairs of lag zero from which a mean product is taken.
_PAIRS = 0.05


def autocorrelation(samples: Measured) -> Float[Array, "lags_y lags_x"]:
    """Normalised autocorrelation at all lags up to half the map, lag zero in the middle; symmetric.

    f(τ) = [Σ w w' z z' / Σ w w'] / [Σ w z² / Σ w] over the pairs of pixels that are τ apart; NaN where too few are.

    **Arguments:**

    - `samples`: heights and weights of shape (rows, columns), missing ones of weight zero.

    >>> from tsplinejax.areal._measured import measured
    >>> autocorrelation(measured(jnp.array([[1.0, -1.0] * 4]), None)).round(6) + 0.0
    Array([[ 1., -1.,  1., -1.,  1., -1.,  1., -1.,  1.]], dtype=float64)
    """
    z, w = samples.heights, samples.weights
    reach = tuple(size // 2 for size in z.shape)
    products, pairs = _correlated(w * z, reach), _correlated(w, reach)
    enough = pairs > _PAIRS * jnp.sum(w**2)
    mean = products / jnp.where(enough, pairs, 1)
    return jnp.where(enough, mean, jnp.nan) / samples.mean(z**2)


def _correlated(values: Float[Array, "rows columns"], reach: tuple[int, ...]) -> Float[Array, "lags_y lags_x"]:
    """Σ v(x) v(x + τ) for every lag τ within reach."""
    from scipy.fft import next_fast_len

    # Lags wrap round only beyond the reach.
    shape: Any = tuple(next_fast_len(size + most, real=True) for size, most in zip(values.shape, reach, strict=True))
    spectrum = jnp.fft.rfft2(values, s=shape)
    sums = jnp.fft.irfft2(spectrum.real**2 + spectrum.imag**2, s=shape)
    for axis, most in enumerate(reach):
        sums = jnp.take(sums, jnp.arange(-most, most + 1), axis=axis, mode="wrap")
    return sums
