"""Orthogonal distance fits: exact where they can be, units and places, robust, refined, and misuse."""

import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax.mesh import b_lattice
from tsplinejax.orthogonal import OrthogonalStop
from tsplinejax.space import spline_space

from .problems import known_surface, saddle


def distances_between(surface: tsj.TSpline, other: tsj.TSpline) -> np.ndarray:
    """Distances of a grid of one surface's points, its border left out, to another surface."""
    middle = np.linspace(0.02, 0.98, 25)
    grid = np.stack(np.meshgrid(middle, middle), axis=-1).reshape(-1, 2)
    return np.abs(np.asarray(tsj.project(other, surface(grid)).distances))


def test_a_known_surface_is_recovered_from_wrong_parameters():
    """Points of a T-spline with T-junctions give it back to 1e-8 of its size, though their parameters are wrong."""
    truth = known_surface()
    generator = np.random.default_rng(0)
    places = np.concatenate([generator.random((1500, 2)), np.stack(np.meshgrid([0, 1], [0, 1]), -1).reshape(-1, 2)])
    points = np.asarray(truth(places))
    wrong = np.clip(places + 0.01 * np.sin(5 * places[:, ::-1]), 0, 1)
    fit = tsj.fit_orthogonal(
        points, wrong, space=truth.space, method=tsj.Joint(slip=0.0), smoothing=0.0, max_iterations=100
    )
    assert np.abs(distances_between(truth, fit.surface)).max() < 1e-10 * np.linalg.norm(np.ptp(points, axis=0))
    assert fit.converged


def test_holding_slip_tends_to_the_normal_fit():
    """A heavily held joint fit is the normal one, and both follow as many numbers as there are control points."""
    points = saddle(noise=0.02)
    normal = tsj.fit_orthogonal(points, method=tsj.Normal())
    held = tsj.fit_orthogonal(points, method=tsj.Joint(slip=1e5))
    np.testing.assert_allclose(held.distances, normal.distances, atol=2e-5)
    assert normal.converged
    assert held.converged
    assert abs(normal.edf - 36) < 0.1
    assert abs(held.edf - 36) < 0.1


def test_free_slip_follows_more():
    """Without held slip the joint fit follows the noise with more degrees of freedom, and the residual is smaller."""
    points = saddle(noise=0.02)
    held, free = (tsj.fit_orthogonal(points, method=tsj.Joint(slip=slip)) for slip in (10.0, 1e-4))
    assert free.edf > held.edf + 10
    assert free.rms_error < held.rms_error


def test_the_default_keeps_the_texture():
    """White noise of 20 control points' worth of freedom and the form: the distances are the noise that was put in."""
    points, bare = saddle(noise=0.02), saddle()
    x, y = bare[:, 0], bare[:, 1]
    normal = np.stack([-1.2 * x, 1.2 * y, np.ones_like(x)], axis=1)
    texture = np.sum((points - bare) * normal, axis=1) / np.linalg.norm(normal, axis=1)
    fit = tsj.fit_orthogonal(points)
    # 36 of 2000 degrees of freedom are lost.
    assert np.sqrt(np.mean((fit.distances - texture) ** 2)) < 1.2 * 0.02 * np.sqrt(36 / 2000)


def test_scale_unit_and_place_do_not_matter():
    """Nanometres far from the origin give the same distances in their own unit; a turned cloud gives them, too."""
    points = saddle(noise=0.02)
    fit = tsj.fit_orthogonal(points)
    far = tsj.fit_orthogonal(tsj.PointCloud(points * 1e6 + [3e7, -2e7, 1e7], "nm"))
    np.testing.assert_allclose(far.distances / 1e6, fit.distances, atol=1e-6)
    assert far.unit == far.surface.unit == "nm"
    angle = np.array([[0.6, 0, 0.8], [0, 1, 0], [-0.8, 0, 0.6]])
    parameters = (points[:, :2] - points[:, :2].min(axis=0)) / np.ptp(points[:, :2], axis=0)
    turned = tsj.fit_orthogonal(points @ angle.T, np.clip(parameters, 0, 1), sides=(2.0, 2.0))
    np.testing.assert_allclose(turned.distances, fit.distances, atol=1e-6)


def test_single_precision():
    """float32 data are fitted in float32, to its accuracy."""
    points = saddle(noise=0.02)
    single = tsj.fit_orthogonal(points.astype(np.float32))
    assert single.surface.space.dtype == np.float32
    np.testing.assert_allclose(single.distances, tsj.fit_orthogonal(points).distances, atol=5e-4)


