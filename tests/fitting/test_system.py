"""The quadratic form of a fit equals the dense normal equations built from evaluated blending functions."""

import jax.numpy as jnp
import numpy as np
import pytest

from tsplinejax.fitting._direct import solve_directly
from tsplinejax.fitting._residuals import all_residuals, residuals
from tsplinejax.fitting._solve import conjugate_gradients
from tsplinejax.fitting._store import Chosen, Members, choose, choose_among, renew_points
from tsplinejax.fitting._system import System
from tsplinejax.space import pad, to_device

from .problems import CASES, EXTENT, Case, dense_system


def as_dense(system: System, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Element matrices and loads added up."""
    functions = np.maximum(np.asarray(system.functions), 0)
    matrix, load = np.zeros((n, n)), np.zeros((n, system.loads.shape[2]))
    np.add.at(matrix, (functions[:, :, None], functions[:, None]), np.asarray(system.matrices))
    np.add.at(load, functions, np.asarray(system.loads))
    return matrix, load


def solve(
    system: System, case: Case, iterations: int = 3000, free: np.ndarray | None = None, start=None, among: bool = False
):
    """Conjugate gradients to the end, from zero, over all control points unless told otherwise."""
    capacity, n = case.mesh.capacity, case.tmesh.n_anchors
    start = jnp.zeros((capacity, case.dimension)) if start is None else start
    free = np.ones(n, bool) if free is None else free
    affected = case.mesh.slots[case.mesh.touched_by(free)]
    mask = jnp.asarray(pad(free, capacity, False))
    chosen = choose_among(affected, len(case.mesh.slots), capacity) if among else choose(affected, capacity)
    return conjugate_gradients(
        system, chosen, start, mask, jnp.asarray(iterations), jnp.asarray(1e-15), jnp.asarray(0.0)
    )


@pytest.mark.parametrize(
    ("name", "smoothing"),
    [*((name, 0.0) for name in CASES), *((name, 1e-3) for name in ("closure", "hole", "points in space", "pixels"))],
)
def test_normal_equations(name, smoothing):
    """Weights, bending energy, points in space, holes, and the rational form: same matrix, same right-hand side."""
    case = CASES[name]()
    matrix, load = dense_system(case, smoothing)
    found, found_load = as_dense(case.system(smoothing), case.tmesh.n_anchors)
    np.testing.assert_allclose(found, matrix, atol=1e-11 * np.abs(matrix).max())
    np.testing.assert_allclose(found_load, load, atol=1e-11 * np.abs(load).max())


@pytest.mark.parametrize("name", ["closure", "hole", "points in space"])
@pytest.mark.parametrize("share", [0.2, 0.6, 1.0])
def test_rows_picked_or_read_in_place(name, share):
    """A solve is the same whether its elements are listed, or are members of a store that is read as a whole."""
    case = CASES[name]()
    free = np.random.default_rng(5).random(case.tmesh.n_anchors) < share
    listed, among = (solve(case.system(1e-3), case, 8, free, among=flag) for flag in (False, True))
    assert isinstance(choose_among(case.mesh.slots, len(case.mesh.slots), case.mesh.capacity), Members)
    np.testing.assert_allclose(among.coefficients, listed.coefficients, rtol=0, atol=1e-13)
    assert np.abs(listed.coefficients).max() > 0.01


def test_few_of_many_rows_are_listed():
    """Only where few rows of many are meant are they picked one by one."""
    assert isinstance(choose_among(np.arange(100), 100_000, 131_072), Chosen)
    assert isinstance(choose_among(np.arange(60_000), 100_000, 131_072), Members)


@pytest.mark.parametrize("name", ["closure", "hole", "points in space", "rational"])
def test_conjugate_gradients_against_dense(name):
    """The iterations end at the dense solution of a regularised system."""
    case = CASES[name]()
    smoothing = 0.0 if case.rational else 1e-4
    matrix, load = dense_system(case, smoothing)
    expected = case.basis() @ np.linalg.lstsq(matrix, load, rcond=None)[0]
    solution = solve(case.system(smoothing), case)
    found = case.basis() @ np.asarray(solution.coefficients)[: case.tmesh.n_anchors]
    np.testing.assert_allclose(found, expected, atol=1e-8)


def test_direct_solution():
    """The sparse factorisation gives the dense solution, too, and keeps what neither samples nor energy reach."""
    case = CASES["hole"]()
    matrix, load = dense_system(case, 1e-4)
    start = jnp.zeros((case.mesh.capacity, 1))
    found = solve_directly(case.system(1e-4), start, case.tmesh.n_anchors)
    np.testing.assert_allclose(np.asarray(found)[: case.tmesh.n_anchors], np.linalg.solve(matrix, load), atol=1e-8)
    assert not np.asarray(found)[case.tmesh.n_anchors :].any()
    bare = case.system(0.0)
    unseen = np.diagonal(dense_system(case, 0.0)[0]) == 0
    kept = solve_directly(bare, start + 7.0, case.tmesh.n_anchors)
    if kept is not None:
        np.testing.assert_array_equal(np.asarray(kept)[: case.tmesh.n_anchors][unseen], 7.0)


def test_every_iteration_lowers_the_objective():
    """From any start, more iterations never give a higher objective."""
    case = CASES["hole"]()
    matrix, load = dense_system(case, 1e-6)
    system = case.system(1e-6)
    start = jnp.asarray(np.random.default_rng(0).normal(size=(case.mesh.capacity, 1)))
    objectives = []
    for iterations in (0, 1, 2, 5, 10, 40, 200):
        x = np.asarray(solve(system, case, iterations, start=start).coefficients)[: case.tmesh.n_anchors]
        objectives.append(float(np.sum(x * (matrix @ x - 2 * load))))
    assert (np.diff(objectives) <= 1e-12 * abs(objectives[0])).all()


def test_frozen_coefficients_stay():
    """Only the free coefficients move, to the minimum over them."""
    case = CASES["closure"]()
    matrix, load = dense_system(case, 1e-4)
    generator, n = np.random.default_rng(1), case.tmesh.n_anchors
    free = generator.random(n) < 0.4
    start = generator.normal(size=(n, 1))
    device = jnp.asarray(pad(start, case.mesh.capacity, 0.0))
    found = np.asarray(solve(case.system(1e-4), case, free=free, start=device).coefficients)[:n]
    np.testing.assert_array_equal(found[~free], start[~free])
    rest = load[free] - matrix[np.ix_(free, ~free)] @ start[~free]
    np.testing.assert_allclose(found[free], np.linalg.solve(matrix[np.ix_(free, free)], rest), atol=1e-8)


@pytest.mark.parametrize("name", CASES)
def test_residuals(name):
    """Value minus surface at every sample; an element's largest and sums of squares are of those with weight."""
    case = CASES[name]()
    coefficients = np.random.default_rng(2).normal(size=(case.tmesh.n_anchors, case.dimension))
    padded, slots = to_device(pad(coefficients, case.mesh.capacity, 0.0)), case.mesh.slots
    every = choose(slots, case.mesh.capacity)
    store, _ = renew_points(case.store(), padded, to_device(EXTENT), case.lattice, every)
    assert store.points.shape[-1] == case.dimension + case.rational
    expected = case.values - case.basis() @ coefficients
    found = all_residuals(case.samples, case.mesh, store.points, store.boxes, case.lattice)
    np.testing.assert_allclose(found, expected, atol=1e-11)
    rest = residuals(case.samples, case.mesh, np.arange(len(slots)), store.points, store.boxes, case.lattice)
    element, counted = case.element_of_samples(), case.weights > 0
    squares = np.sum(expected**2, axis=1)
    largest = np.zeros(len(slots))
    np.maximum.at(largest, element[counted], np.sqrt(squares[counted]))
    np.testing.assert_allclose(rest.largest, largest, atol=1e-11)
    np.testing.assert_allclose(rest.weighted, np.bincount(element, case.weights * squares, len(slots)), atol=1e-10)
    np.testing.assert_allclose(rest.plain, np.bincount(element, squares * counted, len(slots)), atol=1e-10)
