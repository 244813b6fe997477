"""`fit`: every reason to stop is reached and told, budgets are kept, and misuse is refused with the rule it breaks."""

import subprocess
import sys

import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax import HeightMap, InputError, PointCloud, Samples
from tsplinejax.fitting import StopReason, _run

from .surfaces import bump

NOISY = bump() + 0.05 * np.random.default_rng(0).normal(size=(60, 80))


def test_stops_at_the_tolerance():
    """Met: converged, nothing to warn of."""
    result = tsj.fit(bump(), tolerance=1e-3)
    assert (result.stop, result.converged, result.warnings) == (StopReason.TOLERANCE, True, ())
    assert result.tolerance == 1e-3


def test_stops_at_the_noise():
    """A known noise is met with far fewer control points than samples, and the truth is nearer than the data."""
    result = tsj.fit(NOISY, noise=0.05)
    assert (result.stop, result.converged, result.noise) == (StopReason.NOISE, True, 0.05)
    assert result.control_points < 0.2 * NOISY.size
    truth = np.asarray(result.surface(result.samples.parameters)) - bump().ravel()
    assert np.sqrt(np.mean(truth**2)) < 0.02


def test_noise_is_estimated_by_default():
    """Without a criterion the noise is estimated from the data."""
    result = tsj.fit(NOISY)
    assert result.noise == pytest.approx(0.05, rel=0.15)
    assert result.stop is StopReason.NOISE


def test_stops_at_the_finest_mesh():
    """Contradicting duplicates cannot be interpolated: no element with samples of one place is split."""
    generator = np.random.default_rng(0)
    places = np.repeat(generator.random((60, 2)), 2, axis=0)
    values = generator.normal(size=120)
    result = tsj.fit(Samples(places, values), tolerance=1e-3, max_control_points=5000)
    assert result.stop is StopReason.FINEST
    assert not result.converged
    assert result.max_error > 1e-3
    assert "largest error left" in result.warnings[-1]


@pytest.mark.parametrize("steps", [0, 1, 3])
def test_stops_after_steps(steps):
    """No more refinement steps than allowed; zero leaves the start lattice."""
    result = tsj.fit(bump(), tolerance=1e-9, max_steps=steps, lattice=(6, 6))
    assert result.stop is StopReason.MAX_STEPS
    sizes = [step.control_points for step in result.history]
    assert len(set(sizes)) <= steps + 1
    assert "max_steps" in result.warnings[-1]


@pytest.mark.parametrize("limit", [81, 150, 151, 400])
def test_keeps_the_control_point_budget(limit):
    """No step of the history has more control points than allowed."""
    result = tsj.fit(bump(), tolerance=1e-9, max_control_points=limit, lattice=(6, 6))
    assert result.stop is StopReason.MAX_CONTROL_POINTS
    assert max(step.control_points for step in result.history) <= limit
    assert "max_control_points" in result.warnings[-1]


def test_the_start_lattice_keeps_the_budget():
    """The default lattice is no finer than the budget allows: it is never exceeded, not even at the start."""
    result = tsj.fit(bump(), tolerance=1e-9, max_control_points=30)
    assert result.stop is StopReason.MAX_CONTROL_POINTS
    assert max(step.control_points for step in result.history) <= 30


def test_default_budget_is_half_the_samples():
    """Without one given, control points stop at half the samples."""
    generator = np.random.default_rng(0)
    result = tsj.fit(generator.normal(size=(30, 40)), tolerance=1e-6)
    assert not result.converged
    assert max(step.control_points for step in result.history) <= 600


def test_stops_after_seconds():
    """A time budget that is used up at once still returns a surface."""
    result = tsj.fit(bump(), tolerance=1e-9, max_seconds=1e-6)
    assert result.stop is StopReason.MAX_SECONDS
    assert np.isfinite(result.residuals).all()


def test_interrupting_returns_the_best_step(monkeypatch):
    """Ctrl-C in the middle of a step gives the best step so far, not an error."""
    advance, calls = _run.advance, []

    def interrupted(problem, state):
        calls.append(state)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return advance(problem, state)

    monkeypatch.setattr(_run, "advance", interrupted)
    result = tsj.fit(bump(), tolerance=1e-6)
    assert result.stop is StopReason.INTERRUPTED
    assert not result.converged
    assert result.max_error == min(step.max_error for step in result.history)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("limit", [100, 200])
def test_the_best_step_is_returned(seed, limit):
    """The surface, its residuals and its figures belong together, and no step of the history was better."""
    heights = np.random.default_rng(seed).normal(size=(24, 24))
    result = tsj.fit(heights, tolerance=1e-3, max_control_points=limit)
    rest = np.abs(heights.ravel() - np.asarray(result.surface(result.samples.parameters)))
    assert result.max_error == pytest.approx(rest.max(), rel=1e-9)
    assert result.rms_error == pytest.approx(np.sqrt(np.mean(rest**2)), rel=1e-9)
    assert result.max_error <= min(step.max_error for step in result.history) * (1 + 1e-9)
    assert result.elements == result.surface.space.mesh.n_elements