@pytest.mark.parametrize("robust", [tsj.Huber(), tsj.Tukey()])
def test_outliers_and_dust_do_not_pull_the_surface(robust):
    """1 % of outliers up to twenty times Sq and a cluster of dust move the form by a fraction of Sq."""
    noise, generator = 0.01, np.random.default_rng(4)
    points = saddle(noise=noise)
    clean = tsj.fit_orthogonal(points)
    dirty = points.copy()
    dirty[:20] += 20 * noise * generator.uniform(-1, 1, (20, 3))
    dust = np.flatnonzero(np.linalg.norm(points[:, :2] - [0.4, -0.3], axis=1) < 0.08)
    dirty[dust, 2] += 12 * noise
    fit = tsj.fit_orthogonal(dirty, robust=robust)
    apart = distances_between(clean.surface, fit.surface)
    assert np.sqrt(np.mean(apart**2)) < (0.2 if isinstance(robust, tsj.Tukey) else 0.5) * noise
    if isinstance(robust, tsj.Tukey):
        assert fit.outliers[dust].mean() > 0.9
        assert fit.outliers[np.setdiff1d(np.arange(20, 2000), dust)].mean() < 0.02


def test_a_tolerance_is_met_at_every_point():
    """Refinement meets the tolerance by distance to the foot, with fewer control points than a lattice that does."""
    generator = np.random.default_rng(0)
    x, y = generator.uniform(-1, 1, (2, 4000))
    z = 0.3 * x**2 + 0.2 * y + 0.15 * np.exp(-((x - 0.3) ** 2 + (y - 0.2) ** 2) / 0.1**2)
    points = np.column_stack([x, y, z])
    fit = tsj.fit_orthogonal(points, tolerance=3e-3)
    assert fit.stop is OrthogonalStop.TOLERANCE
    gaps = np.linalg.norm(points - fit.feet, axis=1)
    assert gaps.max() <= 3e-3
    np.testing.assert_allclose(gaps.max(), fit.max_error, rtol=1e-9)
    lattice = tsj.fit_orthogonal(points, lattice=(14, 14), method=tsj.Parametric())
    assert lattice.max_error > 3e-3
    assert fit.control_points < lattice.control_points


def test_budgets_stop_refinement():
    """A step budget ends it, and the result says so."""
    points = saddle(noise=0.05)
    fit = tsj.fit_orthogonal(points, tolerance=1e-4, max_steps=1, method=tsj.Parametric())
    assert fit.stop is OrthogonalStop.MAX_STEPS
    assert not fit.converged
    assert len(fit.history) == 2


def test_a_height_map_goes_in_directly():
    """A map of an inclined plane, holes in it, has no texture."""
    rows, columns = np.mgrid[0:40, 0:50]
    heights = 0.5 * columns + 0.2 * rows
    heights[5:9, 7:20] = np.nan
    fit = tsj.fit_orthogonal(tsj.HeightMap(heights, (1.0, 1.0), "um"))
    assert len(fit.distances) == np.isfinite(heights).sum()
    assert np.abs(fit.distances).max() < 1e-6
    assert "µm" in repr(fit)


def test_parameters_from_an_object():
    """Whatever has `parameters` and `sides` serves as parameters."""

    class Mapped:
        parameters = np.random.default_rng(0).random((500, 2))
        sides = (2.0, 1.0)

    points = np.column_stack([Mapped.parameters * Mapped.sides, np.zeros(500)])
    fit = tsj.fit_orthogonal(points, Mapped())
    assert np.abs(fit.distances).max() < 1e-9
    assert fit.surface.frame.extent == (2.0, 1.0)


POINTS = saddle(200)


@pytest.mark.parametrize(
    ("points", "options", "said"),
    [
        (np.where(np.arange(600).reshape(-1, 3) == 5, np.nan, POINTS), {}, "finite"),
        (POINTS[:, [0, 0, 0]], {}, "line"),
        (POINTS, {"parameters": POINTS[:, :2]}, r"\[0, 1\]²"),
        (POINTS, {"parameters": POINTS[:5, :2]}, r"shape \(200, 2\)"),
        (POINTS, {"lattice": (20, 20), "smoothing": 0.0}, "as many points as control points"),
        (POINTS, {"tolerance": -1.0}, "above zero"),
        (POINTS, {"method": "joint"}, "Joint"),
        (POINTS, {"robust": True}, "Tukey"),
        (POINTS, {"weights": np.zeros(200)}, "weights"),
        (POINTS, {"max_iterations": 0}, "at least 1"),
        (POINTS, {"space": spline_space(b_lattice(2, 2)), "lattice": (2, 2)}, "not both"),
        (POINTS, {"method": tsj.Joint(solver=3)}, "optimistix"),
        (POINTS, {"smoothing": -1.0}, "smoothing"),
    ],
)
def test_misuse(points, options, said):
    """What cannot be fitted is refused with the rule and the remedy."""
    parameters = options.pop("parameters", None)
    with pytest.raises(tsj.InputError, match=said):
        tsj.fit_orthogonal(points, parameters, **options)


def test_a_map_of_unknown_scale_is_refused():
    """Without spacing and unit a map's heights cannot be compared with its extent; with either they can."""
    heights = np.outer(np.linspace(0, 1, 20) ** 2, np.ones(20))
    with pytest.raises(tsj.InputError, match="neither spacing nor unit"):
        tsj.fit_orthogonal(tsj.HeightMap(heights))
    assert tsj.fit_orthogonal(tsj.HeightMap(heights, 0.5)).max_error < 1e-6
