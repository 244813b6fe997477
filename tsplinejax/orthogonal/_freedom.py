"""Effective degrees of freedom: the trace of what takes the points' normal distances to the fitted surface's."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..fitting import lstsq
from ..space import to_device
from ..surface import make_surface
from ._methods import AbstractFreeMethod, AbstractMethod
from ._prepare import pose
from ._problem import FootProblem, Unknowns
from ._round import Fitted, beginning
from ._solve import MOST_DENSE, solve, trace_of_damping
from ._system import NormalSystem, assemble, dense, multiply

PROBES = 12


def degrees_of_freedom(fitted: Fitted, method: AbstractMethod, smoothing: float) -> float:
    """tr A⁻¹ A₀, for A₀ the points' part of A: exact for small systems, else from random signs (Hutchinson)."""
    if not isinstance(method, AbstractFreeMethod):
        return _of_parametric(fitted, smoothing)
    request = fitted.request
    parameters = np.asarray(fitted.feet.parameters)
    problem = pose(fitted.surface, request.scaled, fitted.weights, parameters, method, smoothing, request.frame.extent)
    return float(_trace(problem, beginning(problem, parameters)))


_assembled = eqx.filter_jit(assemble)


def _trace(problem: FootProblem, unknowns: Unknowns) -> Array:
    """The trace for a free method."""
    bare = eqx.tree_at(lambda one: one.smoothing, problem, jnp.zeros_like(problem.smoothing))
    data, whole = _assembled(bare, unknowns), _assembled(problem, unknowns)
    if problem.hold.size <= MOST_DENSE:
        return _exact(data, whole, problem)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], size=(PROBES, *problem.hold.shape))
    return _estimated(data, whole, problem, to_device(signs, np.dtype(problem.hold.dtype)))


@eqx.filter_jit
def _exact(data: NormalSystem, whole: NormalSystem, problem: FootProblem) -> Array:
    """The trace by a factorisation."""
    (n, r), held = problem.hold.shape, _held(problem)
    columns = dense(data, jnp.zeros_like(held)).reshape(n, r, n * r)
    return jnp.trace(solve(whole, held, columns).reshape(n * r, n * r))


@eqx.filter_jit
def _estimated(data: NormalSystem, whole: NormalSystem, problem: FootProblem, probes: Array) -> Array:
    """The mean of quadratic forms of random signs."""
    held = _held(problem)

    def form(probe: Array) -> Array:
        return jnp.vdot(probe, solve(whole, held, multiply(data, jnp.zeros_like(held), probe)))

    return jnp.mean(jax.lax.map(form, probes))


def _held(problem: FootProblem) -> Array:
    """What holds control points, and a trace of damping where nothing does."""
    mass = jnp.maximum(problem.mass, 1e-6 * problem.mass.mean())
    return problem.hold + trace_of_damping(np.dtype(problem.points.dtype)) * mass[:, None]


def _of_parametric(fitted: Fitted, smoothing: float) -> float:
    """The trace of the linear smoother over fixed parameters, from random signs at the points."""
    request, space = fitted.request, fitted.surface.space
    root = np.sqrt(np.where(fitted.weights > 0, fitted.weights, 1))
    signs = np.random.default_rng(0).choice([-1.0, 1.0], size=(len(root), 3)) * (fitted.weights > 0)[:, None]
    points = lstsq(
        space,
        request.parameters,
        signs / root[:, None],
        fitted.weights,
        smoothing=smoothing,
        extent=request.frame.extent,
    )
    values = np.asarray(make_surface(space, points)(request.parameters))
    return float(np.sum(signs * root[:, None] * values) / 3)
