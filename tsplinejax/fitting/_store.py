"""What a fit keeps on the device for every Bézier element, and the kernels that renew chosen rows of it.

A Bézier element keeps its row, its *slot*, from step to step; one that is cut leaves its slot to a piece of it. A step
renews the rows of what changed, in place: its cost follows the change, not the mesh. Kernels receive a padded list of
slots and run over it in chunks, as many as the list is long, so that one compiled kernel serves every list.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ..mesh import DEPTH
from ..space import blossom_weights, extract, knot_arrays, pad, to_device
from ._discretisation import Discretisation
from ._energy import piece_energies
from ._moments import Moments, empty_moments
from ._system import System, element_matrices
from ._tiles import Carry, add_up, in_turns

CHUNK = 1024  # rows in a turn of a kernel's loop
FEW_ROWS = 16384  # a store of so few is read as a whole: a list of some of them would ask for a kernel of its own


class Chosen(eqx.Module):
    """Some rows: their numbers, padded to the capacity, and how many there are."""

    rows: Int[Array, " capacity"]
    count: Int[Array, ""]

    @property
    def capacity(self) -> int:
        """Length of the padded list."""
        return len(self.rows)

    def turn(self, first: Array, length: int) -> tuple[Array, Bool[Array, " length"]]:
        """Rows of a turn, and which of them are more than padding."""
        rows = lax.dynamic_slice_in_dim(self.rows, first, length)
        return rows, first + jnp.arange(length) < self.count

    @property
    def places(self) -> "Chosen":
        """The places in the list, to run over where results are wanted in its order."""
        return Chosen(jnp.arange(len(self.rows)), self.count)


class Consecutive(eqx.Module):
    """Consecutive rows."""

    first: Int[Array, ""]
    length: int = eqx.field(static=True)


class Members(eqx.Module):
    """Most of the first `count` rows of a store: all are read, in place, which is faster than picking them."""

    member: Bool[Array, " capacity"]
    count: Int[Array, ""]

    @property
    def capacity(self) -> int:
        """Rows of the store."""
        return len(self.member)

    def turn(self, first: Array, length: int) -> tuple[Consecutive, Bool[Array, " length"]]:
        """Rows of a turn, and which of them are members."""
        member = lax.dynamic_slice_in_dim(self.member, first, length)
        return Consecutive(first, length), member & (first + jnp.arange(length) < self.count)


def rows_at(array: Array, rows: Array | Consecutive) -> Array:
    """Rows of an array, wherever they lie or in a run."""
    return lax.dynamic_slice_in_dim(array, rows.first, rows.length) if isinstance(rows, Consecutive) else array[rows]


def choose(rows: np.ndarray, capacity: int) -> Chosen:
    """A list of rows for the device."""
    return Chosen(to_device(pad(rows.astype(np.int32), capacity, 0)), to_device(len(rows), np.int32))


def choose_among(rows: np.ndarray, count: int, capacity: int) -> Chosen | Members:
    """Rows among the first `count`, as a list where they are few of many."""
    if count > FEW_ROWS and 2 * len(rows) < count:
        return choose(rows, capacity)
    member = np.zeros(capacity, bool)
    member[rows] = True
    return Members(to_device(member), to_device(count, np.int32))


class Store(eqx.Module):
    """Rows by slot.

    **Attributes:**

    - `functions`: blending functions alive on each Bézier element, -1 where padded, (capacity, K).
    - `boxes`: index boxes, (capacity, 4).
    - `along_s`, `along_t`: Bernstein coefficients of the functions, (capacity, K, 4).
    - `moments`: of the samples.
    - `matrices`, `loads`: the functions' normal matrix and right-hand side, (capacity, K, K) and (capacity, K, d).
    - `points`: Bézier points of the surface, with those of Σb as a last component where it is rational,
      (capacity, 4, 4, c).
    """

    functions: Int[Array, "capacity K"]
    boxes: Int[Array, "capacity 4"]
    along_s: Float[Array, "capacity K 4"]
    along_t: Float[Array, "capacity K 4"]
    moments: Moments
    matrices: Float[Array, "capacity K K"]
    loads: Float[Array, "capacity K d"]
    points: Float[Array, "capacity 4 4 c"]

    @property
    def capacity(self) -> int:
        """Number of rows."""
        return self.functions.shape[0]

    @property
    def system(self) -> System:
        """The quadratic form of the fit."""
        return System(self.functions, self.matrices, self.loads)


def empty_store(capacity: int, width: int, dimension: int, components: int, dtype: np.dtype) -> Store:
    """A store for K = `width` functions an element, without elements."""

    def zeros(*shape: int) -> Array:
        return to_device(np.zeros((capacity, *shape), dtype))

    return Store(
        to_device(np.full((capacity, width), -1, np.int32)),
        to_device(np.zeros((capacity, 4), np.int32)),
        zeros(width, 4),
        zeros(width, 4),
        empty_moments(capacity, dimension, dtype),
        zeros(width, width),
        zeros(width, dimension),
        zeros(4, 4, components),
    )


Rows = TypeVar("Rows", bound=Store | Array)


@partial(jax.jit, static_argnums=1)
def grow(rows: Rows, capacity: int) -> Rows:
    """The same rows, and empty ones up to a capacity."""

    def longer(part: Array) -> Array:
        return jnp.pad(part, ((0, capacity - part.shape[0]), *((0, 0) for _ in part.shape[1:])))

    return jax.tree.map(longer, rows)


def fresh_store(mesh: Discretisation, dimension: int, *, rational: bool, dtype: np.dtype) -> Store:
    """A store of this mesh alone, without samples."""
    width = mesh.elements.functions.shape[1]
    store = empty_store(mesh.capacity, width, dimension, dimension + rational, dtype)
    return with_mesh(store, mesh, mesh.slots)


def with_mesh(store: Store, mesh: Discretisation, touched: np.ndarray) -> Store:
    """The store with the topology of a mesh, and the functions of the touched elements (slots) extracted anew."""
    functions = pad(mesh.by_slot(mesh.elements.functions), store.capacity, -1)
    boxes = pad(mesh.by_slot(mesh.elements.boxes).astype(np.int32), store.capacity, 0)
    store = replace(store, functions=to_device(functions), boxes=to_device(boxes))
    knots = knot_arrays(mesh.tmesh, mesh.tmesh.local_knots, mesh.capacity, np.dtype(store.along_s.dtype))
    chosen = choose(touched, mesh.capacity)
    along = _extract_rows((store.along_s, store.along_t), store.functions, store.boxes, knots, chosen)
    return replace(store, along_s=along[0], along_t=along[1])


def over(chosen: Chosen | Members, turn: Callable[[Any, Array, Carry], Carry], carry: Carry) -> Carry:
    """Run `turn(rows, real, carry)` over the chosen rows, a chunk at a time; padded entries are not `real`."""
    length = min(CHUNK, chosen.capacity)

    def body(first: Array, carry: Carry) -> Carry:
        return turn(*chosen.turn(first, length), carry)

    return in_turns(chosen.count, length, body, carry)


def put(store: Array, rows: Array, real: Bool[Array, " chunk"], values: Array) -> Array:
    """Write rows, but not those that only pad."""
    return store.at[jnp.where(real, rows, len(store))].set(values, mode="drop")


@partial(jax.jit, donate_argnums=0)
def clear(moments: Moments, chosen: Chosen) -> Moments:
    """No samples in the chosen elements."""

    def turn(rows: Array, real: Array, carry: Moments) -> Moments:
        return jax.tree.map(lambda part: put(part, rows, real, jnp.zeros((), part.dtype)), carry)

    return over(chosen, turn, moments)


def _sides(boxes: Int[Array, "e 4"], lattice: Int[Array, " 2"], dtype: np.dtype) -> Float[Array, "e 2"]:
    """Sizes of elements in parameters."""
    return (boxes[:, 2:] - boxes[:, :2]).astype(dtype) / (lattice << DEPTH).astype(dtype)


@partial(jax.jit, donate_argnums=0)
def _extract_rows(
    along: tuple[Array, Array], functions: Array, boxes: Array, knots: Array, chosen: Chosen
) -> tuple[Array, Array]:
    """Bernstein coefficients of the chosen elements' functions."""

    def turn(rows: Array, real: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        pieces = extract(functions[rows], knots, boxes[rows], along[0].dtype)
        return put(carry[0], rows, real, pieces[0]), put(carry[1], rows, real, pieces[1])

    return over(chosen, turn, along)


def renew_system(store: Store, smoothing: float, extent: Array, lattice: Array, chosen: Chosen) -> Store:
    """Assemble the chosen elements' matrices and loads; `extent` is physical, in units of √(Lx Ly)."""
    weight = to_device(smoothing, np.dtype(store.matrices.dtype))
    parts = (store.functions, store.boxes, store.along_s, store.along_t, store.moments)
    matrices, loads = assemble_rows((store.matrices, store.loads), parts, weight, extent, lattice, chosen)
    return replace(store, matrices=matrices, loads=loads)


@partial(jax.jit, donate_argnums=0)
def assemble_rows(
    rows_of: tuple[Array, Array],
    parts: tuple[Array, Array, Array, Array, Moments],
    smoothing: Array,
    extent: Array,
    lattice: Array,
    chosen: Chosen,
) -> tuple[Array, Array]:
    """Matrices and loads of the chosen elements from functions, boxes, coefficients and moments."""
    functions, boxes, along_s, along_t, moments = parts

    def turn(rows: Array, real: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        sides = _sides(boxes[rows], lattice, along_s.dtype) * extent
        part = Moments(moments.mass[rows], moments.load[rows])
        matrices, loads = element_matrices(functions[rows], along_s[rows], along_t[rows], sides, part, smoothing)
        return put(carry[0], rows, real, matrices), put(carry[1], rows, real, loads)

    return over(chosen, turn, rows_of)


def renew_points(
    store: Store, coefficients: Float[Array, "capacity d"], extent: Array, lattice: Array, chosen: Chosen
) -> tuple[Store, Float[Array, " capacity"]]:
    """Bézier points of the chosen elements; their bending energies (of the numerator), in the list's order."""
    parts = (store.functions, store.boxes, store.along_s, store.along_t)
    points, energies = _place_points(store.points, parts, coefficients, extent, lattice, chosen)
    return replace(store, points=points), energies


@partial(jax.jit, donate_argnums=0)
def _place_points(
    points: Array,
    parts: tuple[Array, Array, Array, Array],
    coefficients: Array,
    extent: Array,
    lattice: Array,
    chosen: Chosen,
) -> tuple[Array, Array]:
    """Points of every chosen element, and energies in the order of the list."""
    functions, boxes, along_s, along_t = parts
    d = coefficients.shape[1]
    if points.shape[-1] > d:
        coefficients = jnp.concatenate([coefficients, jnp.ones_like(coefficients[:, :1])], axis=1)

    def turn(at: Array, real: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        rows = chosen.rows[at]
        s, t, values = along_s[rows], along_t[rows], coefficients[jnp.maximum(functions[rows], 0)]
        pieces = add_up(
            (s[:, k, :, None] * t[:, k, None, :])[..., None] * values[:, k, None, None, :]
            for k in range(functions.shape[1])
        )
        energies = piece_energies(pieces[..., :d], _sides(boxes[rows], lattice, points.dtype) * extent)
        return put(carry[0], rows, real, pieces), put(carry[1], at, real, energies)

    return over(chosen.places, turn, (points, jnp.zeros(len(chosen.rows), points.dtype)))


@jax.jit
def transfer(
    old: Float[Array, "old d"],
    points: Float[Array, "old_rows 4 4 c"],
    kept: Int[Array, " capacity"],
    altered: Chosen,
    row: Int[Array, " capacity"],
    knots: Float[Array, "capacity 2 3"],
) -> Float[Array, "capacity d"]:
    """Coefficients of the old surface in a refined space.

    Function i keeps the coefficient `kept[i]` of `old` to the bit; the altered ones (negative there) are blossoms of
    the old Bézier points at `row`, at the local inner `knots`, divided by their Σb where the points carry it.
    """
    d = old.shape[1]

    def turn(at: Array, real: Array, carry: Array) -> Array:
        pieces = points[row[at]]
        s, t = (blossom_weights(knots[at, k].astype(points.dtype)) for k in range(2))
        moved = add_up(s[:, a, None] * add_up(t[:, b, None] * pieces[:, a, b] for b in range(4)) for a in range(4))
        if moved.shape[1] > d:
            moved = moved[:, :d] / jnp.where(moved[:, d:] > 0, moved[:, d:], 1)
        return put(carry, altered.rows[at], real, moved)

    return over(altered.places, turn, jnp.where((kept >= 0)[:, None], old[jnp.maximum(kept, 0)], 0))
