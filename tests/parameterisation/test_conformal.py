"""Conformal parameters: conformal on clean and damaged clouds, equal to known maps, whatever order, pose and unit."""

import time

import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax import HeightMap, PointCloud
from tsplinejax.parameterisation import conformal

from .surfaces import (
    SURFACES,
    facing_patch,
    grid,
    grid_triangles,
    mercator,
    scattered,
    turned,
    with_faults,
    with_holes,
)


def _renamed(parameters):
    """The four namings of a rectangle's corners."""
    s, t = parameters.T
    return [np.stack(pair, axis=1) for pair in ((s, t), (t, 1 - s), (1 - s, 1 - t), (1 - t, s))]


def _difference(one, other):
    return min(np.abs(one - named).max() for named in _renamed(other))


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.parametrize("cloud", ["grid", "scattered"])
@pytest.mark.parametrize("count", [1000, 8000])
def test_clean_clouds(name, cloud, count):
    """In any pose E_u·E_v is within 0.5 % of 1 and the median dilatation at most 1.02."""
    u, v = grid(round(count**0.5), round(count**0.5)) if cloud == "grid" else scattered(count, 1)
    points, outward = turned(SURFACES[name](u, v), 3)
    result = conformal(points, outward=outward)
    assert abs(result.certificate - 1) < 0.005
    assert result.dilatation.median < 1.02
    if count < 2000 and name == "strip":  # so few points show other corners: see the page on parameters
        return
    found = np.stack([u, v], axis=1)[result.corners]
    assert {tuple(corner) for corner in found.round(0).astype(int)} == {(0, 0), (1, 0), (1, 1), (0, 1)}
    assert np.abs(found - found.round(0)).max() < 0.08


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_holes_and_noise(name, noise):
    """With three holes and noise of 0.3 spacings, one point in a hundred up to 20 times that, 1.07 holds."""
    points = SURFACES[name](*with_holes(*scattered(8000, 2)))
    damaged = with_faults(points, noise * (4 / 8000) ** 0.5, 2)
    result, clean = conformal(damaged), conformal(points)
    assert result.dilatation.median < 1.07
    assert abs(result.certificate - 1) < 0.005
    # Without smoothing this noise adds 20 % to the area. What is left is the outline, which lies further out by noise.
    assert np.prod(result.sides) == pytest.approx(np.prod(clean.sides), rel=0.06)


def _sector(columns=161, rows=121):
    """A sector of a ring: (angle, ln radius) is conformal."""
    u, v = grid(columns, rows)
    angle, radius = 1.8 * u, 1 + 1.5 * v
    points = np.column_stack([radius * np.cos(angle), -radius * np.sin(angle), np.zeros(len(u))])
    known = np.column_stack([u, np.log(radius) / np.log(2.5)])
    return points, grid_triangles(columns, rows), known, np.log(2.5) / 1.8


def _catenoid(columns=161, rows=121):
    """A catenoid in its isothermal coordinates (cosh t cos s, cosh t sin s, t)."""
    u, v = grid(columns, rows)
    s, t = 2.4 * u, 2.0 * v - 0.7
    points = np.column_stack([np.cosh(t) * np.cos(s), np.cosh(t) * np.sin(s), t])
    return points, grid_triangles(columns, rows), np.column_stack([u, v]), 2.0 / 2.4


@pytest.mark.parametrize("surface", [mercator, _sector, _catenoid])
@pytest.mark.parametrize("bare", [False, True])
def test_known_maps(surface, bare):
    """Meshes, and clouds of their vertices, give the known conformal map and side ratio to 1e-3."""
    points, triangles, known, ratio = surface()
    corner = [0, 160, len(points) - 1, len(points) - 161]
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    normal = np.cross(b - a, c - a).sum(axis=0)
    data = points if bare else PointCloud(points, triangles=triangles)
    result = conformal(data, corners=corner, outward=normal)
    assert np.abs(result.parameters - known).max() < 1e-3
    assert result.side_ratio == pytest.approx(ratio, rel=1e-3)
    np.testing.assert_array_equal(result.corners, corner)


def test_convergence_to_the_known_map():
    """Halving the spacing divides the error of a mesh by three at least."""
    errors = []
    for scale in (1, 2):
        points, triangles, known, _ = mercator(40 * scale + 1, 30 * scale + 1)
        corner = [0, 40 * scale, len(points) - 1, len(points) - 40 * scale - 1]
        errors.append(
            np.abs(conformal(PointCloud(points, triangles=triangles), corners=corner).parameters - known).max()
        )
    assert errors[1] < errors[0] / 3


# Rounding may turn single triangles at the border, which shows there: a hundredth of the spacing of 3000 points.
SAME = 0.01 / 3000**0.5


