"""Height parameters: analytic surfaces, missing samples, weights, offsets and units, equal heights."""

import jax
import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra import numpy as hnp

from tsplinejax import InputError
from tsplinejax.areal import HeightParameters, height_parameters


def values(parameters: HeightParameters) -> np.ndarray:
    """All of them as one vector."""
    return np.array([float(value) for value in parameters])


def wave(count: int = 1000) -> np.ndarray:
    """Whole periods of a sine of amplitude 3, sampled evenly."""
    return 3 * np.sin(2 * np.pi * (np.arange(count) + 0.5) / count * 5) * np.ones((7, 1))


def test_sine():
    """A sine of amplitude A: Sq = A / √2, Sa = 2 A / π, Ssk = 0, Sku = 1.5."""
    found = height_parameters(wave())
    assert values(found)[:5] == pytest.approx([3 / np.sqrt(2), 6 / np.pi, 6, 3, 3], rel=2e-4)
    assert [found.Ssk, found.Sku] == pytest.approx([0, 1.5], abs=1e-12)


def test_ramp():
    """A ramp of height h: Sq = h / √12, Sa = h / 4, Sku = 1.8, to the sampling."""
    found = height_parameters((np.arange(100_000) + 0.5) / 100_000 * 5)
    assert values(found) == pytest.approx([5 / np.sqrt(12), 1.25, 5, 2.5, 2.5, 0, 1.8], rel=2e-5, abs=1e-9)


def test_exponential_heights():
    """Heights distributed as exp(-z): Sq = 1, Sa = 2 / e, Ssk = 2, Sku = 9."""
    found = height_parameters(-np.log1p(-(np.arange(1_000_000) + 0.5) / 1_000_000))
    assert [found.Sq, found.Sa, found.Ssk, found.Sku] == pytest.approx([1, 2 / np.e, 2, 9], rel=2e-3)


@given(hnp.arrays(float, (5, 8), elements=st.floats(-1e3, 1e3)), hnp.arrays(bool, (5, 8)))
def test_missing_heights_are_left_out(heights, missing):
    """The parameters of a map with missing pixels are numpy's of the list of the others."""
    missing[0, 0] = False
    z = heights[~missing] - heights[~missing].mean()
    expected = [z.std(), np.abs(z).mean(), np.ptp(z), z.max(), -z.min()]
    found = values(height_parameters(np.where(missing, np.nan, heights)))
    np.testing.assert_allclose(found[:5], expected, rtol=1e-9, atol=1e-9)
    if z.std() > 1e-6:
        moments = [(z**3).mean() / z.std() ** 3, (z**4).mean() / z.std() ** 4]
        np.testing.assert_allclose(found[5:], moments, rtol=1e-6, atol=1e-6)


def test_weights_are_areas():
    """Heights z = u under weights 2 u on [0, 1]: the mean is 2/3, Sq² = 1/18; repeating is weighting."""
    u = (np.arange(10_000) + 0.5) / 10_000
    found = height_parameters(u, 2e-20 * u)
    assert [found.Sq, found.Sp, found.Sv] == pytest.approx([np.sqrt(1 / 18), 1 / 3, 2 / 3], rel=1e-3)
    few, counts = np.array([1.0, -2.0, 4.0, 0.5]), np.array([1, 3, 0, 2])
    np.testing.assert_allclose(
        values(height_parameters(few, counts)), values(height_parameters(np.repeat(few, counts))), rtol=1e-12
    )


def test_datum_and_unit(dtype, tolerance_of):
    """A large offset changes nothing, and metres give the numbers of nanometres, in single precision, too."""
    heights = wave().astype(dtype)
    plain = values(height_parameters(heights))
    offset = values(height_parameters(heights + dtype.type(100)))
    small = values(height_parameters(heights * dtype.type(1e-9)))
    scale = np.array([1e9] * 5 + [1, 1])
    np.testing.assert_allclose(offset, plain, rtol=100 * tolerance_of(dtype) / 5, atol=tolerance_of(dtype))
    np.testing.assert_allclose(small * scale, plain, rtol=tolerance_of(dtype), atol=tolerance_of(dtype))


def test_equal_heights_and_none():
    """Equal heights have Sq = 0 and no Ssk; without a single height nothing is defined."""
    flat = height_parameters(np.full((3, 4), 7.0))
    assert values(flat)[:5].tolist() == [0] * 5
    assert np.isnan(values(flat)[5:]).all()
    assert np.isnan(values(height_parameters(np.full((3, 4), np.nan)))).all()


def test_batches_and_compiled():
    """Under `jit` and `vmap` the numbers are those of one map after the other."""
    maps = np.random.default_rng(0).normal(size=(3, 6, 5))
    maps[1, 2, 3] = np.nan
    batch = jax.jit(jax.vmap(height_parameters))(maps)
    for k, heights in enumerate(maps):
        np.testing.assert_allclose([value[k] for value in batch], values(height_parameters(heights)), rtol=1e-12)


@pytest.mark.parametrize(
    ("heights", "weights", "message"),
    [
        ([1.0, np.inf], None, "infinite"),
        (["a"], None, "real numbers"),
        ([], None, "at least one"),
        ([1.0, 2.0], [1.0], "shape"),
        ([1.0, 2.0], [1.0, -1.0], "not negative"),
        ([1.0, 2.0], [1.0, np.nan], "finite"),
    ],
)
def test_bad_input(heights, weights, message):
    """What is no list of heights and areas is refused, with the rule."""
    with pytest.raises(InputError, match=message):
        height_parameters(heights, weights)
