"""The adaptive loop: monotone objectives, local and global solves, the paper's baseline, and driving it by hand."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax.fitting import Marking, StopReason, advance, begin, pose_fit, terminate
from tsplinejax.fitting._adaptive import polish, residuals_of, taken_back
from tsplinejax.fitting._criteria import explained_squares
from tsplinejax.fitting._store import choose
from tsplinejax.mesh import Dyadic, b_lattice, is_analysis_suitable

from .problems import make_case, refined
from .surfaces import bump, random_surface

SOLVERS = {"global": tsj.GlobalSolver(), "local": tsj.LocalSolver(), "without ring": tsj.LocalSolver(ring=0)}
STEPS = 5


@pytest.mark.parametrize("solver", ["global", "local"])
@pytest.mark.parametrize("seed", range(12))
def test_the_objective_never_rises(seed, solver):
    """With the closure, fixed λ and weights, Σ w r² + λ E rises from no step to the next by more than 1e-10."""
    data, tolerance = random_surface(seed)
    result = tsj.fit(data, tolerance=tolerance, solver=SOLVERS[solver], smoothing=1e-7, lattice=(6, 6), max_steps=STEPS)
    objectives = [step.objective for step in result.history]
    assert len(objectives) > 1
    assert max(after / before - 1 for before, after in pairwise(objectives)) <= 1e-10


@pytest.mark.parametrize("weights", [False, True])
def test_monotone_with_weights_and_points_in_space(weights):
    """Sample weights and three components keep it so."""
    generator = np.random.default_rng(0)
    x, y = generator.random((2, 3000))
    points = np.stack([x + 0.05 * np.sin(6 * y), y, np.sin(7 * x * y)], axis=1)
    chosen = generator.uniform(0.1, 3, 3000) if weights else None
    cloud = tsj.PointCloud(points)
    result = tsj.fit(cloud, tolerance=2e-3, as_surface=True, weights=chosen, smoothing=1e-8)
    assert result.surface.control_points.shape[1] == 3
    objectives = [step.objective for step in result.history]
    assert max(after / before - 1 for before, after in pairwise(objectives)) <= 1e-10


def test_what_is_far_from_the_tolerance_is_bisected_twice():
    """A step halves both sides of marked elements that are far above it."""
    problem = pose_fit(bump(), tolerance=1e-4, lattice=(4, 4))
    state = begin(problem)
    boxes, excess = state.mesh.tmesh.boxes, state.excess
    next_state = advance(problem, state)
    far = (excess > problem.marking.twice) & (excess > next_state.stage)
    assert far.any()
    after = next_state.mesh.tmesh.boxes
    inside = (after[:, None, :2] >= boxes[:, :2]).all(axis=2) & (after[:, None, 2:] <= boxes[:, 2:]).all(axis=2)
    assert (inside.sum(axis=0)[far] == 4).all()
    once = replace(problem, marking=Marking(twice=np.inf))
    assert len(advance(once, begin(once)).mesh.tmesh.boxes) < len(after)


def test_a_polish_that_is_not_wanted_leaves_no_trace():
    """The state before it is back, device rows and all."""
    problem = pose_fit(bump(), tolerance=1e-2)
    state = advance(problem, begin(problem))
    before = residuals_of(problem, state)
    polished = polish(problem, state)
    assert np.abs(residuals_of(problem, polished) - before).max() > 1e-6
    again = taken_back(problem, polished, state)
    np.testing.assert_array_equal(residuals_of(problem, again), before)
    assert again.history == state.history
    assert len(advance(problem, again).history) == 3


def test_history_accounts_for_the_fit():
    """Errors, objective and signal-to-noise ratio of the last step are those of the residuals, summed by hand."""
    heights = bump() + 5
    weights = np.random.default_rng(0).uniform(0.5, 2, heights.shape)
    result = tsj.fit(heights, tolerance=1e-2, weights=weights, smoothing=0.0)
    last, rest = result.history[-1], result.residuals
    values = result.samples.values[:, 0]
    np.testing.assert_allclose(values - np.asarray(result.surface(result.samples.parameters)), rest, atol=1e-10)
    assert last.max_error == pytest.approx(np.abs(rest).max()) == result.max_error
    assert last.rms_error == pytest.approx(np.sqrt(np.mean(rest**2)))
    assert last.objective == pytest.approx(np.sum(weights.ravel() * rest**2))
    assert last.snr_db == pytest.approx(10 * np.log10(np.sum(values**2) / np.sum(rest**2)))
    centred = values - values.mean()
    assert last.snr_db_centred == pytest.approx(10 * np.log10(np.sum(centred**2) / np.sum(rest**2)))
    assert last.control_points == result.control_points == result.surface.control_points.shape[0]
    assert [step.step for step in result.history] == list(range(len(result.history)))


def test_start_lattice_is_the_first_entry():
    """The first entry is the start lattice's own least-squares fit."""
    heights = bump()
    result = tsj.fit(heights, tolerance=1e-3, lattice=(4, 5), smoothing=0.0)
    first = result.history[0]
    assert (first.elements, first.control_points) == (20, 7 * 8)
    space = tsj.spline_space(b_lattice(4, 5))
    points = tsj.lstsq(space, result.samples.parameters, heights.ravel())
    rest = heights.ravel() - np.asarray(tsj.make_surface(space, points)(result.samples.parameters))
    assert first.max_error == pytest.approx(np.abs(rest).max(), rel=1e-6)


