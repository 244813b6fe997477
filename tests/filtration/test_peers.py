"""Peers' filters in the same call style, and the measurement of transmission."""

import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax.filtration import (
    bilateral_filter,
    non_local_means_filter,
    spline_filter,
    total_variation_filter,
)

FILTERS = {
    "bilateral": lambda data: bilateral_filter(data, sigma_length="2um", sigma_height="100nm"),
    "total variation": lambda data: total_variation_filter(data, weight=0.05),
    "non-local means": lambda data: non_local_means_filter(data, strength=0.05, patch=3, reach=5),
    "spline": lambda data: spline_filter(data, "5um"),
}


@pytest.fixture
def noisy() -> tsj.HeightMap:
    """A step with noise, far from zero."""
    heights = np.where(np.arange(48) < 24, 5.0, 6.0) + 0.02 * np.random.default_rng(0).normal(size=(40, 48))
    return tsj.HeightMap(heights, 1.0, "µm", origin=(1.0, 2.0))


@pytest.mark.parametrize("name", FILTERS)
def test_peers_take_noise_off(noisy, name):
    """Each gives a map of the same place that is less noisy on the flats, and says what was done."""
    filtered = FILTERS[name](noisy)
    flat = (slice(5, -5), slice(5, 14))
    assert np.std(filtered.heights[flat]) < 0.7 * np.std(noisy.heights[flat])
    assert (filtered.spacing, filtered.unit, filtered.origin) == (noisy.spacing, "µm", (1.0, 2.0))
    assert filtered.provenance["operations"][0].startswith("filter ")


@pytest.mark.parametrize("name", ["bilateral", "total variation", "non-local means"])
def test_what_images_cannot_hold_is_refused(noisy, name):
    """Missing pixels and oblong ones are not for filters of images."""
    mask = np.zeros(noisy.shape, bool)
    mask[3, 4] = True
    with pytest.raises(tsj.InputError, match="knows no missing pixels, but 1 are"):
        FILTERS[name](noisy.with_mask(mask))
    with pytest.raises(tsj.InputError, match="square pixels"):
        FILTERS[name](tsj.HeightMap(noisy.heights, (1.0, 2.0), "µm"))


def test_spline_filter_and_holes(noisy):
    """The spline of ISO 16610-62 leaves missing pixels missing, and planes alone."""
    y, x = np.mgrid[0:40, 0:48]
    plane = 2.0 * x - 3.0 * y
    plane[10:20, 10:20] = np.nan
    filtered = spline_filter((plane, 1.0, 0.5), 8.0)
    np.testing.assert_allclose(filtered.heights, plane, atol=1e-6)


@pytest.mark.parametrize("ratio", [0.5, 1.0, 2.0])
def test_measured_transmission_of_known_filters(ratio):
    """What is measured of the Gaussian and of the spline filter is what their standards define."""
    cutoff = 12.0
    options = {"spacing": 1.0, "directions": (0, 45), "phases": 3, "margin": 24.0}
    gaussian = tsj.transmission(lambda data: tsj.s_filter(data, cutoff), [ratio * cutoff], 3.0, **options)
    assert gaussian.mean[0, 0] == pytest.approx(0.5 ** (1 / ratio**2), abs=2e-3)
    spline = tsj.transmission(lambda data: spline_filter(data, cutoff), [ratio * cutoff], **options)
    assert spline.mean[0, 0] == pytest.approx(1 / (1 + ratio**-4), abs=0.02)


def test_transmission_of_the_identity_and_of_nothing():
    """All of a wave, and none; amplitudes and wavelengths keep their places."""
    identity = tsj.transmission(lambda data: data, [4.0, 9.0], [1.0, 2.0, 3.0], spacing=1.0, phases=2)
    np.testing.assert_allclose(identity.ratios, 1.0, atol=1e-12)
    assert identity.mean.shape == (3, 2)
    nothing = tsj.transmission(lambda data: data.with_heights(0 * data.heights), [4.0], spacing=1.0, phases=2)
    np.testing.assert_allclose(nothing.ratios, 0.0, atol=1e-12)


def test_a_tolerance_lets_high_waves_through():
    """A non-linear filter depends on the amplitude: waves below the tolerance go, those far above it stay."""
    curve = tsj.transmission(
        lambda data: tsj.filter(data, tolerance=1.0, cutoff=24.0), [8.0], [0.25, 10.0], spacing=1.0, directions=[0.0],
        phases=1, margin=12.0,
    )  # fmt: skip
    low, high = curve.mean[:, 0]
    assert low < 0.05
    assert high > 0.9


def test_transmission_refuses():
    """Waves that the pixels cannot show, lengths that are none, filters that change the shape."""
    with pytest.raises(tsj.InputError, match="two pixels"):
        tsj.transmission(lambda data: data, [1.0], spacing=1.0)
    with pytest.raises(tsj.InputError, match="amplitudes are numbers above zero"):
        tsj.transmission(lambda data: data, [4.0], [0.0])
    with pytest.raises(tsj.InputError, match="same shape"):
        tsj.transmission(lambda data: tsj.HeightMap(np.ones((3, 4))), [4.0])
