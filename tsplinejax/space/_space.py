"""Spline spaces: the one door from host topology to device arrays.

On a Bézier element each blending function is an outer product of two cubic polynomials, so a space is a padded table:
which functions live on each element, and four Bernstein coefficients along s and t for each. Arrays are padded to
capacities that grow fourfold, then twofold; a kernel compiled for one capacity serves every mesh that fits it.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int
from numpy.typing import DTypeLike

from .._errors import InputError
from ..data import checked_precision
from ..mesh import Border, Direction, TMesh, forest_from_boxes, from_rectangles
from ._bernstein import blossom_pieces
from ._extraction import BezierElements, bezier_elements
from ._locate import AbstractLocator, make_locator

LEAST_CAPACITY = 256
DOUBLING_FROM = 1 << 16


def capacity_for(count: int, least: int = LEAST_CAPACITY) -> int:
    """The padded length for a count: `least`, four times that, and so on; above 65 536 it doubles, to spare memory.

    >>> capacity_for(300), capacity_for(256), capacity_for(70_000)
    (1024, 256, 131072)
    """
    capacity = least
    while capacity < count:
        capacity *= 4 if capacity < DOUBLING_FROM else 2
    return capacity


class Topology(eqx.Module):
    """What rebuilds the T-mesh of a space: its elements' index boxes, padded with -1, and its knot lines."""

    boxes: Int[np.ndarray, "capacity 4"]
    lattice: Int[np.ndarray, " 2"]
    lines: tuple[np.ndarray, np.ndarray] | None
    first_cut: Direction | None = eqx.field(static=True)
    border: Border = eqx.field(static=True)

    def rebuild(self) -> TMesh:
        """The T-mesh."""
        boxes = np.asarray(self.boxes, np.int64)
        boxes = boxes[boxes[:, 0] >= 0]
        if self.lines is None:
            assert self.first_cut is not None
            columns, rows = (int(count) for count in self.lattice)
            return forest_from_boxes(boxes, (columns, rows), first_cut=self.first_cut, border=self.border)
        corners = [np.asarray(self.lines[k % 2])[boxes[:, k]] for k in range(4)]
        return from_rectangles(np.stack(corners, axis=1), border=self.border)


class ElementTables(eqx.Module):
    """What kernels over Bézier elements need: shapes depend on the capacity alone, so nothing else recompiles them.

    **Attributes:**

    - `functions`: blending functions alive on each Bézier element, (capacity, K).
    - `along_s`, `along_t`: their Bernstein coefficients there, (capacity, K, 4); zero where padded.
    - `corner`, `size`: the Bézier elements in parameters, (capacity, 2).
    """

    functions: Int[Array, "capacity K"]
    along_s: Float[Array, "capacity K 4"]
    along_t: Float[Array, "capacity K 4"]
    corner: Float[Array, "capacity 2"]
    size: Float[Array, "capacity 2"]


class SplineSpace(eqx.Module):
    """The span of a T-mesh's blending functions, ready for evaluation.

    **Attributes:**

    - `tables`: blending functions and their Bernstein coefficients on every Bézier element, padded.
    - `locator`: finds the Bézier element of a parameter.
    - `topology`: what rebuilds the T-mesh.
    - `n_functions`, `n_elements`: how many blending functions and Bézier elements are real.
    - `rational`: whether the blending functions do not sum to one, so that Eq. 2's division is needed.
    """

    tables: ElementTables
    locator: AbstractLocator
    topology: Topology
    n_functions: Int[np.ndarray, ""]
    n_elements: Int[np.ndarray, ""]
    rational: bool = eqx.field(static=True)

    @property
    def capacity(self) -> int:
        """Padded length of the tables."""
        return self.tables.functions.shape[0]

    @property
    def mesh(self) -> TMesh:
        """The T-mesh, rebuilt on the host."""
        return self.topology.rebuild()

    @property
    def dtype(self) -> np.dtype:
        """float32 or float64."""
        return np.dtype(self.tables.along_s.dtype)

    def __repr__(self) -> str:
        form = "rational" if self.rational else "polynomial"
        return f"SplineSpace({self.n_functions} functions, {self.n_elements} Bézier elements, {form}, {self.dtype})"


