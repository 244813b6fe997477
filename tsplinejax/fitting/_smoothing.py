"""Automatic smoothing by generalised cross validation.

GCV(λ) = m RSS / (m - tr H)², with the trace of the smoother H estimated from random signs at the samples (Hutchinson).
Signs and values are right-hand sides of one system, so a weight λ costs one block of conjugate gradients and no pass
over the samples.
"""

from dataclasses import dataclass, replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ._adaptive import State, remeasure
from ._energy import bending_energy
from ._moments import Moments, add_samples, empty_moments
from ._problem import Problem
from ._residuals import homogeneous_points
from ._run import Run
from ._solve import conjugate_gradients
from ._system import assemble, empty_system

PROBES = 8
ITERATIONS = 300
DECADES = 14


def smooth_automatically(problem: Problem, outcome: Run) -> tuple[Problem, Run]:
    """The fit with the weight λ of least GCV on the run's last mesh, from the problem's own λ upwards."""
    state = outcome.best
    trial = _Trial(problem, state, _probed_moments(problem, state), _square_sum(problem))
    exponents = np.arange(DECADES, dtype=np.float64)
    scores: dict[float, float] = {}
    for exponent in exponents:
        scores[exponent] = trial.score(problem.smoothing * 10.0**exponent)
        if exponent - min(scores, key=scores.__getitem__) >= 2:
            break
    best = min(scores, key=scores.__getitem__)
    for exponent in (best - 0.5, best + 0.5):
        scores[exponent] = trial.score(problem.smoothing * 10.0**exponent)
    smoothed = replace(problem, smoothing=problem.smoothing * 10.0 ** min(scores, key=scores.__getitem__))
    smooth = remeasure(smoothed, state)
    return smoothed, replace(outcome, best=smooth, history=smooth.history)


@dataclass(frozen=True, eq=False)
class _Trial:
    """What scoring a weight needs."""

    problem: Problem
    state: State
    moments: Moments
    squares: float

    def score(self, smoothing: float) -> float:
        """GCV of one weight."""
        problem, mesh = self.problem, self.state.mesh
        every = np.arange(len(mesh.elements))
        d = self.moments.load.shape[-1]
        system = assemble(empty_system(mesh.space, d), mesh.space, self.moments, smoothing, problem.extent, every)
        start = (
            jnp.zeros((mesh.capacity, d), problem.dtype).at[:, : problem.data.dimension].set(self.state.coefficients)
        )
        free = jnp.arange(mesh.capacity) < mesh.tmesh.n_anchors
        solution = conjugate_gradients(
            system, start, free, jnp.asarray(ITERATIONS, jnp.int32), jnp.asarray(1e-6, problem.dtype)
        ).coefficients
        values = problem.data.dimension
        products = jnp.einsum("eid,eid->d", system.loads, solution[system.functions], precision="highest")
        local = solution[system.functions]
        forms = jnp.einsum("eid,eij,ejd->d", local, system.matrices, local, precision="highest")
        points = homogeneous_points(mesh.space, solution[:, :values])[..., :values]
        bending = smoothing * bending_energy(points, mesh.space.tables.size, problem.extent)
        rest = self.squares - 2 * products[:values].sum() + forms[:values].sum() - bending
        freedom = float(products[values:].mean())
        counted = problem.n_counted
        return counted * max(float(rest), 0.0) / max(counted - freedom, 1e-3) ** 2


def _probed_moments(problem: Problem, state: State) -> Moments:
    """Moments of the values and, as further components, of random signs."""
    samples = problem.samples
    signs = np.random.default_rng(0).choice([-1.0, 1.0], size=(len(samples.values), PROBES))
    # √w: the smoother of the weighted problem acts on √w v.
    scaled = jnp.asarray(signs, problem.dtype) / jnp.sqrt(jnp.where(samples.weights > 0, samples.weights, 1))[:, None]
    probed = eqx.tree_at(lambda s: s.values, samples, scaled)
    moments = add_samples(
        empty_moments(state.mesh.space, PROBES), state.mesh.space, probed, state.mesh.blocks, problem.tile_length
    )
    return Moments(moments.mass, jnp.concatenate([state.moments.load, moments.load], axis=-1))


def _square_sum(problem: Problem) -> float:
    """Σ w v² of the fitted values."""
    samples = problem.samples
    total: Array = jnp.sum(samples.weights * jnp.sum(samples.values**2, axis=1))
    return float(total)
