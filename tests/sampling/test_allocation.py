"""Sharing samples out among elements, and standing them in rows."""

import hypothesis.strategies as st
import numpy as np
from hypothesis import given

from tsplinejax.sampling._allocation import apportioned, in_rows
from tsplinejax.sampling._greville import thinned

WEIGHTS = st.lists(st.floats(1e-6, 1e6), min_size=1, max_size=40).map(np.array)


@given(WEIGHTS, st.integers(1, 300))
def test_all_samples_are_shared_out(weights, size):
    """Exactly as many as there are; none is left without one while another has two."""
    counts = apportioned(weights, size)
    assert counts.sum() == size
    assert counts.min() >= (size >= len(weights))
    assert counts.max() == 1 or size > len(weights)


@given(WEIGHTS, st.integers(0, 300))
def test_no_piece_that_could_be_cut_is_larger_than_one_that_was(weights, more):
    """The rule of highest averages, by its definition: w / k of an element is at most w / (k - 1) of one cut."""
    counts = apportioned(weights, len(weights) + more)
    pieces = weights / counts
    cut = counts > 1
    assert not cut.any() or pieces.max() <= (weights[cut] / (counts[cut] - 1)).min() * (1 + 1e-6)


def test_equal_elements_take_turns_all_over_the_mesh():
    """Of a hundred equal elements, the ten that get one more do not stand in a row."""
    more = np.flatnonzero(apportioned(np.ones(100), 110) == 2)
    assert len(more) == 10
    assert np.diff(np.concatenate([[-1], more, [100]])).max() < 25


@given(
    st.lists(st.integers(0, 30), min_size=1, max_size=8).map(np.array),
    st.sampled_from([0.01, 0.3, 1.0, 2.5, 50.0]),
    st.booleans(),
)
def test_rows_hold_each_sample_once(counts, shape, to_border):
    """Distinct places inside the rectangle, as many as asked for in each."""
    owner, local = in_rows(counts, np.full(len(counts), shape), to_border=to_border)
    np.testing.assert_array_equal(np.bincount(owner, minlength=len(counts)), counts)
    assert ((local >= 0) & (local <= 1)).all()
    assert len(np.unique(np.column_stack([owner, local]), axis=0)) == counts.sum()


def test_a_square_number_is_a_grid():
    """In a square nine samples are 3 × 3; in a rectangle twice as wide as high eight are 4 × 2."""
    nine = in_rows(np.array([9]), np.array([1.0]), to_border=True)[1]
    assert sorted(map(tuple, nine)) == [(s / 2, t / 2) for s in range(3) for t in range(3)]
    eight = in_rows(np.array([8]), np.array([0.5]))[1]
    assert np.unique(eight[:, 0]).tolist() == [0.125, 0.375, 0.625, 0.875]
    assert np.unique(eight[:, 1]).tolist() == [0.25, 0.75]


@given(st.integers(1, 50), st.integers(1, 80))
def test_thinning_keeps_distinct_places_in_order(m, size):
    """No place twice, at most as many as wanted, evenly."""
    kept = thinned(np.column_stack([np.arange(m), np.arange(m)]), size)[:, 0]
    assert len(kept) == min(m, size)
    assert (np.diff(kept) > 0).all()
