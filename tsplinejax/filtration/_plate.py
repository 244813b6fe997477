"""A plate over an adaptive T-mesh that may bend for nothing where an edge is.

The smoothing spline of the cut-off λc is fitted again and again, with a weight w_e on the bending energy of each
element e at a feature,

    w_e = (1 + κ_e² / T²)⁻²,    κ_e² = ∫_e f_xx² + 2 f_xy² + f_yy² / area,

the reweighting of Geman and McClure's saturating penalty (the weak plate of Blake and Zisserman, Visual Reconstruction,
1987, ch. 2 and 5, begun from the linear filter). T is the curvature of a step as high as the tolerance that is smoothed
by λc. Higher steps bend more, so their bending gets cheaper, they become steeper, and bend still more: the bending
gathers in elements along the edge, and the plates on both sides are smoothed by λc as if there was no edge. Nothing
rings. Last, weights fall further wherever a residual still exceeds its limit.
"""

from dataclasses import dataclass
from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..fitting import Problem
from ..fitting._adaptive import State, with_coefficients
from ..fitting._direct import MOST_UNKNOWNS
from ..fitting._energy import element_energy, smoothing_for_cutoff
from ..fitting._stopwatch import Stopwatch
from ..fitting._store import Store
from ..mesh import DEPTH
from ..space import pad, to_device
from ._features import FeatureCriterion

# Curvature of a smoothed step over its height and λc⁻²: at most 6.4; at half of that an edge begins to form.
_STEP_CURVATURE = 3.2
_ROUNDS, _RELAXING, _SETTLED = 16, 4, 0.25
_GATHER = 3.0  # T falls to its value by this factor a round, from the largest curvature: the highest edges form first
_RELAXED = 0.05  # factor of a weight where a residual exceeds its limit
_ITERATIONS, _ACCURACY = 400, 1e-8


@dataclass(frozen=True, eq=False)
class Plate:
    """The reweighted smoothing of a fit, in the fit's scale: lengths in √(Lx Ly), heights in units of the range.

    **Attributes:**

    - `problem`: the fit, to a `FeatureCriterion`.
    - `cutoff`: λc.
    """

    problem: Problem
    cutoff: float

    @property
    def criterion(self) -> FeatureCriterion:
        """Where features are, and what stands out."""
        assert isinstance(self.problem.criterion, FeatureCriterion)
        return self.problem.criterion

    @cached_property
    def density(self) -> float:
        """Pixels on the unit of area."""
        shape = self.problem.request.samples.grid_shape
        assert shape is not None
        return float((shape[0] - 1) * (shape[1] - 1))

    def smoothed(self, state: State) -> tuple[State, Float[np.ndarray, " bezier"]]:
        """The smooth surface on a state's mesh, and the weights of the elements (by slot)."""
        criterion, owner = self.criterion, state.mesh.elements.owner
        at_features = state.mesh.by_slot(criterion.at_features(state.mesh.tmesh)[owner])
        sides = self.sides(state)
        areas = np.prod(sides, axis=1)
        equations = _Equations(state.store, sides, state.mesh.tmesh.n_anchors)
        smoothing = smoothing_for_cutoff(self.cutoff, self.density)
        least = _STEP_CURVATURE * criterion.level / self.cutoff**2
        weights, relaxed, limit = np.ones(len(owner)), np.ones(len(owner)), np.inf
        left = _RELAXING
        for _ in range(_ROUNDS):
            before = state.coefficients
            coefficients = to_device(equations.solve(smoothing * weights, np.asarray(before)), self.problem.dtype)
            state = with_coefficients(self.problem, state, coefficients, Stopwatch(state.history[-1]))
            moved = float(jnp.max(jnp.abs(coefficients - before)))
            exceeding = state.mesh.by_slot(state.excess[owner]) > 1
            settled = limit == least and moved < _SETTLED * criterion.level
            if settled and (left == 0 or not exceeding.any()):
                break
            if settled:
                left -= 1
                relaxed = np.where(exceeding, _RELAXED * relaxed, relaxed)
            squares = state.tally.energy / areas
            if np.isinf(limit):
                limit = np.sqrt(np.max(squares, where=at_features, initial=0.0))
            limit = max(least, limit / _GATHER)
            weights = relaxed * np.where(at_features, (1 + squares / limit**2) ** -2.0, 1.0)
        return state, weights

    def sides(self, state: State) -> Float[np.ndarray, "bezier 2"]:
        """Sides of the Bézier elements, by slot."""
        boxes = np.diff(state.mesh.by_slot(state.mesh.elements.boxes).reshape(-1, 2, 2), axis=1)[:, 0]
        return boxes / (np.asarray(self.problem.lattice) << DEPTH) * np.asarray(self.problem.extent)


class _Equations:
    """The normal equations of a state for any weights of the elements' bending; their pattern is found once."""

    def __init__(self, store: Store, sides: Float[np.ndarray, "bezier 2"], n: int) -> None:
        from scipy.sparse import csc_array

        count = len(sides)
        padded = to_device(pad(sides, len(store.functions), 1.0), store.along_s.dtype)
        parts = (store.functions, store.matrices, store.loads, _bending(store.along_s, store.along_t, padded))
        functions, matrices, loads, bending = (np.asarray(part)[:count] for part in parts)
        functions = np.maximum(functions, 0)  # padded places hold zeros
        k = functions.shape[1]
        entries = (np.repeat(functions, k, axis=1) + n * np.tile(functions, (1, k)).astype(np.int64)).ravel()
        used, place = np.unique(entries, return_inverse=True)
        self.n, self.rows = n, (used % n).astype(np.int32)
        self.starts = np.searchsorted(used, n * np.arange(n + 1)).astype(np.int32)
        self.samples = np.bincount(place, matrices.ravel())
        by_element = (bending.ravel(), place, np.arange(count + 1) * k * k)
        self.bending = csc_array(by_element, shape=(len(used), count))
        self.load = np.bincount(functions.ravel(), loads[..., 0].ravel(), minlength=n)

    def solve(
        self, weights: Float[np.ndarray, " bezier"], before: Float[np.ndarray, "capacity 1"]
    ) -> Float[np.ndarray, "capacity 1"]:
        """Coefficients; where a factorisation is too large, by iterations from those before."""
        from scipy.sparse import csc_array, diags_array
        from scipy.sparse.linalg import cg, splu

        matrix = csc_array((self.samples + self.bending @ weights, self.rows, self.starts), shape=(self.n, self.n))
        start = before[: self.n, 0].astype(np.float64)
        if self.n > MOST_UNKNOWNS:
            inverse = diags_array(1 / matrix.diagonal())
            solution, _ = cg(matrix, self.load, start, rtol=_ACCURACY, maxiter=_ITERATIONS, M=inverse)
        else:
            factor = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
            solution = factor.solve(self.load)
            solution += factor.solve(self.load - matrix @ solution)
        coefficients = np.zeros_like(before)
        coefficients[: self.n, 0] = solution
        return coefficients


@jax.jit
def _bending(
    along_s: Float[Array, "capacity K 4"], along_t: Float[Array, "capacity K 4"], sides: Float[Array, "capacity 2"]
) -> Float[Array, "capacity K K"]:
    """Each element's bending energy as a matrix."""
    return element_energy(along_s, along_t, sides)
