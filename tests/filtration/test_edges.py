"""The edge-preserving filter: edges, overshoot, the tolerance's promise, low features, missing pixels, outliers."""

import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax.data import peaks

SIZE, SIGMA = 96, 0.01


def noisy_step(degrees: float, height: float = 1.0, sigma: float = SIGMA) -> tuple[tsj.HeightMap, np.ndarray]:
    """A step at an angle, and the signed distance from its edge in pixels."""
    y, x = np.mgrid[0:SIZE, 0:SIZE] - (SIZE - 1) / 2
    angle = np.deg2rad(degrees)
    distance = x * np.cos(angle) + y * np.sin(angle)
    noise = sigma * np.random.default_rng(1).normal(size=distance.shape)
    return tsj.HeightMap(height * (distance > 0) + noise, 0.5, "µm"), distance


def mean_profile(distance: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """Mean heights of bins half a pixel wide, within 15 pixels of the edge."""
    chosen = np.abs(distance) < 15
    bins = np.floor(2 * (distance[chosen] + 15)).astype(int)
    counts = np.bincount(bins, minlength=60)
    return (np.bincount(bins, heights[chosen], minlength=60) / np.maximum(counts, 1))[counts > 0]


@pytest.mark.parametrize("degrees", [0, 17, 45])
@pytest.mark.parametrize("parts", [2, 4, 16])
def test_edges_stay(degrees, parts):
    """An edge stays steep, without overshoot; noise goes; what is taken off is as even beside the edge as elsewhere."""
    data, distance = noisy_step(degrees)
    filtered = tsj.filter(data, tolerance=1 / parts)
    assert filtered.converged
    assert filtered.max_error <= 1 / parts
    heights, rest = filtered.filtered.heights, filtered.residual.heights
    profile = mean_profile(distance, heights)
    between = np.count_nonzero((profile > 0.1) & (profile < 0.9))
    assert between <= 4  # bins of half a pixel
    assert max(profile.max() - 1, -profile.min()) < 0.02
    far = np.abs(distance) > 20
    assert np.std((heights - (distance > 0))[far]) < 0.35 * SIGMA
    assert np.std(rest[~far]) < 1.2 * np.std(rest[far])


@pytest.mark.parametrize("parts", [2, 4, 8])
def test_a_small_noisy_map(parts):
    """Noise hides what is left along an edge in single pixels, not in many: no overshoot, and an even residual."""
    size, sigma = 64, 0.02
    distance = np.arange(size) - (size - 1) / 2 + np.zeros((size, 1))
    data = tsj.HeightMap((distance > 0) + sigma * np.random.default_rng(0).normal(size=distance.shape), 1.0, "µm")
    filtered = tsj.filter(data, tolerance=1 / parts)
    profile = mean_profile(distance, filtered.filtered.heights)
    assert max(profile.max() - 1, -profile.min()) < 0.02
    rest, near, inside = filtered.residual.heights, np.abs(distance) <= 20, np.s_[8:-8, 8:-8]
    assert np.std(rest[inside][near[inside]]) < 1.2 * np.std(rest[inside][~near[inside]])


def test_a_circle_keeps_its_edge():
    """A pillar's edge stays within a pixel or two, in both directions of bending."""
    y, x = np.mgrid[0:SIZE, 0:SIZE] - (SIZE - 1) / 2
    distance = SIZE / 4 - np.hypot(x, y)
    data = tsj.HeightMap((distance > 0) + SIGMA * np.random.default_rng(2).normal(size=x.shape), 1.0, "µm")
    filtered = tsj.filter(data, tolerance=0.1)
    off = np.abs(filtered.filtered.heights - (distance > 0))
    assert filtered.max_error <= 0.1
    assert off[np.abs(distance) > 1.5].max() < 0.06


def test_what_is_lower_than_the_tolerance_goes():
    """Of two pillars the one of twice the tolerance stays whole, the one of half of it is taken off."""
    y, x = np.mgrid[0:SIZE, 0:SIZE]
    high, low = (np.hypot(x - centre, y - 48) < 6 for centre in (24, 72))
    noise = 0.005 * np.random.default_rng(3).normal(size=x.shape)
    data = tsj.HeightMap(0.4 * high + 0.1 * low + noise, 1.0, "µm")
    heights = tsj.filter(data, tolerance=0.2).filtered.heights
    background = np.median(heights)
    assert np.mean(heights[high]) - background == pytest.approx(0.4, abs=0.02)
    assert np.mean(heights[low]) - background < 0.05


def test_cutoff_and_tolerance():
    """Away from edges the filter is the linear one of the cut-off; the edge stays where the linear filter blurs it."""
    data, distance = noisy_step(17)
    both = tsj.filter(data, cutoff=6.0, tolerance=0.2)
    plain = tsj.filter(data, cutoff=6.0)
    far = np.abs(distance) > 20
    assert both.max_error <= 0.2
    np.testing.assert_allclose(both.filtered.heights[far], plain.filtered.heights[far], atol=0.4 * SIGMA)
    blurred = mean_profile(distance, plain.filtered.heights)
    kept = mean_profile(distance, both.filtered.heights)
    assert 3 * np.count_nonzero((kept > 0.1) & (kept < 0.9)) < np.count_nonzero((blurred > 0.1) & (blurred < 0.9))


def test_missing_pixels_and_units():
    """Holes on the edge stay missing; a map in metres gives the same as one in micrometres."""
    data, distance = noisy_step(17)
    mask = np.hypot(*np.meshgrid(np.arange(SIZE) - 40, np.arange(SIZE) - 50)) < 8
    holed = data.with_mask(mask)
    filtered = tsj.filter(holed, tolerance=0.25)
    assert np.array_equal(np.isnan(filtered.filtered.heights), mask)
    assert filtered.max_error <= 0.25
    profile = mean_profile(distance[~mask], filtered.filtered.heights[~mask])
    assert max(profile.max() - 1, -profile.min()) < 0.02
    again = tsj.filter(holed.to_unit("m"), tolerance="0.25um")
    np.testing.assert_allclose(1e6 * again.filtered.heights, filtered.filtered.heights, atol=2e-3)


def test_outliers_are_set_aside():
    """With `robust` a spike neither stands in the filtered map nor counts in the figures."""
    data, _ = noisy_step(0)
    heights = data.heights.copy()
    heights[20:80:20, 30:90:20] += 5.0
    filtered = tsj.filter(data.with_heights(heights), tolerance=0.25, robust=True)
    assert filtered.outliers == 9
    assert filtered.max_error <= 0.25
    assert np.abs(filtered.filtered.heights).max() < 1.1


def test_without_options_noise_is_taken_off():
    """The tolerance follows from the noise, and the clean surface is found better than it was measured."""
    clean = peaks((80, 80))
    data = peaks((80, 80), noise=0.01)
    filtered = tsj.filter(data)
    sigma = 0.01 * clean.range
    assert filtered.tolerance == pytest.approx(5 * sigma, rel=0.2)
    assert np.sqrt(np.mean((filtered.filtered.heights - clean.heights) ** 2)) < 0.5 * sigma


def test_a_tolerance_out_of_reach_is_said():
    """A budget that ends too early gives a result that says so."""
    data, _ = noisy_step(45)
    filtered = tsj.filter(data, tolerance=0.002, max_control_points=300)
    assert not filtered.converged
    assert filtered.stop is tsj.StopReason.MAX_CONTROL_POINTS
    assert "not met" in filtered.warnings[-1]


def test_finest_spacing_limits_refinement():
    """No element is smaller than asked for, and the result says why the tolerance is not met."""
    data, _ = noisy_step(17)
    filtered = tsj.filter(data, tolerance=0.1, finest_spacing="2um")
    boxes = filtered.surface.space.mesh.element_boxes
    assert ((boxes[:, 2:] - boxes[:, :2]) * data.extent).min() >= 2.0 - 1e-9
    assert (filtered.converged, str(filtered.stop)) == (False, "finest")
