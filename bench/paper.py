"""The global fit that the paper compares with: dyadic refinement, and Eq. 4 solved exactly in each step.

Written to be quick where it can be without another algorithm: blending functions by tsplinejax's compiled kernels, the
design matrix sparse, its normal equations factorised by SuperLU in the ordering that suits them best.
"""

import time
from dataclasses import dataclass

import jax
import numpy as np
from scipy.sparse import csr_array, diags_array, vstack
from scipy.sparse.linalg import splu

import tsplinejax as tsj
from tsplinejax.fitting._design import Design

LATTICE = (8, 8)
# Dyadic meshes may have dependent blending functions, which a pseudo-inverse bears and a factorisation does not.
RIDGE = 1e-12


@dataclass(frozen=True)
class Reached:
    """A step: seconds since the start, size of the mesh, and how well the surface fits."""

    seconds: float
    control_points: int
    max_error: float
    snr_db_centred: float


def fit_globally(height_map: tsj.HeightMap, tolerance: float, max_steps: int = 40) -> list[Reached]:
    """Bisect every element with an error above the tolerance and solve anew, until there is none."""
    started = time.perf_counter()
    samples = height_map.samples()
    places, values = samples.parameters, samples.values[:, 0]
    signal = float(np.sum((values - values.mean()) ** 2))
    mesh, steps = tsj.b_lattice(*LATTICE), []
    cells = np.minimum((places * mesh.extent).astype(np.int64), np.array(mesh.extent) - 1)
    while True:
        residuals = values - _fitted(mesh, places, values)
        snr = 10 * np.log10(signal / float(np.sum(residuals**2)))
        errors = np.abs(residuals)
        steps.append(Reached(time.perf_counter() - started, mesh.n_anchors, float(errors.max()), float(snr)))
        element = mesh.locate(*cells.T)
        violating = np.bincount(element[errors > tolerance], minlength=mesh.n_elements) > 0
        marked = violating & (np.bincount(element, minlength=mesh.n_elements) > 1)
        if not marked.any() or len(steps) > max_steps or 2 * mesh.n_anchors > len(values):
            return steps
        mesh = tsj.refine(mesh, marked, tsj.Dyadic()).mesh


def _fitted(mesh: tsj.TMesh, places: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The exact least-squares surface over a mesh, at the samples."""
    design = design_matrix(mesh, places)
    normal = (design.T @ design).tocsc()
    diagonal = normal.diagonal()
    shift = RIDGE * diagonal + np.where(diagonal > 0, 0, 1)  # one for a function that no sample sees
    options = {"SymmetricMode": True}
    factor = splu(
        (normal + diags_array(shift)).tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options
    )
    return design @ factor.solve(design.T @ values)


def design_matrix(mesh: tsj.TMesh, places: np.ndarray) -> csr_array:
    """Rational blending functions (Eq. 2) at every sample."""
    space = tsj.spline_space(mesh, dtype="float64", rational=True)
    design = csr_array(vstack([band for _, band in Design(space, places)], format="csr")).copy()
    design.eliminate_zeros()  # elements with fewer functions than the table has room for
    return design


jax.config.update("jax_enable_x64", True)
