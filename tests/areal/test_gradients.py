"""Derivatives of the parameters against finite differences, with missing pixels and weights."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tsplinejax.areal import functional_parameters, height_parameters, hybrid_parameters, spatial_parameters

SHAPE = (14, 17)
GROUPS: dict[str, Callable[[Any, Any], Any]] = {
    "height": height_parameters,
    "differences": lambda z, w: hybrid_parameters(z, (0.5, 0.7), w),
    "seven-point": lambda z, w: hybrid_parameters(z, (0.5, 0.7), w, stencil="seven-point"),
    "functional": functional_parameters,
    "spatial": lambda z, w: spatial_parameters(z, (0.5, 0.7), w)[:2],
}


def surface() -> np.ndarray:
    """A smooth random map with a few missing pixels."""
    generator = np.random.default_rng(7)
    rows, columns = np.fft.fftfreq(40)[:, None], np.fft.rfftfreq(40)
    smooth = np.exp(-((np.pi * 1.5) ** 2) * (rows**2 + columns**2))
    heights = 10 * np.fft.irfft2(np.fft.rfft2(generator.normal(size=(40, 40))) * smooth)[: SHAPE[0], : SHAPE[1]]
    heights[2, 3] = heights[3, 3] = heights[13, 16] = np.nan
    return heights


def slope(function: Callable[[float], np.ndarray], step: float) -> np.ndarray:
    """A derivative at zero by central differences of fourth order."""
    near, far = (function(k * step) - function(-k * step) for k in (1, 2))
    return (8 * near - far) / (12 * step)


@pytest.mark.parametrize("group", GROUPS)
def test_against_finite_differences(group):
    """Every differentiable parameter, along a random change of heights and weights, forwards and backwards."""
    generator = np.random.default_rng(3)
    heights, weights = surface(), generator.random(SHAPE) + 0.5
    dz, dw = generator.normal(size=SHAPE), 0.3 * generator.normal(size=SHAPE)

    def along(step: Any) -> Any:
        return jnp.stack(jax.tree.leaves(GROUPS[group](heights + step * dz, weights + step * dw)))

    assert np.isfinite(along(0.0)).all()
    expected = slope(lambda step: np.asarray(along(step)), 1e-6)
    forwards, backwards = jax.jacfwd(along)(0.0), jax.jacrev(along)(0.0)
    np.testing.assert_allclose(forwards, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())
    np.testing.assert_allclose(backwards, forwards, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("group", GROUPS)
def test_missing_pixels_have_no_influence(group):
    """The gradient is finite everywhere and zero at missing pixels; a change of datum changes nothing."""
    heights = surface()
    gradient = np.asarray(jax.grad(lambda z: sum(jax.tree.leaves(GROUPS[group](z, None))))(heights))
    assert np.isfinite(gradient).all()
    assert not gradient[np.isnan(heights)].any()
    assert np.abs(gradient.sum()) < 1e-9 * np.abs(gradient).sum()


def test_equal_heights_have_a_finite_gradient():
    """Sq and Sdq have a corner at a flat surface; their derivative there is zero, not NaN."""
    flat = np.full(SHAPE, 3.0)
    assert not np.asarray(jax.grad(lambda z: height_parameters(z).Sq)(flat)).any()
    assert not np.asarray(jax.grad(lambda z: hybrid_parameters(z, (1.0, 1.0)).Sdq)(flat)).any()


@pytest.mark.parametrize("group", GROUPS)
def test_compiled_and_in_batches(group):
    """Under `jit` and `vmap` the numbers are those of one map after the other."""
    maps = np.stack([surface(), 2 * surface()[::-1]])
    batch = jax.jit(jax.vmap(lambda z: jnp.stack(jax.tree.leaves(GROUPS[group](z, None)))))(maps)
    for row, heights in zip(batch, maps, strict=True):
        np.testing.assert_allclose(row, jax.tree.leaves(GROUPS[group](heights, None)), rtol=1e-9, atol=1e-12)
