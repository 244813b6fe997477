"""Meshes, samples and their dense normal equations: what the fitting kernels are held to."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from tsplinejax.fitting._discretisation import Discretisation, discretise
from tsplinejax.fitting._moments import Moments, add_samples, empty_moments
from tsplinejax.mesh import AbstractRefinement, Dyadic, TMesh, b_lattice, refine
from tsplinejax.space import BLOCK, Order, SortedSamples, bezier_elements, sort_samples

from ..blending import blending

EXTENT = np.array([1.25, 0.8])  # of unit area, as the energy counts lengths
TILE = 64


def refined(rule: AbstractRefinement | None = None, *, steps: int = 3, seed: int = 3, lattice=(3, 2)) -> TMesh:
    """A lattice after a few random refinements."""
    generator, tmesh = np.random.default_rng(seed), b_lattice(*lattice)
    for _ in range(steps):
        tmesh = refine(tmesh, generator.random(tmesh.n_elements) < 0.3, rule).mesh
    return tmesh


@dataclass(frozen=True, eq=False)
class Case:
    """A mesh with samples on it: `order` sorts them, `samples` are sorted and padded on the device."""

    tmesh: TMesh
    parameters: np.ndarray
    values: np.ndarray
    weights: np.ndarray
    order: Order
    samples: SortedSamples
    mesh: Discretisation

    @property
    def rational(self) -> bool:
        """Whether the mesh needs Eq. 2's division."""
        return self.mesh.space.rational

    def moments(self) -> Moments:
        """Moments of all samples."""
        empty = empty_moments(self.mesh.space, self.values.shape[1])
        return add_samples(empty, self.mesh.space, self.samples, self.mesh.blocks, TILE)

    def basis(self) -> np.ndarray:
        """Blending functions at the samples, divided by their sum where the mesh is rational: (m, n)."""
        basis = blending(self.tmesh, self.parameters)
        return basis / basis.sum(axis=1, keepdims=True) if self.rational else basis


def make_case(
    tmesh: TMesh, *, count: int = 500, dimension: int = 1, hole: bool = False, rational: bool = False, seed: int = 0
) -> Case:
    """Scattered, weighted samples of a smooth function with noise; with a hole they leave some elements empty."""
    generator = np.random.default_rng(seed)
    parameters = generator.uniform(0.001, 0.999, (count, 2))
    if hole:
        parameters = parameters[np.abs(parameters - 0.4).max(axis=1) > 0.25]
    phases = generator.uniform(2, 6, (dimension, 2))
    values = np.sin(parameters @ phases.T) + 0.1 * generator.normal(size=(len(parameters), dimension))
    weights = generator.uniform(0.2, 2.0, len(parameters))
    weights[::17] = 0
    order = sort_samples(tmesh, parameters)
    sorted_parts = [part[order.permutation] for part in (parameters, values, weights)]
    padded = [jnp.asarray(np.concatenate([part, np.zeros((BLOCK, *part.shape[1:]))])) for part in sorted_parts]
    mesh = discretise(tmesh, order, dtype=np.dtype(np.float64), rational=rational, least_capacity=256)
    return Case(tmesh, parameters, values, weights, order, SortedSamples(*padded), mesh)


CASES = {
    "closure": lambda: make_case(refined()),
    "hole": lambda: make_case(refined(), hole=True),
    "points in space": lambda: make_case(refined(seed=5), dimension=3),
    "rational": lambda: make_case(refined(Dyadic()), rational=True),
    "rational, in space": lambda: make_case(refined(Dyadic(), seed=4), dimension=3, rational=True),
}


def bending_matrix(tmesh: TMesh) -> np.ndarray:
    """∫ b_xx b_xx + 2 b_xy b_xy + b_yy b_yy by 4 × 4 Gauss points an element, lengths from `EXTENT`: (n, n)."""
    nodes, weights = (part / 2 for part in np.polynomial.legendre.leggauss(4))
    u, v = (grid.ravel() for grid in np.meshgrid(nodes + 0.5, nodes + 0.5))
    share = np.outer(weights, weights).ravel()
    boxes = bezier_elements(tmesh).boxes
    low, high = (np.stack([tmesh.parameters(k, boxes[:, k + j]) for k in (0, 1)], axis=1) for j in (0, 2))
    size = high - low
    places = (low[:, None] + np.stack([u, v], axis=1) * size[:, None]).reshape(-1, 2)
    area = (size.prod(axis=1)[:, None] * share).ravel() * EXTENT.prod()
    matrix = 0
    for order, factor in (((2, 0), 1), ((1, 1), 2), ((0, 2), 1)):
        values = blending(tmesh, places, order) / np.prod(EXTENT ** np.array(order))
        matrix = matrix + factor * values.T @ (area[:, None] * values)
    return np.asarray(matrix)


def dense_system(case: Case, smoothing: float) -> tuple[np.ndarray, np.ndarray]:
    """Matrix (n, n) and right-hand side (n, d) from evaluated blending functions."""
    basis = case.basis()
    matrix = basis.T @ (case.weights[:, None] * basis)
    if smoothing:
        matrix = matrix + smoothing * bending_matrix(case.tmesh)
    return matrix, basis.T @ (case.weights[:, None] * case.values)
