"""Point clouds: planar parameters, triangles, units, and what is refused."""

import numpy as np
import pytest

from tsplinejax._errors import InputError
from tsplinejax.data import PointCloud

POINTS = np.array([[1.0, 10.0, 5.0], [3.0, 10.0, 6.0], [1.0, 14.0, 7.0], [2.0, 12.0, 8.0]])


def test_samples_span_the_bounding_box():
    """s runs along x, t along y, over the bounding box; values are z, or the points for a surface in space."""
    cloud = PointCloud(POINTS, "mm")
    samples = cloud.samples()
    np.testing.assert_allclose(samples.parameters, [[0, 0], [1, 0], [0, 1], [0.5, 0.5]], atol=1e-15)
    np.testing.assert_array_equal(samples.values, POINTS[:, 2:])
    np.testing.assert_array_equal(cloud.samples(as_surface=True).values, POINTS)
    assert (samples.frame.origin, samples.frame.extent, samples.frame.unit) == ((1.0, 10.0), (2.0, 4.0), "mm")
    assert cloud.diagonal == pytest.approx(np.sqrt(4 + 16 + 9))


def test_crop_keeps_whole_triangles():
    """Points outside go, triangles that lose a corner go with them, the rest is renumbered."""
    cloud = PointCloud(POINTS, triangles=[[0, 1, 2], [0, 2, 3]]).crop(1, 10, 2.5, 14)
    np.testing.assert_array_equal(cloud.points, POINTS[[0, 2, 3]])
    np.testing.assert_array_equal(cloud.triangles, [[0, 1, 2]])


def test_units_and_dtypes():
    """A cloud changes its unit as a whole; float32 stays float32."""
    cloud = PointCloud(POINTS.astype(np.float32), "mm")
    assert cloud.points.dtype == cloud.samples().values.dtype == np.float32
    np.testing.assert_allclose(cloud.to_unit("um").points, POINTS * 1000)
    with pytest.raises(InputError, match="unknown unit"):
        PointCloud(POINTS).to_unit("mm")


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((0, 3)), "at least one"),
        (np.zeros((4, 2)), r"\(m, 3\)"),
        (np.zeros(3), r"\(m, 3\)"),
        (np.where(np.eye(4, 3) > 0, np.nan, 1.0), "3 of 4 hold NaN"),
        ([[0, 0, np.inf]], "NaN or infinity"),
        (np.zeros((4, 3), bool), "real numbers"),
        (np.zeros((4, 3), complex), "real numbers"),
        ([["a", "b", "c"]], "real numbers"),
    ],
)
def test_bad_points_are_refused(points, message):
    """Empty, misshapen, non-finite and non-numeric clouds are refused."""
    with pytest.raises(InputError, match=message):
        PointCloud(points)


@pytest.mark.parametrize(
    ("triangles", "message"),
    [
        ([[0, 1, 4]], "vertices 0 to 3"),
        ([[-1, 1, 2]], "vertices 0 to 3"),
        ([[0, 1]], r"\(k, 3\)"),
        ([[0.0, 1, 2]], "integers"),
    ],
)
def test_bad_triangles_are_refused(triangles, message):
    """Triangles must name existing vertices by integers."""
    with pytest.raises(InputError, match=message):
        PointCloud(POINTS, triangles=triangles)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("offset", [0.0, 5e5])
def test_collinear_clouds_are_no_surface(dtype, offset):
    """Points on an oblique line, in one point or two are refused; a narrow strip is not."""
    along = np.linspace(0, 1000, 50)
    line = np.stack([offset + along * 0.3, offset + along * 0.7, along**2], axis=1).astype(dtype)
    with pytest.raises(InputError, match="one line"):
        PointCloud(line).samples()
    with pytest.raises(InputError, match="holds 1"):
        PointCloud(line[:1]).samples()
    with pytest.raises(InputError, match="holds 2"):
        PointCloud(line[:2]).samples()
    strip = line.copy()
    strip[::2, 0] += 1.0
    assert len(PointCloud(strip).samples()) == 50
