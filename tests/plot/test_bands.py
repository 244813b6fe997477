"""Pictures of filters and of bands: what they draw is what was measured."""

from types import SimpleNamespace

import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax.plot import plot_bands, plot_filtered, plot_transmission


@pytest.fixture
def curve() -> tsj.Transmission:
    """Two amplitudes, three wavelengths, two directions, two phases."""
    ratios = np.linspace(0.05, 0.95, 24).reshape(2, 3, 2, 2)
    lengths, amplitudes = np.array([4.0, 8.0, 16.0]), np.array([0.1, 1.0])
    return tsj.Transmission(lengths, amplitudes, np.array([0.0, 45.0]), np.array([0.0, np.pi]), ratios, "µm")


def test_transmission_has_a_line_an_amplitude(curve):
    """Means are dots over the wavelength, spreads are bars, and the definition passes through one half at λc."""
    ax = plot_transmission(curve, cutoff=8.0)
    lines = {line.get_label(): line for line in ax.lines}
    for k, label in enumerate(("amplitude 0.1 µm", "amplitude 1 µm")):
        np.testing.assert_allclose(lines[label].get_ydata(), curve.ratios[k].mean(axis=(1, 2)))
    defined = next(line for label, line in lines.items() if "lambda" in str(label))
    assert np.interp(8.0, defined.get_xdata(), defined.get_ydata()) == pytest.approx(0.5, abs=1e-3)
    bars = np.array(ax.collections[0].get_segments())
    np.testing.assert_allclose(bars[:, :, 1], np.stack([curve.ratios[0].min((1, 2)), curve.ratios[0].max((1, 2))], 1))
    assert (ax.get_xscale(), ax.get_xlabel(), ax.get_ylabel()) == ("log", "wavelength (µm)", "transmission")
    ax.figure.canvas.draw()


def test_transmission_without_units_or_definition(curve):
    """Lengths without a unit, and no cut-off, are drawn without them, on axes that are given."""
    import matplotlib.pyplot as plt

    bare = tsj.Transmission(curve.wavelengths, np.arange(1.0, 4.0), curve.directions, curve.phases, curve.ratios, None)
    bare = SimpleNamespace(**{**vars(bare), "mean": bare.mean[[0, 1, 1]], "ratios": bare.ratios[[0, 1, 1]]})
    given = plt.figure().add_subplot()
    assert plot_transmission(bare, given) is given
    assert given.get_xlabel() == "wavelength"
    assert len(given.lines) == 3


def test_filtered_shows_both_parts(height_map):
    """The filtered map and what was taken off stand side by side."""
    half = height_map.with_heights(height_map.heights / 2)
    figure = plot_filtered(SimpleNamespace(filtered=half, residual=half))
    assert [ax.get_title() for ax in figure.axes if ax.get_title()] == ["filtered", "taken off"]
    left, right = (ax.images[0] for ax in figure.axes[:2])
    low, high = right.get_clim()
    assert high == pytest.approx(-low)  # diverging, symmetric about zero
    assert left.get_clim()[1] < right.get_clim()[1] or left.get_clim()[0] > low
    figure.canvas.draw()


def test_bands_are_named_by_their_waves_and_sq(height_map):
    """Each band has a panel with its wavelengths and Sq, then come their sum and the remainder; the rest is empty."""
    band = {"heights": height_map, "sq": 3e-5}
    analysis = SimpleNamespace(
        bands=(
            SimpleNamespace(**band, shortest=0.5, longest=np.inf),
            SimpleNamespace(**band, shortest=0.25, longest=0.5),
        ),
        fitted=height_map,
        remainder=height_map,
        sq_fitted=4e-5,
        sq_remainder=1e-5,
        unit="mm",
    )
    figure = plot_bands(analysis)
    titles = [ax.get_title() for ax in figure.axes if ax.get_title()]
    assert [title.splitlines()[1] for title in titles] == ["Sq 30 nm", "Sq 30 nm", "Sq 40 nm", "Sq 10 nm"]
    assert [title.splitlines()[0] for title in titles][2:] == ["sum of the bands", "remainder"]
    assert titles[0].startswith("waves above 0.5 mm")
    assert titles[1].startswith("waves of 0.25 to 0.5 mm")
    assert sum(not ax.axison for ax in figure.axes) == 2
    figure.canvas.draw()