def spline_space(
    tmesh: TMesh,
    *,
    dtype: DTypeLike | None = None,
    rational: bool | None = None,
    elements: BezierElements | None = None,
    along: tuple[np.ndarray, np.ndarray] | None = None,
    capacity: int | None = None,
) -> SplineSpace:
    """The spline space of a T-mesh, by Bézier extraction.

    **Arguments:**

    - `tmesh`: any T-mesh.
    - `dtype`: float32 or float64; by default float64 where JAX's x64 mode is on, else float32.
    - `rational`: whether to divide by the sum of the blending functions; by default found out.
    - `elements`: the mesh's Bézier elements, where they are known already.
    - `along`: with them, the functions' Bernstein coefficients along s and t, (elements, K, 4) each, zero beyond the
      elements where they are padded already.
    - `capacity`: padded length; by default the smallest that fits.

    **Raises:** `InputError` for a dtype that JAX cannot hold.

    >>> from tsplinejax.mesh import b_lattice
    >>> spline_space(b_lattice(3, 2)).n_functions.item()
    30
    """
    dtype = resolve_dtype(dtype)
    elements = bezier_elements(tmesh) if elements is None else elements
    needed = max(len(elements), tmesh.n_anchors)
    capacity = capacity_for(needed) if capacity is None else capacity
    if capacity < needed:
        raise InputError(f"the capacity must hold {needed} entries; received {capacity}; leave it out to choose one")
    functions = pad(elements.functions, capacity, -1)
    boxes = pad(elements.boxes.astype(np.int32), capacity, np.array([-1, -1, 0, 0], np.int32))
    if along is None:
        knots = knot_arrays(tmesh, tmesh.local_knots, capacity, dtype)
        along_s, along_t = _extract(to_device(functions), knots, _box_arrays(tmesh, boxes, dtype), dtype)
    else:
        along_s, along_t = (to_device(pad(part, capacity, 0)) for part in along)
    corner, size = _parameter_boxes(tmesh, elements.boxes, capacity, dtype)
    if rational is None:
        sums = np.asarray(jnp.einsum("eka,ekb->eab", along_s, along_t))[: len(elements)]
        rational = bool(np.abs(sums - 1).max() > 1e3 * np.finfo(dtype).eps)
    tables = ElementTables(to_device(np.maximum(functions, 0)), along_s, along_t, to_device(corner), to_device(size))
    return SplineSpace(
        tables,
        make_locator(tmesh, elements, capacity, dtype),
        _topology(tmesh, capacity),
        np.asarray(tmesh.n_anchors, np.int32),
        np.asarray(len(elements), np.int32),
        rational,
    )


def resolve_dtype(dtype: DTypeLike | None) -> np.dtype:
    """float32 or float64; float64 only where JAX's x64 mode is on, and then by default."""
    double = bool(jax.config.read("jax_enable_x64"))
    default = np.float64 if double else np.float32
    return checked_precision(default if dtype is None else dtype, double=double)


def to_device(array: ArrayLike, dtype: DTypeLike | None = None) -> Array:
    """Host numbers on the device; a plain transfer, where `jnp.asarray` would compile a copy for every new shape."""
    return jax.device_put(np.asarray(array, dtype))


def pad(array: np.ndarray, length: int, value: object) -> np.ndarray:
    """The array with rows of a constant appended up to a length; itself where it is so long."""
    if len(array) == length:
        return array
    padded = np.empty((length, *array.shape[1:]), array.dtype)
    padded[: len(array)] = array
    padded[len(array) :] = value
    return padded


def knot_arrays(tmesh: TMesh, local_knots: np.ndarray, capacity: int, dtype: np.dtype) -> Array:
    """Local knots for the device: exact int32 index coordinates on a forest, parameters on a mesh given by hand."""
    knots = local_knots
    if tmesh.lines is not None:
        values = np.stack([tmesh.parameters(axis, knots[:, axis]) for axis in range(2)], axis=1)
        return to_device(pad(values.astype(dtype), capacity, 0))
    if tmesh.border == "clamped":
        knots = np.clip(knots, 0, np.array(tmesh.extent)[:, None])
    return to_device(pad(knots.astype(np.int32), capacity, 0))


def _box_arrays(tmesh: TMesh, boxes: np.ndarray, dtype: np.dtype) -> Array:
    """Element boxes in the coordinates of the knots."""
    if tmesh.lines is None:
        return to_device(boxes)
    values = np.stack([tmesh.parameters(k % 2, boxes[:, k]) for k in range(4)], axis=1).astype(dtype)
    values[:, 2:] = np.maximum(values[:, 2:], values[:, :2] + np.finfo(dtype).tiny)
    return to_device(values)


def extract(
    functions: Int[Array, "e K"], knots: Array, boxes: Array, dtype: np.dtype
) -> tuple[Float[Array, "e K 4"], Float[Array, "e K 4"]]:
    """Bernstein coefficients along s and t of every function on every Bézier element; zero for negative functions.

    `knots` (functions, 2, 5) and `boxes` (e, 4) share their coordinates.
    """
    local = knots[jnp.maximum(functions, 0)]  # (e, K, 2, 5)
    low, high = boxes[:, None, :2, None], boxes[:, None, 2:, None]
    inside = (local - low).astype(dtype) / (high - low).astype(dtype)
    pieces = jnp.where((functions >= 0)[..., None, None], blossom_pieces(inside), 0)
    return pieces[:, :, 0], pieces[:, :, 1]


_extract = jax.jit(extract, static_argnums=3)


def _parameter_boxes(tmesh: TMesh, boxes: np.ndarray, capacity: int, dtype: np.dtype) -> tuple[np.ndarray, np.ndarray]:
    """Lower corners and sizes of the Bézier elements in parameters."""
    values = np.stack([tmesh.parameters(k % 2, boxes[:, k]) for k in range(4)], axis=1)
    corner = pad(values[:, :2].astype(dtype), capacity, 0)
    return corner, pad((values[:, 2:] - values[:, :2]).astype(dtype), capacity, 1)


def _topology(tmesh: TMesh, capacity: int) -> Topology:
    """The space's record of its T-mesh."""
    boxes = pad(tmesh.boxes.astype(np.int32), capacity, -1)
    if tmesh.forest is None:
        return Topology(boxes, np.asarray(tmesh.extent, np.int32), tmesh.lines, None, tmesh.border)
    lattice = np.asarray(tmesh.forest.lattice, np.int32)
    return Topology(boxes, lattice, None, tmesh.forest.first_cut, tmesh.border)
