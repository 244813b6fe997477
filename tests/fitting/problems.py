"""Meshes, samples and their dense normal equations: what the fitting kernels are held to."""

from dataclasses import dataclass

import numpy as np
from jax import Array

from tsplinejax.fitting._discretisation import Discretisation, discretise
from tsplinejax.fitting._moments import Moments, add_samples, empty_moments
from tsplinejax.fitting._samples import AbstractSamples, grid_samples, scattered_samples
from tsplinejax.fitting._store import Store, assemble_rows, choose, fresh_store, renew_points
from tsplinejax.fitting._system import System
from tsplinejax.mesh import AbstractRefinement, Dyadic, TMesh, b_lattice, refine
from tsplinejax.space import bezier_elements, to_device

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
    """A mesh with samples on it, on the host and on the device."""

    tmesh: TMesh
    parameters: np.ndarray
    values: np.ndarray
    weights: np.ndarray
    samples: AbstractSamples
    mesh: Discretisation
    rational: bool

    @property
    def dimension(self) -> int:
        """Components of a value."""
        return self.values.shape[1]

    @property
    def lattice(self) -> Array:
        """Squares of the start lattice, on the device."""
        return to_device(np.asarray(self.tmesh.forest.lattice, np.int32))

    def store(self) -> Store:
        """Fresh device rows."""
        return fresh_store(self.mesh, self.dimension, rational=self.rational, dtype=np.dtype(np.float64))

    def moments(self, chosen: np.ndarray | None = None) -> Moments:
        """Moments of all samples, or of those in the chosen elements."""
        store, chosen = self.store(), np.arange(len(self.mesh.slots)) if chosen is None else chosen
        sums = None
        if self.rational:
            every = choose(self.mesh.slots, self.mesh.capacity)
            zeros = to_device(np.zeros((self.mesh.capacity, self.dimension)))
            sums = renew_points(store, zeros, to_device(EXTENT), self.lattice, every)[0].points[..., -1:]
        boxes = to_device(np.asarray(store.boxes))
        empty = empty_moments(self.mesh.capacity, self.dimension, np.dtype(np.float64))
        return add_samples(empty, self.samples, self.mesh, chosen, boxes, self.lattice, sums)[0]

    def system(self, smoothing: float) -> System:
        """The assembled system."""
        store, every = self.store(), choose(self.mesh.slots, self.mesh.capacity)
        parts = (store.functions, store.boxes, store.along_s, store.along_t, self.moments())
        rows = (store.matrices, store.loads)
        weight = to_device(np.float64(smoothing))
        return System(store.functions, *assemble_rows(rows, parts, weight, to_device(EXTENT), self.lattice, every))

    def element_of_samples(self) -> np.ndarray:
        """Bézier element of each sample, by comparing with every box."""
        scale, boxes = np.array(self.tmesh.extent), self.mesh.elements.boxes
        places = np.minimum(self.parameters[:, None] * scale, scale - 0.5)  # the far ends belong to the last elements
        return ((places >= boxes[:, :2]) & (places < boxes[:, 2:])).all(axis=2).argmax(axis=1)

    def local_places(self, element: np.ndarray) -> np.ndarray:
        """Samples in the coordinates of their elements."""
        boxes = self.mesh.elements.boxes[element]
        return (self.parameters * np.array(self.tmesh.extent) - boxes[:, :2]) / (boxes[:, 2:] - boxes[:, :2])

    def basis(self) -> np.ndarray:
        """Blending functions at the samples, divided by their sum where the mesh is rational: (m, n)."""
        basis = blending(self.tmesh, np.minimum(self.parameters, 1 - 1e-14))  # its intervals are open at the far end
        return basis / basis.sum(axis=1, keepdims=True) if self.rational else basis


def make_case(
    tmesh: TMesh,
    *,
    count: int = 500,
    dimension: int = 1,
    hole: bool = False,
    rational: bool = False,
    grid: tuple[int, int] | None = None,
    seed: int = 0,
    tile: int = TILE,
) -> Case:
    """Scattered, weighted samples of a smooth function with noise, or the pixels of a grid; a hole leaves some out."""
    generator = np.random.default_rng(seed)
    parameters, index = generator.uniform(0.001, 0.999, (count, 2)), None
    if grid is not None:
        index = np.arange(grid[0] * grid[1])
        parameters = np.stack([index % grid[1] / (grid[1] - 1), index // grid[1] / (grid[0] - 1)], axis=1)
    if hole:
        outside = np.abs(parameters - 0.4).max(axis=1) > 0.25
        parameters, index = parameters[outside], None if index is None else index[outside]
    phases = generator.uniform(2, 6, (dimension, 2))
    values = np.sin(parameters @ phases.T) + 0.1 * generator.normal(size=(len(parameters), dimension))
    weights = generator.uniform(0.2, 2.0, len(parameters))
    weights[::17] = 0
    options = {"dtype": np.dtype(np.float64), "tile": tile}
    if grid is None:
        samples = scattered_samples(tmesh, parameters, values, weights, None, **options)
    else:
        samples = grid_samples(tmesh, grid, index if hole else None, values, weights, None, **options)
    return Case(tmesh, parameters, values, weights, samples, discretise(tmesh, 256), rational)


CASES = {
    "closure": lambda: make_case(refined()),
    "hole": lambda: make_case(refined(), hole=True),
    "points in space": lambda: make_case(refined(seed=5), dimension=3),
    "pixels": lambda: make_case(refined(), grid=(23, 31)),
    "pixels with a hole": lambda: make_case(refined(), grid=(40, 22), hole=True),
    "rational": lambda: make_case(refined(Dyadic()), rational=True),
    "rational, pixels": lambda: make_case(refined(Dyadic()), rational=True, grid=(23, 31)),
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
