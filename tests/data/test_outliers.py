"""Outliers: spikes are found, features, edges and noise are left alone, on grids, clouds and measured maps."""

from collections.abc import Callable

import numpy as np
import pytest

from tsplinejax import data
from tsplinejax._errors import InputError
from tsplinejax.data import HeightMap, PointCloud, find_outliers
from tsplinejax.io import read

SURFACES: dict[str, Callable[[], HeightMap]] = {
    "laser texture": data.laser_textured_disk,
    "plate": data.plate_with_particles,
    "pillars with holes": data.structured_with_missing,
    "step": lambda: data.step((512, 512)),
}
MEASURED = ("SainteHelens.dem", "frt-1.frt", "mnt-2.mnt", "opd-1.opd", "sur-2.sur", "tmd-1.tmd", "x3p-2.x3p")
ON_EACH_SURFACE = pytest.mark.parametrize("surface", SURFACES)


@pytest.fixture(scope="module")
def clean() -> dict[str, HeightMap]:
    """The surfaces without spikes, made once."""
    return {name: make() for name, make in SURFACES.items()}


def spiked(height_map: HeightMap, share: float = 0.001, seed: int = 0) -> tuple[HeightMap, np.ndarray]:
    """The map with single pixels, up and down, ten times its range off; and which ones they are."""
    rng = np.random.default_rng(seed)
    spikes = height_map.valid & (rng.random(height_map.shape) < share)
    offset = 10 * height_map.range * rng.choice([-1.0, 1.0], height_map.shape)
    heights = height_map.heights + np.where(spikes, offset, 0.0).astype(height_map.heights.dtype)
    return height_map.with_heights(heights), spikes


@ON_EACH_SURFACE
@pytest.mark.parametrize("seed", [0, 1])
def test_spikes_are_found(clean, surface, seed):
    """Of spikes on one pixel in a thousand, 99 % are found; of 10 000 clean pixels one is lost at most."""
    height_map, spikes = spiked(clean[surface], seed=seed)
    found = find_outliers(height_map)
    assert (found.shape, found.dtype) == (height_map.shape, np.dtype(bool))
    assert found[spikes].mean() >= 0.99
    assert found[height_map.valid & ~spikes].mean() <= 1e-4
    assert not found[~height_map.valid].any()


@ON_EACH_SURFACE
def test_clean_surfaces(clean, surface):
    """Rims, dimples, pillars beside holes and steps are no outliers."""
    assert not find_outliers(clean[surface]).any()


@pytest.mark.parametrize(
    "make",
    [
        pytest.param(lambda: data.plate_with_particles(noise=0.01), id="plate with 1 % noise"),
        pytest.param(data.scattered_peaks, id="scattered peaks"),
        pytest.param(data.sparse_bumps, id="bumps"),
        pytest.param(lambda: data.peaks((512, 512)), id="peaks"),
        pytest.param(lambda: data.step(angle=0.6), id="slanted step"),
        pytest.param(lambda: data.step(width=0.01), id="rounded step"),
    ],
)
def test_noise_and_smooth_features_are_no_outliers(make):
    """Nothing is set aside on surfaces without spikes, noisy or not."""
    assert not find_outliers(make()).any()


def test_clusters():
    """Clusters of up to twelve pixels are found whole; a feature of 20 × 20 pixels is one of the surface."""
    heights = data.plate_with_particles((256, 256)).heights.copy()
    expected = np.zeros(heights.shape, bool)
    expected[40:42, 50:52] = expected[100:103, 200:204] = expected[0, 0] = True
    heights[expected] += 100
    heights[150:170, 60:80] += 30
    np.testing.assert_array_equal(find_outliers(heights), expected)


@pytest.mark.parametrize("factor", [1e-9, 1e-3, 1e6])
@ON_EACH_SURFACE
def test_units_do_not_matter(clean, surface, factor):
    """The same pixels in metres as in nanometres."""
    height_map, _ = spiked(clean[surface])
    scaled = height_map.with_heights(factor * height_map.heights)
    np.testing.assert_array_equal(find_outliers(scaled), find_outliers(height_map))


@ON_EACH_SURFACE
def test_single_precision(clean, surface):
    """In float32 spikes are found as in float64, and none on the clean map."""
    single = clean[surface].with_heights(clean[surface].heights.astype(np.float32))
    assert not find_outliers(single).any()
    height_map, spikes = spiked(single)
    assert height_map.heights.dtype == np.float32
    found = find_outliers(height_map)
    assert found[spikes].mean() >= 0.99
    assert found[height_map.valid & ~spikes].mean() <= 1e-4


def test_samples_are_judged_as_their_map(clean):
    """The samples of a map with holes are those of its pixels that are there."""
    height_map, _ = spiked(clean["pillars with holes"])
    found = find_outliers(height_map.samples())
    np.testing.assert_array_equal(found, find_outliers(height_map)[height_map.valid])


@pytest.mark.parametrize("as_surface", [False, True])
def test_clouds(as_surface):
    """Points far off a scattered surface, by their height or by their distance in space."""
    points = data.scattered_peaks(20_000).points.copy()
    spikes = np.random.default_rng(0).random(len(points)) < 0.001
    points[spikes, 2] += 10 * np.ptp(points[:, 2])
    found = find_outliers(PointCloud(points), as_surface=as_surface)
    assert found[spikes].mean() >= 0.99
    assert found[~spikes].mean() <= 1e-4


@pytest.mark.parametrize(
    "heights",
    [
        pytest.param(np.full((64, 64), 2.5), id="constant"),
        pytest.param(np.zeros((64, 64), np.float32), id="zero"),
        pytest.param(np.array([[1.0, 2.0], [3.0, 100.0]]), id="four pixels"),
        pytest.param(np.array([[1.0, 2.0, 900.0, 2.0]]), id="four in a row"),
        pytest.param(np.arange(300.0)[np.newaxis], id="one row"),
        pytest.param(np.arange(300.0)[:, np.newaxis], id="one column"),
        pytest.param(np.where(np.eye(40, dtype=bool), 1.0, np.nan), id="nearly all missing"),
    ],
)
def test_nothing_to_judge_by(heights):
    """Constant maps and maps too small to have a neighbourhood have no outliers."""
    assert not find_outliers(HeightMap(heights)).any()


def test_a_spike_on_a_constant_map_and_on_a_profile():
    """Where nothing else varies the number format's rounding is the measure; a profile is judged along its length."""
    flat = np.full((64, 64), 2.5)
    flat[10, 20] = 3.0
    np.testing.assert_array_equal(np.argwhere(find_outliers(flat)), [[10, 20]])
    profile = np.sin(np.linspace(0, 6, 300))
    profile[123] += 20
    np.testing.assert_array_equal(np.argwhere(find_outliers(HeightMap(profile[np.newaxis]))), [[0, 123]])


@pytest.mark.parametrize("contrast", [0.0, -1.0, np.nan])
def test_the_contrast_is_positive(contrast):
    """A contrast of zero or less would set everything aside."""
    with pytest.raises(InputError, match="contrast"):
        find_outliers(np.zeros((8, 8)), contrast=contrast)


@pytest.mark.parametrize("name", MEASURED)
def test_measured_maps(shared_data, name):
    """Of measured maps at most one pixel in two hundred is set aside."""
    height_map = read(shared_data / name)
    assert find_outliers(height_map)[height_map.valid].mean() <= 0.005
