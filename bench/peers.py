"""Other ways to a surface, each timed from the samples to what it evaluates by.

A peer is given parameters (m, 2) in [0, 1]² and values (m,), and hands back a `Fitted`: how many unknowns it solved
for, the seconds this took, and a function from parameters to heights. Reading, scaling and the judging of errors are
left out of the seconds, as they are for ours.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

Evaluate = Callable[[np.ndarray], np.ndarray]
Lattice = tuple[int, int]  # elements along s and along t
SMOOTHING = 1e-7  # the bending energy in G+Smo's own fitting programs; three times slower, so only where it is needed


@dataclass(frozen=True, eq=False)
class Fitted:
    """What a peer has made of the samples."""

    unknowns: int
    seconds: float
    evaluate: Evaluate
    remark: str = ""


def knots(elements: int) -> np.ndarray:
    """Clamped uniform knots of cubic B-splines."""
    return np.concatenate([[0.0] * 3, np.linspace(0, 1, elements + 1), [1.0] * 3])


def uniform_sparse(places: np.ndarray, values: np.ndarray, lattice: Lattice, fill: float = 0.0) -> Fitted:
    """Least squares over a uniform lattice: scipy's design matrix, sparse normal equations and their factorisation.

    `fill` weights second differences of the coefficients against the mean diagonal entry: without it coefficients that
    no sample sees make the matrix singular.
    """
    from scipy.interpolate import NdBSpline
    from scipy.sparse.linalg import splu

    started = time.perf_counter()
    both = (knots(lattice[0]), knots(lattice[1]))
    design = NdBSpline.design_matrix(places, both, 3)
    design.resize(len(places), (lattice[0] + 3) * (lattice[1] + 3))  # it ends with the last coefficient that is seen
    normal = design.T @ design
    if fill:
        normal = normal + fill * normal.diagonal().mean() * _second_differences((lattice[0] + 3, lattice[1] + 3))
    factor = splu(normal.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    solution = factor.solve(design.T @ values)
    seconds = time.perf_counter() - started
    surface = NdBSpline(both, solution.reshape(lattice[0] + 3, lattice[1] + 3), 3)
    return Fitted(len(solution), seconds, surface, f"{lattice[0]} × {lattice[1]}")


def _second_differences(shape: tuple[int, int]):
    """Dᵀ D of the second differences of a grid of coefficients, along both directions."""
    from scipy.sparse import diags_array, eye_array, kron

    def squared(n: int):
        rows = diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(n - 2, n))  # pyright: ignore[reportArgumentType]
        return rows.T @ rows

    return kron(squared(shape[0]), eye_array(shape[1])) + kron(eye_array(shape[0]), squared(shape[1]))


def uniform_separable(heights: np.ndarray, lattice: Lattice) -> Fitted:
    """The same least squares for a full grid: two banded problems, along the columns and along the rows."""
    from scipy.interpolate import NdBSpline, make_lsq_spline

    started = time.perf_counter()
    s, t = (np.linspace(0, 1, length) for length in heights.shape[::-1])
    both = (knots(lattice[0]), knots(lattice[1]))
    along_t = make_lsq_spline(t, heights, both[1], k=3).c
    solution = make_lsq_spline(s, np.ascontiguousarray(along_t.T), both[0], k=3).c
    seconds = time.perf_counter() - started
    return Fitted(solution.size, seconds, NdBSpline(both, solution, 3), f"{lattice[0]} × {lattice[1]}")


def radial(places: np.ndarray, values: np.ndarray, judged: np.ndarray, neighbours: int = 32) -> Fitted:
    """scipy's thin-plate interpolation among neighbours; it solves at the places where it is evaluated."""
    from scipy.interpolate import RBFInterpolator

    started = time.perf_counter()
    surface = RBFInterpolator(places, values, neighbors=neighbours)
    surface(judged)
    seconds = time.perf_counter() - started
    return Fitted(len(places), seconds, surface, f"{neighbours} neighbours, seconds for {len(judged)} places")