def test_the_result_is_in_the_data_s_words():
    """Range, unit, frame, provenance and a readable line."""
    data = HeightMap(bump(), (2.0, 3.0), "µm", origin=(10.0, 20.0))
    result = tsj.fit(data, tolerance="2nm")
    assert result.tolerance == pytest.approx(2e-3)
    assert (result.unit, result.surface.unit) == ("µm", "µm")
    assert result.range == pytest.approx(data.range)
    assert result.surface.frame == data.frame
    assert result.provenance["options"]["tolerance"] == pytest.approx(2e-3)
    assert "control points" in repr(result)
    assert "µm" in repr(result)


@pytest.mark.parametrize(
    ("given", "value"), [("5nm", 0.005), ("0.005um", 0.005), ("5e-6mm", 0.005), (0.005, 0.005), ("0.005", 0.005)]
)
def test_tolerances_with_units(given, value):
    """A tolerance may carry a unit; a bare number is in the data's."""
    result = tsj.fit(HeightMap(bump(), (1.0, 1.0), "µm"), tolerance=given)
    assert result.tolerance == pytest.approx(value)
    assert result.max_error <= value


def test_relative_tolerance():
    """It is a share of max - min."""
    result = tsj.fit(7 * bump() + 100, relative_tolerance=0.01)
    assert result.tolerance == pytest.approx(0.01 * 7 * np.ptp(bump()))


def test_weights_count():
    """A sample of weight zero is not fitted, and a heavy one is fitted better than a light one."""
    heights = bump()
    spoiled, weights = heights.copy(), np.ones_like(heights)
    spoiled[30, 40] += 5
    weights[30, 40] = 0
    kept = tsj.fit(spoiled, tolerance=2e-3, weights=weights)
    assert kept.converged
    assert kept.max_error <= 2e-3
    assert kept.range == pytest.approx(np.ptp(heights))
    errors = []
    for weight in (1e-3, 1e3):
        weights[30, 40] = weight
        result = tsj.fit(spoiled, tolerance=1e-9, weights=weights, max_steps=0, lattice=(10, 10))
        errors.append(abs(result.residuals[30 * 80 + 40]))
    assert errors[1] < 0.1 * errors[0]


def test_robust_sets_spikes_aside():
    """Isolated spikes are found, left out, and reported; without `robust` they drive refinement."""
    heights = bump()
    places = np.random.default_rng(0).choice(heights.size, 4, replace=False)
    spoiled = heights.ravel().copy()
    spoiled[places] += 10
    spoiled = spoiled.reshape(heights.shape)
    result = tsj.fit(spoiled, tolerance=2e-3, robust=True)
    assert result.converged
    assert result.outliers[places].all()
    assert result.outliers.sum() <= 0.005 * heights.size
    assert np.abs(result.residuals[~result.outliers]).max() == pytest.approx(result.max_error)
    assert result.range == pytest.approx(np.ptp(heights), rel=0.05)
    plain = tsj.fit(spoiled, tolerance=2e-3, max_steps=4)
    assert any("robust" in warning for warning in plain.warnings)


def test_the_automatic_lattice_is_no_worse():
    """Trying start lattices never needs more control points than the default one."""
    heights = bump(60, 80, 0.06)
    plain, tried = (tsj.fit(heights, tolerance=2e-3, lattice=lattice) for lattice in (None, "auto"))
    assert tried.converged
    assert tried.control_points <= plain.control_points


def test_progress_goes_to_standard_error(capsys):
    """The progress bar leaves standard output alone."""
    tsj.fit(bump(), tolerance=1e-3, progress=True)
    assert capsys.readouterr().out == ""


LINE = np.column_stack([np.linspace(0, 1, 20), np.zeros(20), np.linspace(0, 1, 20)])
DATA = {
    "empty map": np.zeros((0, 5)),
    "empty cloud": np.zeros((0, 3)),
    "one pixel": np.ones((1, 1)),
    "one point": np.ones((1, 3)),
    "all NaN": np.full((6, 5), np.nan),
    "infinite": np.where(bump() > 0.9, np.inf, bump()),
    "a cloud with NaN": np.where(np.arange(3) == 2, np.nan, np.random.default_rng(0).random((30, 3))),
    "collinear points": LINE,
    "a single row": np.ones((1, 50)),
    "a single column": np.ones((50, 1)),
    "one dimension": np.ones(50),
    "three dimensions": np.ones((4, 4, 4)),
    "text": np.array([["a", "b"], ["c", "d"]]),
    "complex": bump() + 1j,
    "objects": np.array([[None, 1.0], [2.0, 3.0]]),
    "ragged": [[1.0, 2.0], [3.0]],
    "nothing": None,
    "a file name": "map.npy",
    "a dictionary": {"heights": 1},
}


