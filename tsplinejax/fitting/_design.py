"""A space's blending functions at many places as a sparse matrix, and its normal equations, factorised on the host.

Row j of B holds the blending functions at place j, of which sixteen are not zero (more on a rational space). It is made
in bands of rows, so that memory stays bounded.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float, Int

from .._errors import InputError
from ..data import Frame
from ..space import ElementTables, SplineSpace, bernstein, to_device
from ._energy import element_energy, smoothing_for_cutoff

if TYPE_CHECKING:
    from scipy.sparse import csc_array, csr_array
    from scipy.sparse.linalg import SuperLU

PLACES_A_BAND = 1 << 16
BANDS_KEPT = 32  # about 200 bytes a place: 400 MB
# For more columns SuperLU starts threads in its many small products: no gain alone, and ten times slower on busy cores.
COLUMNS_A_SOLVE = 4
# A residual of the normal equations above the first is refined once; a condition above the second leaves no digits.
REFINED_ABOVE, WORST_CONDITION = 1e-13, 1e13


class Design:
    """B in bands of places, kept where all fit into little memory, else computed anew each time round."""

    def __init__(self, space: SplineSpace, places: Float[np.ndarray, "m 2"]) -> None:
        self.space, self.places = space, places
        # One compiled kernel for all bands, and for sets of about the same size.
        self.length = min(PLACES_A_BAND, 1 << (len(places) - 1).bit_length())
        self.kept = list(self._bands()) if len(places) <= BANDS_KEPT * PLACES_A_BAND else None

    def __iter__(self) -> Iterator[tuple[slice, "csr_array"]]:
        return iter(self.kept) if self.kept is not None else self._bands()

    def _bands(self) -> Iterator[tuple[slice, "csr_array"]]:
        from scipy.sparse import csr_array

        for first in range(0, len(self.places), self.length):
            band = self.places[first : first + self.length].astype(self.space.dtype)
            padded = np.zeros((self.length, 2), band.dtype)
            padded[: len(band)] = band
            functions, values = (np.asarray(part)[: len(band)] for part in blending(self.space, to_device(padded)))
            k = functions.shape[1]
            starts = np.arange(0, len(band) * k + 1, k, dtype=np.int32)
            entries = (values.ravel().astype(np.float64), functions.ravel(), starts)
            yield slice(first, first + len(band)), csr_array(entries, shape=(len(band), int(self.space.n_functions)))


@eqx.filter_jit
def blending(space: SplineSpace, places: Float[Array, "m 2"]) -> tuple[Int[Array, "m K"], Float[Array, "m K"]]:
    """The blending functions alive at each place, and their values."""
    element, tables = space.locator(places), space.tables
    local = (places - tables.corner[element]) / tables.size[element]
    along_s = (tables.along_s[element] * bernstein(local[:, 0])[:, None]).sum(axis=-1)
    along_t = (tables.along_t[element] * bernstein(local[:, 1])[:, None]).sum(axis=-1)
    values = along_s * along_t
    if space.rational:
        values = values / values.sum(axis=1, keepdims=True)
    return tables.functions[element], values


def energy_matrix(space: SplineSpace, frame: Frame, cutoff: float | None = None) -> "csc_array":
    """K, the bending energy's matrix; with a `cutoff`, in units of an element's size, weighted on each element by the λ
    of that cut-off for one sample on the unit of area.
    """
    sides = np.asarray(frame.extent) / np.sqrt(np.prod(frame.extent))
    matrices = np.asarray(_element_energies(space.tables, to_device(sides, space.dtype)), np.float64)
    count, n = int(space.n_elements), int(space.n_functions)
    if cutoff is not None:
        areas = np.prod(np.asarray(space.tables.size, np.float64) * sides, axis=1)
        matrices = smoothing_for_cutoff(cutoff, 1.0) * (areas**2)[:, None, None] * matrices
    return _scattered(np.asarray(space.tables.functions)[:count], matrices[:count], n)


@jax.jit
def _element_energies(tables: ElementTables, extent: Float[Array, " 2"]) -> Float[Array, "e K K"]:
    return element_energy(tables.along_s, tables.along_t, tables.size * extent)


def _scattered(functions: Int[np.ndarray, "e K"], matrices: Float[np.ndarray, "e K K"], n: int) -> "csc_array":
    """The sum of the elements' matrices."""
    from scipy.sparse import coo_array

    k = functions.shape[1]
    rows, columns = np.repeat(functions, k, axis=1).ravel(), np.tile(functions, (1, k)).ravel()
    return coo_array((matrices.ravel(), (rows, columns)), shape=(n, n)).tocsc()


