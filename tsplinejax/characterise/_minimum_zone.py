"""Minimum-zone forms: the smallest largest residual (Chebyshev), with a bound that proves how near it is.

For residuals r + J δ, linear in the step δ, minimising the largest magnitude and weighing are dual (Lawson 1961):

    min_δ max_i |r_i + J_i δ|²  =  max_w min_δ Σ_i w_i (r_i + J_i δ)²,    w ≥ 0, Σ w_i = 1.

The right-hand side is concave in w, its gradient is the squared residuals, and its domain is the simplex: a task for a
projected gradient, jaxopt's, which is why jaxopt is used here and nowhere else. Only a few samples touch the zone, so w
lives on a small working set to which the samples that violate are added (an exchange algorithm); then the few that
carry weight are made equal exactly. For any w the right-hand side is a lower bound.
"""

import warnings
from collections.abc import Callable
from functools import cache

import numpy as np
from jaxtyping import Float

from ._shapes import AbstractShape

_WORKING = 96  # samples in the working set, and those that join it at a time
_JOINING = 16
_EXCHANGES, _STEPS = 60, 40
_REST = 1e-9

Residuals = Callable[[AbstractShape], tuple[np.ndarray, np.ndarray]]


def minimum_zone(shape: AbstractShape, residuals: Residuals) -> tuple[AbstractShape, float, bool]:
    """The shape of smallest largest residual near a given one, a lower bound of that residual, and whether it rests."""
    left, derivatives = residuals(shape)
    largest, bound = float(np.abs(left).max()), 0.0
    for _ in range(_STEPS):
        step, bound = _linear_step(left, derivatives)
        for halvings in range(20):
            trial = shape.moved(step * 0.5**halvings)
            left_then, derivatives_then = residuals(trial)
            largest_then = float(np.abs(left_then).max())
            if largest_then <= largest:  # also false for NaN: the shape no longer reaches every sample
                break
        else:
            break
        gained = largest - largest_then
        shape, left, derivatives, largest = trial, left_then, derivatives_then, largest_then
        if gained <= _REST * largest:
            break
    return shape, bound, largest - bound <= 1e-6 * largest


def _linear_step(
    left: Float[np.ndarray, " m"], derivatives: Float[np.ndarray, "m k"]
) -> tuple[Float[np.ndarray, " k"], float]:
    """The step that minimises the largest of |r + J δ|, and a lower bound of it."""
    scale, size = float(np.abs(left).max()) or 1.0, np.linalg.norm(derivatives, axis=0) / np.sqrt(len(left))
    size = np.where(size > 0, size, 1.0)
    r, J = left / scale, derivatives / size
    chosen, weights = _extremes(r, _WORKING // 2), None
    best, bound = (np.inf, np.zeros(J.shape[1])), 0.0
    for _ in range(_EXCHANGES):
        step, weights = _working_step(r[chosen], J[chosen], weights)
        bound = max(bound, _bound(r[chosen], J[chosen], weights))
        after = r + J @ step
        largest = float(np.abs(after).max())
        best = min(best, (largest, step), key=lambda entry: entry[0])
        if best[0] - bound <= _REST * best[0]:
            break
        chosen, weights = _exchanged(chosen, weights, after)
    return best[1] / size * scale, bound * scale


def _extremes(values: np.ndarray, count: int) -> np.ndarray:
    """Indices of the largest and the smallest values."""
    part = min(count, len(values) - 1)
    return np.unique(np.concatenate([np.argpartition(values, part)[:part], np.argpartition(-values, part)[:part]]))


def _exchanged(chosen: np.ndarray, weights: np.ndarray, after: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The working set with the worst samples in it, instead of those without weight."""
    joining = np.setdiff1d(_extremes(after, _JOINING), chosen)
    kept = np.argsort(-weights)[: _WORKING - len(joining)]
    share = np.concatenate([weights[kept], np.zeros(len(joining))])
    return np.concatenate([chosen[kept], joining]), share / share.sum()


def _bound(r: np.ndarray, J: np.ndarray, weights: np.ndarray) -> float:
    """√ min_δ Σ w (r + J δ)²."""
    root = np.sqrt(weights)
    step = np.linalg.lstsq(root[:, None] * J, -root * r, rcond=None)[0]
    return float(np.linalg.norm(root * (r + J @ step)))


def _working_step(r: np.ndarray, J: np.ndarray, start: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """The best step for a working set, and the weights that prove it."""
    count, k = J.shape
    padded_r, padded_J, w = np.zeros(_WORKING), np.zeros((_WORKING, k)), np.zeros(_WORKING)
    padded_r[:count], padded_J[:count] = r, J
    w[:count] = 1 / count if start is None else start
    weights = np.asarray(_ascent()(w, padded_r, padded_J), np.float64)[:count]
    weights = np.maximum(weights, 0) / np.maximum(weights, 0).sum()
    root = np.sqrt(weights)
    step = np.linalg.lstsq(root[:, None] * J, -root * r, rcond=None)[0]
    equal = _equalised(r, J, weights, step)
    return min((equal, step), key=lambda found: float(np.abs(r + J @ found).max())), weights


def _equalised(r: np.ndarray, J: np.ndarray, weights: np.ndarray, step: np.ndarray) -> np.ndarray:
    """The step that makes the k + 1 samples of most weight equal in magnitude: r + J δ = ± h."""
    most = np.argsort(-weights)[: J.shape[1] + 1]
    signs = np.sign(r[most] + J[most] @ step)
    return np.linalg.lstsq(np.column_stack([J[most], -signs]), -r[most], rcond=None)[0][:-1]


@cache
def _ascent() -> Callable[..., np.ndarray]:
    """The projected gradient on the simplex, compiled once a number of columns."""
    import jax
    import jax.numpy as jnp

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # jaxopt says on import that it is no longer maintained
        import jaxopt

    def negative_dual(w, r, J):
        normal = J.T @ (w[:, None] * J)
        ridge = 100 * jnp.finfo(r.dtype).eps * jnp.trace(normal)
        step = jnp.linalg.solve(normal + ridge * jnp.eye(J.shape[1]), -J.T @ (w * r))
        # The inner problem is at its minimum, so it adds nothing to the gradient.
        return -jnp.sum(w * (r + J @ jax.lax.stop_gradient(step)) ** 2)

    solver = jaxopt.ProjectedGradient(
        negative_dual, jaxopt.projection.projection_simplex, maxiter=500, tol=1e-9, implicit_diff=False
    )
    return jax.jit(lambda w, r, J: solver.run(w, r=r, J=J).params)
