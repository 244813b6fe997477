"""Elimination: the step equals that of the whole Jacobian, written out densely."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax.mesh import b_lattice, refine
from tsplinejax.orthogonal._descent import eliminating
from tsplinejax.orthogonal._prepare import pose
from tsplinejax.orthogonal._problem import Unknowns, residuals
from tsplinejax.orthogonal._round import beginning
from tsplinejax.orthogonal._solve import solve, trace_of_damping
from tsplinejax.orthogonal._system import assemble, blocks_of, dense, follow, multiply
from tsplinejax.space import spline_space

from .problems import saddle


@pytest.fixture(params=[tsj.Joint(slip=0.3), tsj.Normal()], ids=["joint", "normal"])
def case(request):
    """A problem over a mesh with T-junctions, and an iterate of it inside the square."""
    generator = np.random.default_rng(1)
    space = spline_space(refine(b_lattice(2, 2), np.arange(4) == 2).mesh)
    points = saddle(400, noise=0.05)
    parameters = points[:, :2] / 2.2 + 0.5
    assert parameters.min() > 0
    assert parameters.max() < 1
    surface = tsj.make_surface(space, tsj.lstsq(space, parameters, points))
    problem = pose(surface, points, generator.uniform(0.5, 2, 400), parameters, request.param, 1e-3, (2.0, 1.0))
    n = int(space.n_functions)
    moves = jnp.zeros_like(problem.hold).at[:n].set(0.01 * generator.normal(size=(n, problem.hold.shape[1])))
    return n, problem, Unknowns(moves, beginning(problem, parameters).parameters)


def test_a_step_is_that_of_the_whole_jacobian(case):
    """Eliminating every point's block and going back gives the Gauss-Newton step of all unknowns together."""
    n, problem, unknowns = case
    r, m = problem.hold.shape[1], 400
    real = eqx.tree_at(lambda one: (one.points, one.weights), problem, (problem.points[:m], problem.weights[:m]))
    unknowns = Unknowns(unknowns.moves, unknowns.parameters[:m])

    def stacked(moves, parameters):
        full = unknowns.moves.at[:n].set(moves)
        return jnp.concatenate([part.ravel() for part in residuals(Unknowns(full, parameters), real)])

    value = stacked(unknowns.moves[:n], unknowns.parameters)
    jacobians = jax.jacfwd(stacked, argnums=(0, 1))(unknowns.moves[:n], unknowns.parameters)
    J = np.concatenate([np.asarray(part).reshape(len(value), -1) for part in jacobians], axis=1)
    expected = -np.linalg.lstsq(J, np.asarray(value), rcond=None)[0]
    system = assemble(real, unknowns)
    moves = -solve(system, problem.hold, system.gradient)
    step = follow(real, unknowns, moves)
    np.testing.assert_allclose(np.asarray(moves)[:n].ravel(), expected[: n * r], atol=1e-8)
    np.testing.assert_allclose(np.asarray(step).ravel(), expected[n * r :].reshape(m, 2).ravel(), atol=1e-8)
    assert not np.asarray(moves)[n:].any()


def test_the_matrix_in_all_its_forms(case):
    """Products, the dense matrix and the diagonal blocks are one matrix, positive and symmetric."""
    _, problem, unknowns = case
    system = assemble(problem, unknowns)
    matrix = np.asarray(dense(system, problem.hold))
    x = np.random.default_rng(0).normal(size=problem.hold.shape)
    np.testing.assert_allclose(np.asarray(multiply(system, problem.hold, jnp.asarray(x))).ravel(), matrix @ x.ravel())
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-9 * np.abs(matrix).max())
    assert np.linalg.eigvalsh(matrix).min() > -1e-9 * np.abs(matrix).max()
    r = x.shape[1]
    np.testing.assert_allclose(np.asarray(blocks_of(system, problem.hold))[0], matrix[:r, :r])


def test_damping_is_a_trace():
    """Enough for a singular matrix, little beside rounding of the data."""
    assert trace_of_damping(np.dtype(np.float64)) < 1e-9 < trace_of_damping(np.dtype(np.float32))


def test_solvers_of_optimistix_keep_their_search(case):
    """Levenberg-Marquardt and Gauss-Newton receive the elimination as their descent; others are refused."""
    import optimistix as optx

    _, problem, _ = case
    solver = eliminating(optx.LevenbergMarquardt(rtol=1e-8, atol=1e-8), problem)
    assert solver.descent.damped
    assert isinstance(solver.search, optx.ClassicalTrustRegion)
    assert not eliminating(optx.GaussNewton(rtol=1e-8, atol=1e-8), problem).descent.damped
    with pytest.raises(tsj.InputError, match="optimistix"):
        eliminating(optx.BFGS(rtol=1e-8, atol=1e-8), problem)