@pytest.mark.parametrize("solver", SOLVERS)
def test_tolerance_is_met_at_every_sample(solver):
    """Every solver ends within the tolerance, on an analysis-suitable mesh."""
    result = tsj.fit(bump(), tolerance=1e-3, solver=SOLVERS[solver])
    assert result.stop is StopReason.TOLERANCE
    assert result.converged
    assert np.abs(result.residuals).max() <= 1e-3
    assert is_analysis_suitable(result.surface.space.mesh)


@pytest.mark.parametrize("solver", [tsj.LocalSolver(ring=0), tsj.GlobalSolver()])
def test_the_papers_algorithm(solver):
    """Dyadic refinement runs to its tolerance, with the rational form where the mesh needs it."""
    data, tolerance = random_surface(4)
    result = tsj.fit(data, tolerance=tolerance, refinement=Dyadic(), solver=solver, max_steps=4)
    assert result.stop in (StopReason.TOLERANCE, StopReason.FINEST, StopReason.MAX_CONTROL_POINTS, StopReason.MAX_STEPS)
    assert result.history[-1].elements > result.history[0].elements
    assert np.isfinite(result.residuals).all()
    surface = result.surface(result.samples.parameters)
    np.testing.assert_allclose(result.samples.values[:, 0] - np.asarray(surface), result.residuals, atol=1e-9)


def test_fewer_bezier_elements_after_a_step():
    """Without a closure a refinement can leave fewer Bézier elements than before; the fit goes on."""
    data, tolerance = random_surface(6)
    options = {"refinement": Dyadic(), "solver": tsj.LocalSolver(ring=0)}
    result = tsj.fit(data, tolerance=tolerance / 4, max_steps=8, **options)
    assert len(result.history) == 9


def test_the_paper_moves_only_altered_control_points():
    """With `LocalSolver(ring=0)` control points of functions that did not change keep their value."""
    heights = bump(80, 80, 0.04)
    coarse, fine = (
        tsj.fit(heights, tolerance=1e-6, lattice=(10, 10), max_steps=k, solver=tsj.LocalSolver(ring=0), smoothing=0.0)
        for k in (0, 1)
    )
    assert coarse.control_points == 169
    assert fine.stop is StopReason.MAX_STEPS


def test_driven_by_hand():
    """`begin`, `advance` and `terminate` are the loop: a notebook's own takes the steps that `fit` takes."""
    heights = bump()
    problem = pose_fit(heights, tolerance=2e-3, lattice=(6, 5), smoothing=1e-9)
    state = begin(problem)
    while (reason := terminate(problem, state)) is None:
        state = advance(problem, state)
    assert reason is StopReason.TOLERANCE
    result = tsj.fit(heights, tolerance=2e-3, lattice=(6, 5), smoothing=1e-9)
    by_hand, by_fit = ([step.control_points for step in steps] for steps in (state.history, result.history))
    assert by_fit == by_hand


def test_explained_squares():
    """The noise test's statistic is the drop of Σ w r² when an element gets a bicubic patch of its own."""
    case = make_case(refined(), count=2500)
    zeros, every = np.zeros((case.mesh.capacity, 4, 4, 1)), choose(case.mesh.slots, case.mesh.capacity)
    found = np.asarray(explained_squares(case.moments(), zeros, every))
    element = case.element_of_samples()
    for chosen in np.flatnonzero(np.bincount(element, case.weights > 0) > 30)[:4]:
        inside = element == chosen
        local = case.local_places(element)[inside]
        root = np.sqrt(case.weights[inside])
        powers = np.stack([local[:, 0] ** i * local[:, 1] ** j for i in range(4) for j in range(4)], axis=1)
        target = root * case.values[inside, 0]
        fitted = root[:, None] * powers @ np.linalg.lstsq(root[:, None] * powers, target, rcond=None)[0]
        assert found[chosen] == pytest.approx(float(fitted @ fitted), rel=1e-5)


@pytest.mark.parametrize(("size", "relative"), [(128, 0.1), (192, 0.05), (224, 0.02)])
def test_plate_with_particles(size, relative):
    """The plate with particles at several resolutions and tolerances: within it, with fewer points than pixels."""
    data = tsj.data.plate_with_particles((size, size))
    result = tsj.fit(data, relative_tolerance=relative)
    assert result.converged
    assert result.max_error <= relative * result.range
    assert result.control_points < 0.5 * data.heights.size


def test_stages_account_for_the_seconds():
    """Every step says where its time went, in stages that add up to nearly all of it."""
    result = tsj.fit(bump(), tolerance=1e-3)
    for step in result.history:
        assert set(step.stages) == {"topology", "functions", "moments", "solve", "residuals"}
        assert all(seconds >= 0 for seconds in step.stages.values())
        assert sum(step.stages.values()) <= step.seconds
