"""The mixture: convex, of least error, and not the choice of a few hard places."""

import numpy as np
from hypothesis import given, settings, strategies as st

from tsplinejax.filling._blend import blend_weights


@settings(max_examples=40)
@given(st.integers(0, 10_000), st.integers(1, 5))
def test_weights_are_convex_and_independent_of_the_unit(seed, count):
    """Weights are not negative, add up to one, and are the same for errors in another unit."""
    rng = np.random.default_rng(seed)
    errors = rng.normal(size=(count, 60)) * rng.uniform(0.1, 10, (count, 1))
    places = rng.integers(0, 100, (60, 2))
    weights = blend_weights(errors, places)
    assert (weights >= 0).all()
    assert np.isclose(weights.sum(), 1)
    np.testing.assert_allclose(blend_weights(1e-9 * errors, places), weights, atol=1e-6)


def test_opposite_errors_cancel():
    """Of two fillers that err to either side, and a third that is no use, the first two are mixed."""
    error = np.random.default_rng(0).normal(size=200)
    weights = blend_weights(np.array([error, -3 * error, 9 + error]), np.zeros((200, 2), int))
    np.testing.assert_allclose(weights, [0.75, 0.25, 0], atol=1e-6)


def test_one_hard_place_does_not_decide():
    """Nine places in which the first filler is three times as good outweigh one, a hundred times harder, in which the
    second is a little better; a single sum of squares would have it the other way round.
    """
    rng = np.random.default_rng(1)
    first, second = rng.normal(size=(2, 10, 50)) * np.array([1.0, 3.0])[:, None, None]
    first[9], second[9] = 100 * rng.normal(size=50), 80 * rng.normal(size=50)
    errors = np.array([first.ravel(), second.ravel()])
    places = np.repeat(np.arange(10) * 40, 50)[:, None] * [1, 0]
    assert blend_weights(errors, places)[0] > 0.75
    sums = (errors**2).sum(axis=1)
    assert sums[1] < sums[0]


def test_no_error_at_all():
    """Fillers that all are right: the first is taken."""
    assert blend_weights(np.zeros((3, 5)), np.zeros((5, 2), int)).tolist() == [1, 0, 0]
