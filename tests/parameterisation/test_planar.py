"""Planar parameters: places in the (x, y) plane or in the least-squares plane."""

import numpy as np
import pytest

from tsplinejax import HeightMap, InputError, PointCloud
from tsplinejax.parameterisation import planar

from .surfaces import scattered, turned

POINTS = np.column_stack([3 * scattered(400, 0)[0], scattered(400, 0)[1], 0.1 * scattered(400, 1)[0]])


def test_xy_is_the_frame_of_the_cloud():
    """The same parameters as the cloud's own samples, and the extent as sides."""
    cloud = PointCloud(POINTS, "mm")
    result = planar(cloud)
    np.testing.assert_array_equal(result.parameters, cloud.samples().parameters)
    assert result.sides == cloud.frame.extent
    assert (result.kind, result.unit, result.certificate, result.corners) == ("planar", "mm", None, None)


@pytest.mark.parametrize("seed", range(4))
def test_plane_in_any_pose(seed):
    """A turned rectangle gives the same parameters as the upright one, up to which corner comes first."""
    upright = planar(POINTS, axes="plane")
    points, outward = turned(POINTS, seed)
    result = planar(points, axes="plane", outward=outward)
    s, t = upright.parameters.T
    names = [(s, t), (t, 1 - s), (1 - s, 1 - t), (1 - t, s)]
    assert min(np.abs(result.parameters - np.stack(pair, axis=1)).max() for pair in names) < 1e-9
    assert sorted(result.sides) == pytest.approx(sorted(upright.sides), rel=1e-12)


def test_plane_is_right_handed_towards_outward():
    """Seen from the other side t runs the other way."""
    result, other = planar(POINTS, axes="plane"), planar(POINTS, axes="plane", outward=(0, 0, -1))
    np.testing.assert_allclose(other.parameters[:, 0], result.parameters[:, 0], atol=1e-12)
    np.testing.assert_allclose(other.parameters[:, 1], 1 - result.parameters[:, 1], atol=1e-12)
    assert result.parameters[:, 0] @ POINTS[:, 0] > 0


def test_height_maps_give_their_valid_pixels():
    """Missing pixels have no parameters; the others keep their order."""
    heights = np.array([[1.0, np.nan, 2.0], [0.0, 1.0, 3.0]])
    result = planar(HeightMap(heights, (0.5, 2.0), "um"))
    np.testing.assert_allclose(result.parameters, [[0, 0], [1, 0], [0, 1], [0.5, 1], [1, 1]])


@pytest.mark.parametrize(
    ("points", "options", "message"),
    [
        ([[0, 0, 0], [1, 1, 1], [2, 2, 2]], {}, "one line"),
        ([[0, 0, 0], [1, 0, 1]], {}, "at least three"),
        ([[0, 0, 0], [1, 0, 0], [2, 0, 5]], {}, r"one line in \(x, y\)"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, np.nan]], {}, "finite"),
        (POINTS, {"axes": "yz"}, '"xy" or "plane"'),
        (POINTS, {"axes": "plane", "outward": (0, 0, 0)}, "outward"),
        (POINTS, {"axes": "plane", "outward": (0, 1)}, "outward"),
    ],
)
def test_misuse(points, options, message):
    """Each says what is wrong."""
    with pytest.raises(InputError, match=message):
        planar(points, **options)


def test_edge_on_warns():
    """Where the outward side cannot be told, a warning says so."""
    assert "outward" in planar(POINTS, axes="plane", outward=(1, 0, 0)).warnings[0]
