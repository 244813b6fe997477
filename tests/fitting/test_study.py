"""Tolerance studies: what each tolerance costs, from one fit, and three that make sense."""

import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax._errors import InputError
from tsplinejax.data import peaks
from tsplinejax.fitting import tolerance_study
from tsplinejax.plot import plot_tolerance_study


@pytest.fixture(scope="module")
def height_map():
    """A smooth surface in micrometres."""
    return tsj.HeightMap(peaks((60, 80)).heights, (0.5, 0.5), "µm")


@pytest.fixture(scope="module")
def study(height_map):
    """The study with its default tolerances."""
    return tolerance_study(height_map)


def test_each_tolerance_is_met_by_its_control_points(study):
    """The step that a tolerance's count comes from is within it, and tighter ones never take fewer."""
    assert (np.array(study.max_errors) <= study.tolerances).all()
    assert (np.diff(study.control_points) >= 0).all()
    assert (np.diff(study.tolerances) < 0).all()


def test_counts_are_those_of_a_fit(height_map, study):
    """A fit to one of the tolerances alone takes about as many control points."""
    for tolerance, count in list(zip(study.tolerances, study.control_points, strict=True))[::2]:
        alone = tsj.fit(height_map, tolerance=tolerance).control_points
        assert 0.8 * alone <= count <= 1.25 * alone


def test_three_are_suggested(study):
    """Coarse, medium and fine come from the table and say why."""
    assert [entry.name for entry in study.suggested] == ["coarse", "medium", "fine"]
    table = dict(zip(study.tolerances, study.control_points, strict=True))
    assert all(table[entry.tolerance] == entry.control_points for entry in study.suggested)
    assert all("% of the range" in entry.reason for entry in study.suggested)
    assert all(0 < entry.tolerance <= 0.1 * study.range for entry in study.suggested)


def test_tolerances_with_units(height_map):
    """Tolerances may name a unit; they come back in the data's, loosest first."""
    assert tolerance_study(height_map, ["100nm", "1um", 0.5]).tolerances == (1.0, 0.5, 0.1)


def test_units_do_not_change_the_study(height_map, study):
    """In nanometres the same tolerances are chosen and take the same control points."""
    other = tolerance_study(height_map.to_unit("nm"))
    np.testing.assert_allclose(other.tolerances, np.array(study.tolerances) * 1000)
    assert other.control_points == study.control_points


def test_a_budget_leaves_three_tolerances(height_map):
    """Where the budget ends the fit early there still are three, and a warning says why."""
    study = tolerance_study(height_map, max_control_points=100)
    assert len(study.suggested) == 3
    assert any("max_control_points" in warning for warning in study.warnings)
    assert "budget" in study.suggested[-1].reason


def test_spikes_are_set_aside(height_map):
    """A few bad pixels change neither range nor counts much."""
    spiked = height_map.heights.copy()
    spiked[[7, 30, 51], [9, 60, 33]] += 100
    study = tolerance_study(height_map.with_heights(spiked), [1.0])
    assert study.range < 20
    assert study.control_points == tolerance_study(height_map, [1.0]).control_points


@pytest.mark.parametrize(
    ("data", "tolerances", "message"),
    [
        (np.ones((20, 20)), None, "not constant"),
        (np.eye(20), [], "above zero"),
        (np.eye(20), [-1.0], "above zero"),
        (np.eye(20), ["5nm"], "no|none"),
        (np.eye(20), [1e-9], "none of the tolerances"),
    ],
)
def test_misuse(data, tolerances, message):
    """Constant data, bad lengths, and tolerances that none met are refused with the reason."""
    with pytest.raises(InputError, match=message):
        tolerance_study(data, tolerances, max_control_points=100)


def test_a_study_is_drawn_and_read(study):
    """Its picture has one marker a tolerance, and its repr the counts."""
    ax = plot_tolerance_study(study)
    assert len(ax.lines[0].get_xdata()) == len(study.tolerances)
    assert str(study.control_points[0]) in repr(study)
