"""Samples and frames: shapes and values are checked once, here."""

import numpy as np
import pytest

from tsplinejax._errors import InputError
from tsplinejax.data import Frame, Samples

PLACE = np.array([[0.0, 0.0], [1.0, 0.5]])


def test_values_get_two_dimensions():
    """(m,) values become (m, 1); weights take the values' dtype."""
    samples = Samples(PLACE, np.float32([1, 2]), [1, 2])
    assert (samples.values.shape, samples.dimension, len(samples)) == ((2, 1), 1, 2)
    assert samples.weights.dtype == np.float32
    assert samples.parameters.dtype == np.float64


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"parameters": np.zeros((2, 3))}, r"\(m, 2\)"),
        ({"parameters": np.zeros((3, 2))}, "m = 3"),
        ({"parameters": PLACE * 2}, "lie in"),
        ({"parameters": PLACE * np.nan}, "lie in"),
        ({"parameters": np.zeros((0, 2)), "values": np.zeros((0, 1))}, "no samples"),
        ({"values": [1.0, np.nan]}, "1 of 2"),
        ({"values": np.zeros((2, 0))}, r"\(m, d\)"),
        ({"weights": [1.0, -1.0]}, "not negative"),
        ({"weights": [1.0, np.nan]}, "finite"),
        ({"weights": [0.0, 0.0]}, "all weights are 0"),
        ({"weights": [1.0]}, "one weight per sample"),
        ({"grid_shape": (2, 2)}, "belong together"),
        ({"grid_shape": (2, 2), "grid_index": [0, 4]}, "in the grid"),
        ({"grid_shape": (2, 2), "grid_index": [0.5, 1.0]}, "integers"),
    ],
)
def test_bad_samples_are_refused(arguments, message):
    """Each rule has its message."""
    with pytest.raises(InputError, match=message):
        Samples(**{"parameters": PLACE, "values": [1.0, 2.0], **arguments})


def test_scatter_needs_a_grid():
    """Samples of a cloud cannot be scattered, nor can arrays of another length."""
    with pytest.raises(InputError, match="these have none"):
        Samples(PLACE, [1.0, 2.0]).scatter([1.0, 2.0])
    with pytest.raises(InputError, match="one number per sample"):
        Samples(PLACE, [1.0, 2.0], grid_shape=(1, 2), grid_index=[0, 1]).scatter([1.0])


def test_frames_map_both_ways():
    """Parameters to positions and back is the identity to rounding."""
    frame = Frame((3.0, -2.0), (0.5, 10.0), "mm")
    parameters = np.random.default_rng(0).random((20, 2))
    np.testing.assert_allclose(frame.parameters_of(*frame.xy_of(parameters).T), parameters, atol=1e-14)
    with pytest.raises(InputError, match=r"\(m, 2\)"):
        frame.xy_of(np.zeros(2))


@pytest.mark.parametrize("extent", [(0.0, 1.0), (1.0, -1.0), (np.nan, 1.0), (1.0,)])
def test_frames_need_area(extent):
    """A frame without area is refused."""
    with pytest.raises(InputError, match="extent"):
        Frame(extent=extent)
