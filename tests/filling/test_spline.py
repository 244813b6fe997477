"""Spline fillers: the solver against a dense one, what each energy leaves untouched, and creases."""

import numpy as np
import pytest

from tsplinejax.filling import SplineFiller
from tsplinejax.filling._filler import Field, Window
from tsplinejax.filling._spline import _data_planes, _solved, _with_energy, element_energy

ONE = (1.0, 1.0)


def filled(filler, heights, sides=ONE):
    """All missing pixels of a small map, in one window."""
    missing = np.isnan(heights)
    window = Window(slice(0, heights.shape[0]), slice(0, heights.shape[1]), missing)
    result = heights.copy()
    result[missing] = filler.prepare(Field(heights, sides, float(np.nanmax(heights) - np.nanmin(heights)) or 1.0))(
        window
    )
    return result


def with_hole(heights):
    """The same with a block missing."""
    holed = heights.copy()
    rows, columns = heights.shape
    holed[rows // 3 : rows // 3 + 5, columns // 3 : columns // 3 + 6] = np.nan
    return holed


@pytest.mark.parametrize("shape", [(7, 12), (12, 7), (9, 9)])
def test_banded_solve_equals_dense(shape):
    """Planes of offsets, turned or not, are the matrix: its solution is that of a dense solve."""
    rng = np.random.default_rng(1)
    data, energy = _data_planes(rng.random(shape)), element_energy(2, (0.8, 1.25))
    planes = _with_energy(data, energy, rng.random((shape[0] - 1, shape[1] - 1)))
    h, w = shape[0] + 2, shape[1] + 2
    dense = np.zeros((h, w, h, w))
    for (down, across), plane in planes.items():
        for i in range(h - down):
            for j in range(max(0, -across), min(w, w - across)):
                dense[i + down, j + across, i, j] = dense[i, j, i + down, j + across] = plane[i, j]
    load = rng.normal(size=(h, w))
    expected = np.linalg.solve(dense.reshape(h * w, h * w), load.ravel()).reshape(h, w)
    np.testing.assert_allclose(_solved(planes, load), expected, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("sides", [ONE, (0.5, 2.0)])
def test_energy_is_the_integral(order, sides):
    """An element's energy is that of its bicubic polynomial, by Gauss quadrature with physical derivatives."""
    from scipy.interpolate import NdBSpline

    rng = np.random.default_rng(order)
    points = rng.normal(size=(4, 4))
    spline = NdBSpline((np.arange(-3.0, 5.0),) * 2, points, 3)
    nodes, weights = np.polynomial.legendre.leggauss(6)
    y, x = np.meshgrid((nodes + 1) / 2, (nodes + 1) / 2, indexing="ij")
    total, binomials = 0.0, {1: (1, 1), 2: (1, 2, 1), 3: (1, 3, 3, 1)}[order]
    for k, factor in enumerate(binomials):
        values = spline(np.stack([y, x], axis=-1), nu=(order - k, k)) / sides[0] ** k / sides[1] ** (order - k)
        total += factor * np.einsum("i,j,ij->", weights / 2, weights / 2, values**2)
    energy = element_energy(order, sides)
    assert np.einsum("ab,abcd,cd", points, energy, points) == pytest.approx(total * sides[0] * sides[1])


@pytest.mark.parametrize("order", [1, 2, 3])
def test_polynomials_without_energy_are_found_again(order):
    """What has no energy goes on through a hole: constants, planes, quadratics; spacing dx ≠ dy."""
    y, x = np.mgrid[0:24, 0:30] / 10.0
    heights = (np.ones_like(x), 2 - x + 3 * y, x**2 - x * y + 0.5 * y)[order - 1]
    result = filled(SplineFiller(order, 1e-3), with_hole(heights), (2.0, 0.5))
    np.testing.assert_allclose(result, heights, atol=1e-6)


def test_creases_gather_curvature():
    """Beside a step the creased spline has less curvature in all, and swings less."""
    heights = np.where(np.arange(40) < 20, 0.0, 1.0) * np.ones((40, 1))
    holed = heights.copy()
    holed[14:24, 13:26] = np.nan
    plain, creased = (filled(SplineFiller(2, 1e-2, creases=creases), holed) for creases in (False, True))
    curvatures = [float(np.abs(np.diff(result[14:24, 11:28], 2, axis=1)).sum()) for result in (plain, creased)]
    assert curvatures[1] < 0.95 * curvatures[0], curvatures
    assert creased.max() - 1 < 0.9 * (plain.max() - 1), (plain.max(), creased.max())


def test_nothing_known_but_one_pixel():
    """A window with a single known pixel is filled with about its height."""
    heights = np.full((9, 9), np.nan)
    heights[4, 4] = 3.0
    np.testing.assert_allclose(filled(SplineFiller(2), heights), 3.0, atol=1e-3)
