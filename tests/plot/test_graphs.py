"""Convergence, tolerance study, views in space and the overview."""

import numpy as np
import pytest

from tsplinejax._errors import InputError
from tsplinejax.data import Frame
from tsplinejax.plot import plot_convergence, plot_overview, plot_surface_3d, plot_tolerance_study


def _legend(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def test_convergence_shows_both_errors_and_the_tolerance(result):
    """Both errors are drawn at every step's control points, on logarithmic axes, with the tolerance and its stages."""
    ax = plot_convergence(result)
    assert (ax.get_xscale(), ax.get_yscale(), ax.get_ylabel()) == ("log", "log", "error (nm)")
    assert _legend(ax) == ["largest error", "rms error", r"tolerance $\varepsilon$", "tolerance of the stage"]
    largest = next(line for line in ax.lines if line.get_label() == "largest error")
    np.testing.assert_array_equal(largest.get_xdata(), [step.control_points for step in result.history])
    np.testing.assert_array_equal(largest.get_ydata(), [step.max_error for step in result.history])


def test_convergence_of_a_history_alone(result):
    """A bare history, of a single exact step even, is drawn without a unit."""
    ax = plot_convergence(result.history)
    assert ax.get_ylabel() == "error"
    exact = result.history[-1]
    exact.max_error = exact.rms_error = 0.0
    plot_convergence([exact]).figure.canvas.draw()


def test_empty_history_is_refused():
    """There is nothing to draw before the first step."""
    with pytest.raises(InputError, match="at least one step"):
        plot_convergence([])


def test_tolerance_study_names_the_counts(study):
    """Each tolerance's control points are drawn and written beside the point."""
    ax = plot_tolerance_study(study)
    assert ax.get_xlabel() == "tolerance (nm)"
    assert [text.get_text() for text in ax.texts] == ["16\N{THIN SPACE}000", "9800", "9000"]


def test_heights_are_exaggerated_and_say_so(surface):
    """Nanometres on a millimetre map are drawn higher, with the factor stated; row 0 is at the back."""
    ax = plot_surface_3d(surface)
    assert "exaggerated" in ax.get_title()
    assert ax.get_zlabel() == "z (nm)"
    assert ax.yaxis.get_inverted()
    ax.figure.canvas.draw()


def test_models_in_space_have_equal_axes(surface_in_space):
    """A model in space is drawn to scale and right-handed."""
    ax = plot_surface_3d(surface_in_space)
    scale = ax.get_box_aspect() / [np.ptp(ax.get_xlim()), np.ptp(ax.get_ylim()), np.ptp(ax.get_zlim())]
    np.testing.assert_allclose(scale, scale[0], rtol=1e-6)
    assert not ax.yaxis.get_inverted()
    assert not ax.get_title()


def test_flat_and_unitless_surfaces_are_drawn(surface):
    """A surface without relief and without units gives a picture, and claims no exaggeration."""

    class Flat:
        frame = Frame((0.0, 0.0), (1.0, 1.0))

        def __call__(self, parameters):
            return np.zeros(len(parameters))

    ax = plot_surface_3d(Flat())
    ax.figure.canvas.draw()
    assert not ax.get_title()


def test_overview_has_four_panels(result, tmp_path):
    """A fit's page holds four lettered panels and is saved as a picture."""
    figure = plot_overview(result)
    letters = [text.get_text() for ax in figure.get_axes() for text in ax.texts]
    assert letters == ["(a)", "(b)", "(c)", "(d)"]
    figure.savefig(tmp_path / "overview.png", dpi=60)
    assert (tmp_path / "overview.png").stat().st_size > 10_000


def test_overview_of_a_surface_alone(surface):
    """A surface without its fit has a mesh and a view in space."""
    figure = plot_overview(surface)
    assert [text.get_text() for ax in figure.get_axes() for text in ax.texts] == ["(a)", "(b)"]
