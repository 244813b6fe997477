"""Automatic smoothing by generalised cross validation.

GCV(λ) = m RSS / (m - tr H)², with the trace of the smoother H estimated from random signs at the samples (Hutchinson).
Signs and values are right-hand sides of one system, so a weight λ costs one block of conjugate gradients and no pass
over the samples.
"""

from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..space import to_device
from ._adaptive import State, remeasure
from ._moments import Moments, add_samples, empty_moments
from ._problem import Problem
from ._run import Run
from ._samples import AbstractHeldSamples
from ._solve import conjugate_gradients
from ._store import assemble_rows, choose, choose_among, renew_points
from ._system import System

PROBES = 8
ITERATIONS, ACCURACY = 100, 1e-4  # scores are of second order in the error of a solve
DECADES = 14


def smooth_automatically(problem: Problem, outcome: Run) -> tuple[Problem, Run]:
    """The fit with the weight λ of least GCV on the run's last mesh, from the problem's own λ upwards."""
    state = outcome.best
    trial = _Trial(problem, state, _probed_moments(problem, state), _square_sum(problem))
    scores: dict[float, float] = {}
    start = trial.fitted()
    for exponent in range(DECADES):
        scores[exponent], start = trial.score(problem.smoothing * 10.0**exponent, start)
        if exponent - min(scores, key=scores.__getitem__) >= 2:
            break
    best = min(scores, key=scores.__getitem__)
    for exponent in (best - 0.5, best + 0.5):
        scores[exponent], start = trial.score(problem.smoothing * 10.0**exponent, start)
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

    def fitted(self) -> Float[Array, "capacity d"]:
        """Where solves begin: the fit itself, and nothing for the signs."""
        capacity, values = self.state.mesh.capacity, self.problem.dimension
        empty = jnp.zeros((capacity, self.moments.load.shape[-1]), self.problem.dtype)
        return empty.at[:, :values].set(self.state.coefficients)

    def score(self, smoothing: float, start: Float[Array, "capacity d"]) -> tuple[float, Float[Array, "capacity d"]]:
        """GCV of one weight, and the solution, from which the next weight's begins."""
        problem, mesh, store = self.problem, self.state.mesh, self.state.store
        width, d = store.functions.shape[1], self.moments.load.shape[-1]
        every = choose(mesh.slots, mesh.capacity)
        zeros = (
            jnp.zeros((mesh.capacity, width, width), problem.dtype),
            jnp.zeros((mesh.capacity, width, d), problem.dtype),
        )
        parts = (store.functions, store.boxes, store.along_s, store.along_t, self.moments)
        weight = to_device(smoothing, problem.dtype)
        matrices, loads = assemble_rows(zeros, parts, weight, problem.extent, problem.lattice, every)
        system = System(jnp.maximum(store.functions, 0), matrices, loads)
        free = jnp.arange(mesh.capacity) < mesh.tmesh.n_anchors
        solution = conjugate_gradients(
            system,
            choose_among(mesh.slots, len(mesh.slots), mesh.capacity),
            start,
            free,
            to_device(ITERATIONS, np.int32),
            *(to_device(limit, problem.dtype) for limit in (1e-6, 0.0)),
        ).coefficients
        values = problem.dimension
        local = solution[system.functions]
        products = jnp.einsum("eid,eid->d", loads, local, precision="highest")
        forms = jnp.einsum("eid,eij,ejd->d", local, matrices, local, precision="highest")
        blank = replace(store, points=jnp.zeros((mesh.capacity, 4, 4, values), problem.dtype))
        _, energies = renew_points(blank, solution[:, :values], problem.extent, problem.lattice, every)
        bending = smoothing * jnp.sum(energies)
        rest = self.squares - 2 * products[:values].sum() + forms[:values].sum() - bending
        freedom = float(products[values:].mean())
        counted = problem.source.n_counted
        return counted * max(float(rest), 0.0) / max(counted - freedom, 1e-3) ** 2, solution


def _probed_moments(problem: Problem, state: State) -> Moments:
    """Moments of the values and, as further components, of random signs."""
    weights, mesh = problem.request.samples.weights, state.mesh
    signs = np.random.default_rng(0).choice([-1.0, 1.0], size=(problem.source.n_samples, PROBES))
    if weights is not None:  # √w: the smoother of the weighted problem acts on √w v
        signs /= np.sqrt(np.where(weights > 0, weights, 1))[:, None]
    assert isinstance(problem.samples, AbstractHeldSamples)
    probed, every = problem.samples.with_values(signs), np.arange(len(mesh.slots))
    empty = empty_moments(mesh.capacity, PROBES, problem.dtype)
    moments, _ = add_samples(empty, probed, mesh, every, state.store.boxes, problem.lattice)
    mass, load = state.store.moments.mass, state.store.moments.load
    return Moments(mass, jnp.concatenate([load, moments.load], axis=-1))


def _square_sum(problem: Problem) -> float:
    """Σ w v² of the fitted values."""
    request, scaling = problem.request, problem.scaling
    values = (request.samples.values[request.counted].astype(np.float64) - scaling.offset) / scaling.factor
    weights = 1.0 if request.samples.weights is None else request.samples.weights[request.counted, None]
    return float(np.sum(weights * values**2))