@pytest.mark.parametrize("name", DATA)
def test_bad_data(name):
    """Data that are no surface are refused with an `InputError`, never with a traceback from inside."""
    with pytest.raises(InputError) as caught:
        tsj.fit(DATA[name], tolerance=1e-3)
    assert len(str(caught.value)) > 20


OPTIONS = {
    "negative tolerance": {"tolerance": -1.0},
    "zero tolerance": {"tolerance": 0.0},
    "NaN tolerance": {"tolerance": np.nan},
    "infinite tolerance": {"tolerance": np.inf},
    "tolerance in words": {"tolerance": "small"},
    "a unit for data without one": {"tolerance": "5nm"},
    "negative relative tolerance": {"relative_tolerance": -0.1},
    "NaN relative tolerance": {"relative_tolerance": np.nan},
    "negative noise": {"noise": -0.1},
    "NaN noise": {"noise": np.nan},
    "noise in words": {"noise": "loud"},
    "two criteria": {"tolerance": 0.1, "relative_tolerance": 0.1},
    "two other criteria": {"tolerance": 0.1, "noise": "auto"},
    "three criteria": {"tolerance": 0.1, "relative_tolerance": 0.1, "noise": 0.1},
    "a lattice of zero": {"lattice": (0, 4)},
    "a lattice of halves": {"lattice": (2.5, 4)},
    "a lattice of one number": {"lattice": 8},
    "a lattice of three numbers": {"lattice": (2, 2, 2)},
    "a lattice in words": {"lattice": "fine"},
    "an unknown first cut": {"first_cut": "x"},
    "negative smoothing": {"smoothing": -1.0},
    "NaN smoothing": {"smoothing": np.nan},
    "smoothing in words": {"smoothing": "much"},
    "too few weights": {"weights": np.ones(3)},
    "negative weights": {"weights": -np.ones((60, 80))},
    "NaN weights": {"weights": np.full((60, 80), np.nan)},
    "no weights left": {"weights": np.zeros((60, 80))},
    "negative steps": {"max_steps": -1},
    "NaN seconds": {"max_seconds": np.nan},
    "zero control points": {"max_control_points": 0},
    "another precision": {"dtype": "float16"},
    "an unknown precision": {"dtype": "double-double"},
    "a map as a surface in space": {"as_surface": True},
    "a solver in words": {"solver": "local"},
    "a refinement in words": {"refinement": "dyadic"},
}


@pytest.mark.parametrize("name", OPTIONS)
def test_bad_options(name):
    """Options that make no sense are refused with the rule, what was received, and a remedy."""
    options = {"tolerance": 1e-2, **OPTIONS[name]} if "noise" not in str(OPTIONS[name]) else OPTIONS[name]
    if "relative_tolerance" in OPTIONS[name] and len(OPTIONS[name]) == 1:
        options = OPTIONS[name]
    with pytest.raises(InputError) as caught:
        tsj.fit(bump(), **options)
    assert len(str(caught.value)) > 20


def test_relative_tolerance_of_a_constant():
    """A share of no range says nothing: refused, with the way out."""
    with pytest.raises(InputError, match="constant"):
        tsj.fit(np.ones((20, 20)), relative_tolerance=0.01)


def test_contradicting_duplicates_are_not_interpolated():
    """Two heights at one place cannot both be met: a smoothed fit to a tolerance above their distance can."""
    generator = np.random.default_rng(0)
    places = np.concatenate([generator.random((100, 2)), [[0.5, 0.5], [0.5, 0.5]]])
    values = np.concatenate([np.sin(places[:100, 0]), [0.4, 0.5]])
    met = tsj.fit(Samples(places, values), tolerance=0.1)
    assert met.converged
    unmet = tsj.fit(Samples(places, values), tolerance=0.01)
    assert not unmet.converged
    assert unmet.max_error >= 0.05 - 1e-6


def test_few_samples_are_fine_when_smoothed():
    """Three points, duplicates and constants are no error for an absolute tolerance."""
    assert tsj.fit(PointCloud(np.array([[0, 0, 1.0], [1, 0, 2], [0, 1, 3]])), tolerance=0.01).converged
    assert tsj.fit(np.ones((20, 20)), tolerance=1e-6).converged
    assert tsj.fit(np.ones((2, 2)), tolerance=1e-6).converged


def test_double_precision_without_x64():
    """With 64-bit mode off, float64 data are refused with the line to add; accepting float32 works."""
    code = """
import numpy as np, tsplinejax as tsj
heights = np.outer(np.linspace(0, 1, 20), np.linspace(0, 1, 30)) ** 2
try:
    tsj.fit(heights, tolerance=1e-3)
except tsj.InputError as error:
    assert "jax_enable_x64" in str(error) and "float32" in str(error), error
else:
    raise SystemExit("float64 was accepted")
result = tsj.fit(heights, tolerance=1e-3, dtype="float32")
assert result.converged and result.surface.control_points.dtype == np.float32
assert tsj.fit(heights.astype(np.float32), tolerance=1e-3).converged
"""
    run = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