def test_order_and_unit_do_not_matter():
    """Shuffled points and points in another unit, with an offset, have the same parameters."""
    points = SURFACES["dome"](*with_holes(*scattered(3000, 4)))
    result = conformal(PointCloud(points, "mm"))
    order = np.random.default_rng(0).permutation(len(points))
    np.testing.assert_allclose(conformal(points[order]).parameters, result.parameters[order], atol=SAME)
    scaled = conformal(PointCloud(points * 1e-3 + [5.0, -2.0, 1.0], "m"))
    np.testing.assert_allclose(scaled.parameters, result.parameters, atol=SAME)
    np.testing.assert_allclose(np.array(scaled.sides) * 1e3, result.sides, rtol=1e-6)
    assert (result.unit, scaled.unit, result.frame.extent) == ("mm", "m", result.sides)


@pytest.mark.parametrize("name", SURFACES)
def test_pose_does_not_matter(name):
    """A turned cloud has the same parameters, up to which corner comes first."""
    points = SURFACES[name](*scattered(3000, 5))
    upright, outward = conformal(points), turned(points, 6)[1]
    result = conformal(turned(points, 6)[0], outward=outward)
    assert _difference(result.parameters, upright.parameters) < SAME


def test_single_precision():
    """float32 points give parameters to their precision."""
    points = SURFACES["dome"](*scattered(3000, 4))
    result, other = conformal(points), conformal(points.astype(np.float32))
    assert np.abs(result.parameters - other.parameters).max() < 1e-3


def test_right_handed():
    """∂x/∂s × ∂x/∂t looks to the outward side, and s runs along +x."""
    points = SURFACES["dome"](*scattered(2000, 7))
    for outward in ((0, 0, 1), (0, 0, -1)):
        parameters = conformal(points, outward=outward).parameters
        slopes = np.linalg.lstsq(np.column_stack([parameters, np.ones(2000)]), points, rcond=None)[0]
        assert np.cross(slopes[0], slopes[1]) @ outward > 0
        assert slopes[0, 0] > 1.5


def test_winding_says_the_outward_side():
    """Of a mesh its triangles say it, single ones turned round do not matter; `outward` is heard before them."""
    u, v = grid(21, 15)
    points, triangles = SURFACES["dome"](u, v), grid_triangles(21, 15)
    up = conformal(PointCloud(points, triangles=triangles)).parameters
    assert np.abs(up - np.stack([u, v], axis=1)).max() < 0.1
    down = conformal(PointCloud(points, triangles=triangles[:, ::-1])).parameters
    np.testing.assert_allclose(down[:, 1], 1 - up[:, 1], atol=1e-9)
    mixed = triangles.copy()
    mixed[::7] = mixed[::7, ::-1]
    np.testing.assert_allclose(conformal(PointCloud(points, triangles=mixed)).parameters, up, atol=1e-9)
    inwards = PointCloud(points, triangles=triangles[:, ::-1])
    np.testing.assert_allclose(conformal(inwards, outward=(0, 0, 1)).parameters, up, atol=1e-9)


def test_few_points_are_enough():
    """1024 points of a steep saddle have the parameters that many more give, within a third of their spacing."""
    few, many = 32, 125
    coarse, fine = (
        conformal(SURFACES["saddle"](*grid(count, count)), corners=np.array([0, 1, count + 1, count]) * (count - 1))
        for count in (few, many)
    )
    among = fine.parameters.reshape(many, many, 2)[::4, ::4].reshape(-1, 2)
    assert np.abs(coarse.parameters - among).max() < 1 / 3 / (few - 1)
    assert coarse.dilatation.median < 1.02


NEARLY_CLOSED = {
    "sphere open by 50°": lambda u, v: _sphere(2 * np.pi * u, np.arccos(1 - (1 + np.cos(np.radians(25))) * v)),
    "pipe of 340°": lambda u, v: np.column_stack([np.cos(5.93 * u), np.sin(5.93 * u), 3 * v]),
    "deep bowl": lambda u, v: _bowl(2 * np.pi * u, v),
}


def _sphere(longitude, colatitude):
    across = np.sin(colatitude)
    return np.column_stack([across * np.cos(longitude), across * np.sin(longitude), -np.cos(colatitude)])


def _bowl(angle, v):
    """Half an ellipsoid, three times as deep as wide."""
    level = np.pi / 2 * np.sqrt(v)
    across = np.sin(level)
    return np.column_stack([across * np.cos(angle), across * np.sin(angle), 3 * (1 - np.cos(level))])