@dataclass(frozen=True, eq=False)
class Factor:
    """The factorised normal matrix, scaled to a diagonal of one: S (Bᵀ B + λ K) S."""

    matrix: "csc_array"
    scale: Float[np.ndarray, "n 1"]
    lu: "SuperLU"

    def solve(self, loads: Float[np.ndarray, "n c"]) -> Float[np.ndarray, "n c"]:
        """Control points; functions that no sample sees get zero, as their loads are."""
        scaled = loads * self.scale
        solution = self._by_columns(scaled)
        left = scaled - self.matrix @ solution
        if np.abs(left).max() > REFINED_ABOVE * np.abs(scaled).max():
            solution += self._by_columns(left)
        return solution * self.scale

    def _by_columns(self, loads: Float[np.ndarray, "n c"]) -> Float[np.ndarray, "n c"]:
        """Solve for a few columns at a time."""
        solution = np.empty_like(loads)
        for first in range(0, loads.shape[1], COLUMNS_A_SOLVE):
            taken = slice(first, first + COLUMNS_A_SOLVE)
            solution[:, taken] = self.lu.solve(loads[:, taken])
        return solution


def factorise(design: Design, energy: "csc_array | None", weight: float, of: str) -> Factor:
    """Factorise BᵀB + λK.

    **Raises:** `InputError`, which names whose samples they are, where they do not determine the control points.
    """
    from scipy.sparse import csc_array

    n = int(design.space.n_functions)
    refusal = InputError(
        f"the {len(design.places)} valid samples of {of} do not determine the {n} control points; "
        "give smoothing= (the default 'auto' fills gaps), or a coarser space"
    )
    if energy is None and len(design.places) < n:
        raise refusal
    matrix = csc_array((n, n)) if energy is None else weight * energy
    for _, band in design:
        matrix = matrix + band.T @ band
    return factorised(matrix, refusal)


def factorised(matrix: "csc_array", refusal: InputError) -> Factor:
    """Factorise a normal matrix; where it is singular, refuse."""
    from scipy.sparse import diags_array
    from scipy.sparse.linalg import splu

    diagonal = matrix.diagonal()
    empty = diagonal <= 0
    scale = diags_array(1 / np.sqrt(np.where(empty, 1, diagonal)))
    scaled = (scale @ matrix @ scale + diags_array(empty.astype(np.float64))).tocsc()
    try:
        options = {"SymmetricMode": True}
        lu = splu(scaled, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    except RuntimeError as error:  # exactly singular
        raise refusal from error
    if not _condition(scaled, lu) < WORST_CONDITION:
        raise refusal
    return Factor(scaled, scale.diagonal()[:, None], lu)


def _condition(matrix: "csc_array", lu: "SuperLU") -> float:
    """The condition number in the 1-norm, estimated by a few solves."""
    from scipy.sparse.linalg import LinearOperator, onenormest

    solves: Any = dict.fromkeys(("matvec", "rmatvec", "matmat", "rmatmat"), lu.solve)
    inverse: Any = LinearOperator(matrix.shape, dtype=np.float64, **solves)  # type: ignore[call-arg]
    return float(onenormest(inverse) * abs(matrix).sum(axis=0).max())
