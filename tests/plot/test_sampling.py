"""Samples over a mesh, and the study of their number."""

from types import SimpleNamespace

import numpy as np

from tsplinejax.plot import plot_samples, plot_sampling_study


def test_samples_stand_where_they_were_taken(surface):
    """Dots at x = x₀ + s Lx, y = y₀ + t Ly, over the T-mesh."""
    places = np.random.default_rng(0).random((50, 2))
    ax = plot_samples(places, surface)
    dots = ax.collections[-1].get_offsets()
    np.testing.assert_allclose(dots, places * surface.frame.extent + surface.frame.origin)


def test_a_study_has_a_line_a_strategy_and_draws_exact_ones_at_the_floor():
    """Errors are drawn as they are, round-off at 1e-12 of the range, the number of control points as a line."""
    study = SimpleNamespace(
        strategies=("greville", "random"),
        sizes=(120, 400),
        rms_errors=np.array([[1e-19, 0.0], [3e-3, 1e-4]]),
        control_points=100,
        range=2.0,
        unit="mm",
    )
    ax = plot_sampling_study(study)
    lines = {line.get_label(): line for line in ax.lines}
    np.testing.assert_array_equal(lines["random"].get_ydata(), [3e-3, 1e-4])
    np.testing.assert_array_equal(lines["greville"].get_ydata(), [2e-12, 2e-12])
    assert ax.lines[-1].get_xdata()[0] == 100
    assert ax.get_ylabel() == "rms error (µm)"
    ax.figure.canvas.draw()