def triangulated(places: np.ndarray, values: np.ndarray, judged: np.ndarray) -> Fitted:
    """Cubic interpolation over a Delaunay triangulation: what `griddata(method="cubic")` does, kept for evaluation."""
    from scipy.interpolate import CloughTocher2DInterpolator

    started = time.perf_counter()
    surface = CloughTocher2DInterpolator(places, values)
    surface(judged)
    seconds = time.perf_counter() - started
    return Fitted(len(places), seconds, surface, f"seconds with {len(judged)} places")


def green(places: np.ndarray, values: np.ndarray, forces: int = 32, damping: float = 1e-8) -> Fitted:
    """verde's biharmonic spline, with forces on a square grid: its matrix is dense, samples × forces."""
    import verde

    started = time.perf_counter()
    s, t = np.meshgrid(*(np.linspace(0, 1, forces),) * 2)
    spline = verde.Spline(damping=damping, force_coords=(s.ravel(), t.ravel()))
    spline.fit((places[:, 0], places[:, 1]), values)
    seconds = time.perf_counter() - started

    def evaluate(at: np.ndarray) -> np.ndarray:
        return np.asarray(spline.predict((at[:, 0], at[:, 1])))

    return Fitted(forces**2, seconds, evaluate, f"{forces} × {forces} forces")


def hierarchical(
    places: np.ndarray, values: np.ndarray, limit: float, lattice: Lattice, extension: int
) -> Iterator[Fitted]:
    """G+Smo's adaptive fit with truncated hierarchical B-splines, step by step until the limit is met.

    Its Python package has the basis and the least-squares fit, but not the loop (`gsHFitting`): this is that loop,
    which refines every cell with an error above the limit, and `extension` cells of the finer level around it. It
    gives up at half as many functions as samples, as ours does.
    """
    import pygismo

    started, seconds = time.perf_counter(), 0.0
    vectors = [pygismo.nurbs.gsKnotVector(knots(elements).tolist(), 3) for elements in lattice]
    basis = pygismo.hsplines.gsTHBSplineBasis2(pygismo.nurbs.gsTensorBSplineBasis2(*vectors))
    levels = np.zeros(lattice, int)  # of the cells of the finest level so far
    at, deepest, heights = np.ascontiguousarray(places.T), 0, values[None]
    while True:
        fitting = pygismo.modelling.gsFitting(at, heights, basis)
        fitting.compute(0.0)
        predicted = fitting.result().eval(at)[0]
        if not np.isfinite(predicted).all():
            fitting.compute(SMOOTHING)
            predicted = fitting.result().eval(at)[0]
        # Written so that what the fit could not determine (NaN) violates, too.
        violating = ~(np.abs(predicted - values) <= limit)
        seconds += time.perf_counter() - started
        remark = f"from {lattice[0]} × {lattice[1]}" + ("; tolerance not met" if violating.any() else "")
        # The surface is a reference into the fit, and valid until the basis is refined.
        yield Fitted(
            basis.size(), seconds, lambda to, fit=fitting: fit.result().eval(np.ascontiguousarray(to.T))[0], remark
        )
        if not violating.any() or 2 * basis.size() > len(values):
            return
        started = time.perf_counter()
        cells = np.minimum((places[violating] * levels.shape).astype(int), np.array(levels.shape) - 1)
        own = levels[cells[:, 0], cells[:, 1]]
        cells = np.unique(np.column_stack([own, cells >> (deepest - own)[:, None]]), axis=0)
        if own.max() == deepest:
            levels, deepest = np.kron(levels, np.ones((2, 2), int)), deepest + 1
        basis.refineElements(_boxes(cells, levels, deepest, extension))


def _boxes(cells: np.ndarray, levels: np.ndarray, deepest: int, extension: int) -> list[int]:
    """G+Smo's boxes (level, lower and upper corner) around cells (level, i, j), raised in the raster of levels."""
    boxes: list[int] = []
    for level, i, j in cells.tolist():
        shift = deepest - level - 1
        limits = [length >> shift for length in levels.shape]
        low = [max(0, 2 * k - extension) for k in (i, j)]
        high = [min(limit, 2 * k + 2 + extension) for k, limit in zip((i, j), limits, strict=True)]
        boxes += [level + 1, *low, *high]
        part = levels[low[0] << shift : high[0] << shift, low[1] << shift : high[1] << shift]
        np.maximum(part, level + 1, out=part)
    return boxes