@pytest.mark.parametrize("name", NEARLY_CLOSED)
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_nearly_closed_clouds(name, noise):
    """What no view shows whole is opened at its rim, and mapped conformally."""
    points = NEARLY_CLOSED[name](*scattered(4000, 3))
    points = points + noise * np.random.default_rng(0).normal(size=points.shape)
    result = conformal(points, outward=(0, 0, -1))
    assert abs(result.certificate - 1) < 0.005
    assert result.dilatation.median < 1.03


def test_holes_of_a_mesh_are_closed():
    """A mesh with a hole gives nearly the parameters of the whole one."""
    u, v = grid(61, 41)
    points, triangles = SURFACES["dome"](u, v), grid_triangles(61, 41)
    whole = conformal(PointCloud(points, triangles=triangles))
    middle = np.hypot(u - 0.4, v - 0.5)[triangles].max(axis=1)
    result = conformal(PointCloud(points, triangles=triangles[middle > 0.15]))
    outside = np.hypot(u - 0.4, v - 0.5) > 0.2
    assert np.abs(result.parameters - whole.parameters)[outside].max() < 0.01
    assert any("1 hole of the mesh closed" in warning for warning in result.warnings)
    assert result.certificate == pytest.approx(1, abs=0.005)


def test_points_without_triangles_are_interpolated():
    """Vertices that no triangle names get the parameters of the surface beside them, and a warning says so."""
    u, v = grid(41, 31)
    points, triangles = SURFACES["dome"](u, v), grid_triangles(41, 31)
    whole = conformal(PointCloud(points, triangles=triangles))
    lonely = 15 * 41 + 20
    result = conformal(PointCloud(points, triangles=triangles[(triangles != lonely).all(axis=1)]))
    np.testing.assert_allclose(result.parameters[lonely], whole.parameters[lonely], atol=5e-3)
    assert any("no triangle" in warning for warning in result.warnings)


def test_many_points_are_thinned():
    """Above `max_points` the rest is interpolated: within a hundredth, three thousandths for most."""
    points = SURFACES["dome"](*grid(150, 120))
    full, thin = conformal(points), conformal(points, max_points=4000)
    off = np.abs(full.parameters - thin.parameters).max(axis=1)
    assert off.max() < 0.02
    assert np.quantile(off, 0.5) < 0.003
    assert "18000 points thinned out to 4000" in thin.warnings


def test_round_aperture():
    """A round cloud works: conformal where it can be, and the distortion at the four corners is reported."""
    u, v = scattered(9000, 8)
    x, y = (2 * u - 1), (2 * v - 1)
    inside = np.hypot(x, y) < 1
    result = conformal(np.column_stack([x, y, 0.2 * x * y])[inside])
    assert result.certificate == pytest.approx(1, abs=0.01)
    assert result.dilatation.median < 1.02
    sides = np.diff(np.flatnonzero(np.isin(result.boundary, result.corners)))
    assert sides.max() < 2 * sides.min()


def test_height_maps():
    """The valid pixels of a map with NaN corners, in their order, with its unit."""
    y, x = np.mgrid[:60, :80]
    heights = 0.01 * (x - 40.0) * (y - 30) / 30
    heights[np.hypot(x - 39.5, (y - 29.5) * 4 / 3) > 42] = np.nan
    height_map = HeightMap(heights, (1.0, 4 / 3), "um")
    result = conformal(height_map)
    assert len(result) == height_map.valid.sum()
    assert result.unit == height_map.unit
    assert result.certificate == pytest.approx(1, abs=0.01)


@pytest.mark.slow
def test_speed():
    """10⁵ points need at most 30 seconds of processor time."""
    points = SURFACES["saddle"](*scattered(100_000, 0))
    started = time.process_time()
    result = conformal(points)
    assert time.process_time() - started < 30
    assert abs(result.certificate - 1) < 0.005
    assert result.dilatation.median < 1.02


@pytest.mark.parametrize("bare", [False, True])
def test_face_scan(shared_data, bare):
    """A measured face: as a mesh and as the cloud of its vertices, both conformal, and alike."""
    face = tsj.read(shared_data / "face_fran_cut.ply")
    result = conformal(face.points if bare else face)
    assert abs(result.certificate - 1) < 0.005
    assert result.dilatation.median < 1.02
    assert (result.parameters.min(), result.parameters.max()) == (0, 1)


def test_blade_patch(shared_data):
    """A patch of a measured turbine blade, cut out by the side its triangles face: a ragged outline."""
    patch = facing_patch(tsj.read(shared_data / "turbineblade.ply"))
    result = conformal(patch)
    assert len(patch) > 1000
    assert abs(result.certificate - 1) < 0.005
    assert result.dilatation.median < 1.02
