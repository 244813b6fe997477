"""The quadratic form of a fit equals the dense normal equations built from evaluated blending functions."""

import jax.numpy as jnp
import numpy as np
import pytest

from tsplinejax.fitting._direct import solve_directly
from tsplinejax.fitting._discretisation import discretise, same_elements, unaltered_functions
from tsplinejax.fitting._moments import add_samples, empty_moments
from tsplinejax.fitting._residuals import homogeneous_points, residuals
from tsplinejax.fitting._solve import conjugate_gradients
from tsplinejax.fitting._system import System, assemble, empty_system, inherit_system, restrict
from tsplinejax.mesh import refine
from tsplinejax.space import pad

from .problems import CASES, EXTENT, TILE, Case, dense_system, make_case, refined

SIDES = jnp.asarray(EXTENT)


def system_of(case: Case, smoothing: float) -> System:
    """The assembled system of a case."""
    every = np.arange(len(case.mesh.elements))
    empty = empty_system(case.mesh.space, case.values.shape[1])
    return assemble(empty, case.mesh.space, case.moments(), smoothing, SIDES, every)


def as_dense(system: System, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Element matrices and loads added up."""
    functions = np.asarray(system.functions)
    matrix, load = np.zeros((n, n)), np.zeros((n, system.loads.shape[2]))
    np.add.at(matrix, (functions[:, :, None], functions[:, None]), np.asarray(system.matrices))
    np.add.at(load, functions, np.asarray(system.loads))
    return matrix, load


def solve(system: System, case: Case, iterations: int = 3000, free: np.ndarray | None = None, start=None):
    """Conjugate gradients to the end, from zero, over all control points unless told otherwise."""
    capacity, d, n = case.mesh.capacity, case.values.shape[1], case.tmesh.n_anchors
    start = jnp.zeros((capacity, d)) if start is None else start
    free = np.ones(n, bool) if free is None else free
    return conjugate_gradients(
        system, start, jnp.asarray(pad(free, capacity, False)), jnp.asarray(iterations), jnp.asarray(1e-15)
    )


@pytest.mark.parametrize(
    ("name", "smoothing"),
    [*((name, 0.0) for name in CASES), *((name, 1e-3) for name in ("closure", "hole", "points in space"))],
)
def test_normal_equations(name, smoothing):
    """Weights, bending energy, points in space, holes, and the rational form: same matrix, same right-hand side."""
    case = CASES[name]()
    matrix, load = dense_system(case, smoothing)
    found, found_load = as_dense(system_of(case, smoothing), case.tmesh.n_anchors)
    np.testing.assert_allclose(found, matrix, atol=1e-11 * np.abs(matrix).max())
    np.testing.assert_allclose(found_load, load, atol=1e-11 * np.abs(load).max())


@pytest.mark.parametrize("name", ["closure", "hole", "points in space", "rational"])
def test_conjugate_gradients_against_dense(name):
    """The iterations end at the dense solution of a regularised system."""
    case = CASES[name]()
    smoothing = 0.0 if case.rational else 1e-4
    matrix, load = dense_system(case, smoothing)
    expected = case.basis() @ np.linalg.lstsq(matrix, load, rcond=None)[0]
    solution = solve(system_of(case, smoothing), case)
    found = case.basis() @ np.asarray(solution.coefficients)[: case.tmesh.n_anchors]
    np.testing.assert_allclose(found, expected, atol=1e-8)


def test_direct_solution():
    """The sparse factorisation gives the dense solution, too, and keeps what neither samples nor energy reach."""
    case = CASES["hole"]()
    matrix, load = dense_system(case, 1e-4)
    start = jnp.zeros((case.mesh.capacity, 1))
    found = solve_directly(system_of(case, 1e-4), start, case.tmesh.n_anchors)
    np.testing.assert_allclose(np.asarray(found)[: case.tmesh.n_anchors], np.linalg.solve(matrix, load), atol=1e-8)
    assert not np.asarray(found)[case.tmesh.n_anchors :].any()
    bare = system_of(case, 0.0)
    unseen = np.diagonal(dense_system(case, 0.0)[0]) == 0
    kept = solve_directly(bare, start + 7.0, case.tmesh.n_anchors)
    if kept is not None:
        np.testing.assert_array_equal(np.asarray(kept)[: case.tmesh.n_anchors][unseen], 7.0)


def test_every_iteration_lowers_the_objective():
    """From any start, more iterations never give a higher objective."""
    case = CASES["hole"]()
    matrix, load = dense_system(case, 1e-6)
    system = system_of(case, 1e-6)
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
    found = np.asarray(solve(system_of(case, 1e-4), case, free=free, start=device).coefficients)[:n]
    np.testing.assert_array_equal(found[~free], start[~free])
    rest = load[free] - matrix[np.ix_(free, ~free)] @ start[~free]
    np.testing.assert_allclose(found[free], np.linalg.solve(matrix[np.ix_(free, free)], rest), atol=1e-8)


def test_restriction_to_everything():
    """Restricted to all its elements, padded, a system stays the same: local over everything is global."""
    case = CASES["points in space"]()
    system = system_of(case, 1e-4)
    every = pad(np.arange(len(case.mesh.elements), dtype=np.int32), 1024, -1)
    local, whole = solve(restrict(system, jnp.asarray(every)), case), solve(system, case)
    np.testing.assert_allclose(local.coefficients, whole.coefficients, atol=1e-9)


def test_inherited_system():
    """After a refinement, inherited matrices and those of changed neighbourhoods are the system assembled anew."""
    case = make_case(refined(steps=1, lattice=(10, 8)))
    finer = refine(case.tmesh, np.arange(case.tmesh.n_elements) == 0).mesh
    mesh = discretise(finer, case.order, dtype=np.dtype(np.float64), rational=False, least_capacity=256)
    moments = add_samples(empty_moments(mesh.space, 1), mesh.space, case.samples, mesh.blocks, TILE)
    source = same_elements(case.mesh.elements, mesh.elements)
    kept = unaltered_functions(case.tmesh, finer)
    altered = (kept < 0)[mesh.elements.functions].any(axis=1) | (source < 0)
    assert 0 < altered.sum() < len(altered)
    device = jnp.asarray(pad(source.astype(np.int32), mesh.capacity, -1))
    inherited = inherit_system(system_of(case, 1e-4), mesh.space.tables.functions, device)
    updated = assemble(inherited, mesh.space, moments, 1e-4, SIDES, np.flatnonzero(altered))
    anew = assemble(empty_system(mesh.space, 1), mesh.space, moments, 1e-4, SIDES, np.arange(len(mesh.elements)))
    np.testing.assert_allclose(updated.matrices, anew.matrices, atol=1e-9)
    np.testing.assert_allclose(updated.loads, anew.loads, atol=1e-11)


@pytest.mark.parametrize("name", CASES)
def test_residuals(name):
    """Value minus surface at every sample; each block's largest and sums of squares are of those with weight."""
    case = CASES[name]()
    coefficients = np.random.default_rng(2).normal(size=(case.tmesh.n_anchors, case.values.shape[1]))
    points = homogeneous_points(case.mesh.space, jnp.asarray(pad(coefficients, case.mesh.capacity, 0.0)))
    assert points.shape[-1] == case.values.shape[1] + case.rational
    rest = residuals(case.mesh.space, points, case.samples, case.mesh.blocks, TILE)
    expected = case.values - case.basis() @ coefficients
    found = np.empty_like(expected)
    found[case.order.permutation] = rest.values()
    np.testing.assert_allclose(found, expected, atol=1e-11)
    squares = np.sum(expected**2, axis=1)
    assert rest.largest.max() == pytest.approx(np.sqrt(squares[case.weights > 0].max()))
    assert rest.weighted.sum() == pytest.approx(np.sum(case.weights * squares))
    assert rest.plain.sum() == pytest.approx(np.sum(squares[case.weights > 0]))
