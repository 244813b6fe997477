"""One door for data: what counts as a map, what as a cloud, and what is refused."""

import numpy as np
import pytest

from tsplinejax._errors import InputError
from tsplinejax.data import HeightMap, PointCloud, as_data


def test_values_pass_through():
    """A height map or a cloud is returned as it is."""
    height_map, cloud = HeightMap(np.zeros((2, 2))), PointCloud(np.zeros((2, 3)))
    assert as_data(height_map) is height_map
    assert as_data(cloud) is cloud


@pytest.mark.parametrize(
    ("data", "kind"),
    [
        (np.zeros((4, 5)), HeightMap),
        (np.zeros((4, 3)), PointCloud),
        ([[1, 2], [3, 4]], HeightMap),
        (np.ma.masked_array(np.zeros((4, 3))), HeightMap),
        ((np.zeros((4, 3)), 0.5, 0.25), HeightMap),
    ],
)
def test_arrays_become_maps_or_clouds(data, kind):
    """Exactly three columns are points; masked arrays and (heights, dx, dy) are always maps."""
    assert isinstance(as_data(data), kind)


def test_a_tuple_states_the_spacing():
    """(heights, dx, dy) is in this order."""
    assert as_data((np.zeros((4, 5)), 0.5, 0.25)).spacing == (0.5, 0.25)


@pytest.mark.parametrize("data", ["map.x3p", None, 3, {"heights": 1}, [[1, 2], [3]], object(), np.zeros((2, 3, 4)), []])
def test_anything_else_is_refused(data):
    """Paths, numbers, ragged lists and 3-D arrays are refused."""
    with pytest.raises(InputError):
        as_data(data)
