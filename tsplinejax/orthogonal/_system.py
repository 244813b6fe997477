"""The normal equations of a Gauss-Newton step, with every point's own 2 × 2 block eliminated.

With r = S - x, J = [S_s, S_t] and D = Jᵀ J, elimination leaves Q = I - J D⁻¹ Jᵀ = n nᵀ of each point: the matrix is
Σ_j w_j (b b ᵀ) ⊗ Q_j, tangent-distance minimisation. A parameter that the border holds is not eliminated, and its
direction stays in Q. Q is symmetric, so on a Bézier element the points enter only through six weighted sets of moments
of degree six.

Points change their elements from step to step. They are sorted by element anew each time and taken in blocks of fixed
length, each of one element; the number of blocks is known only on the device, their capacity is not needed.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..fitting import bernstein_mass, element_energy, in_turns
from ..space import bernstein, bernstein6
from ..surface import bezier_points, invert_two, multiply_two
from ._problem import FootProblem, Unknowns, jets, piece_jets

LANES = 32
FOOT_STEPS = 3
BLOCKS = 256  # in one turn: what it needs stays in the cache
UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
FULL = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])


class NormalSystem(eqx.Module):
    """The reduced normal equations: one matrix an element, (16, r, 16, r), the gradient, and the objective."""

    functions: Int[Array, "elements 16"]
    matrices: Float[Array, "elements 16 r 16 r"]
    gradient: Float[Array, "n r"]
    diagonal: Float[Array, "n r"]


class _Blocks(eqx.Module):
    """Runs of sorted points, each within one element."""

    order: Int[Array, " m"]
    first_point: Int[Array, " elements"]
    points: Int[Array, " elements"]
    first_block: Int[Array, " elements"]
    total: Int[Array, ""]

    def lanes(self, blocks: Int[Array, " b"]) -> tuple[Array, Array, Array]:
        """Elements of blocks, their points, and which lanes hold one."""
        after = self.first_block + (self.points + LANES - 1) // LANES
        element = jnp.minimum(jnp.searchsorted(after, blocks, side="right"), len(after) - 1)
        inside = (blocks - self.first_block[element]) * LANES
        lane = jnp.arange(LANES)
        real = (lane < (self.points[element] - inside)[:, None]) & (blocks < self.total)[:, None]
        place = self.first_point[element] + inside
        return element, self.order[jnp.clip(place[:, None] + lane, 0, len(self.order) - 1)], real


def _sorted(element: Int[Array, " m"], elements: int) -> _Blocks:
    counts = jnp.bincount(element, length=elements)
    blocks = (counts + LANES - 1) // LANES
    total = jnp.sum(blocks)
    return _Blocks(jnp.argsort(element), jnp.cumsum(counts) - counts, counts, jnp.cumsum(blocks) - blocks, total)


def assemble(problem: FootProblem, unknowns: Unknowns) -> NormalSystem:
    """Sum all points and add what holds and bends."""
    tables = problem.space.tables
    control = problem.control_points(unknowns.moves)
    mass, load = _moments(problem, control, unknowns.parameters)
    basis = (tables.along_s[..., :, None] * tables.along_t[..., None, :]).reshape(*tables.functions.shape, 16)
    energy = problem.smoothing * element_energy(tables.along_s, tables.along_t, tables.size * problem.sides)
    parts = [_congruent(basis, bernstein_mass(mass[..., k])) for k in range(6)]
    parts = [part + energy if a == b else part for part, (a, b) in zip(parts, UPPER, strict=True)]
    directions = problem.directions[tables.functions]
    matrices = _along(jnp.stack(parts), directions)
    local = jnp.matmul(basis, load.reshape(len(load), 16, 3), precision="highest")
    local = local + jnp.matmul(energy, control[tables.functions], precision="highest")
    gradient = jnp.zeros_like(control).at[tables.functions].add(local)
    along = jnp.einsum("ncr,nc->nr", problem.directions, gradient, precision="highest")
    diagonal = jnp.einsum("eirir->eir", matrices)
    return NormalSystem(
        tables.functions,
        matrices,
        along + problem.hold * unknowns.moves,
        problem.hold.at[tables.functions].add(diagonal),
    )


def _congruent(basis: Float[Array, "e 16 16"], form: Float[Array, "e 16 16"]) -> Float[Array, "e 16 16"]:
    half = jnp.matmul(basis, form, precision="highest")
    return jnp.matmul(half, jnp.swapaxes(basis, 1, 2), precision="highest")


def _along(parts: Float[Array, "6 e 16 16"], directions: Float[Array, "e 16 3 r"]) -> Float[Array, "e 16 r 16 r"]:
    """Matrices in space as matrices of moves along each control point's directions."""
    half = jnp.einsum("eica,cdeik->eiakd", directions, parts[FULL], precision="highest")
    return jnp.einsum("eiakd,ekdb->eiakb", half, directions, precision="highest")


def _moments(
    problem: FootProblem, control: Float[Array, "n 3"], parameters: Float[Array, "m 2"]
) -> tuple[Float[Array, "elements 7 7 6"], Float[Array, "elements 4 4 3"]]:
    """Σ w Q B⁶ B⁶ and Σ w Q r B³ B³ over the points of each element."""
    tables = problem.space.tables
    pieces = bezier_points(tables, control).reshape(-1, 4, 12)
    count = len(tables.functions)
    blocks = _sorted(problem.space.locator(jnp.clip(parameters, 0, 1)), count)

    def turn(first: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        element, index, real = blocks.lanes(first + jnp.arange(BLOCKS))
        place = parameters[index]
        size = tables.size[element][:, None]
        local = (place - tables.corner[element][:, None]) / size
        weights = jnp.where(real, problem.weights[index], 0)
        found = piece_jets(pieces[element], local, size, 1)
        forms, pulls = _projected(problem, found, problem.points[index], place, weights)
        six_s, six_t = (jnp.swapaxes(bernstein6(local[..., k]), 1, 2) for k in range(2))
        cubic_s, cubic_t = (jnp.swapaxes(bernstein(local[..., k]), 1, 2) for k in range(2))
        mass, load = carry
        return mass.at[element].add(_outer(six_s, six_t, forms)), load.at[element].add(_outer(cubic_s, cubic_t, pulls))

    dtype = control.dtype
    empty = (jnp.zeros((count, 7, 7, 6), dtype), jnp.zeros((count, 4, 4, 3), dtype))
    return in_turns(blocks.total, BLOCKS, turn, empty)


def _outer(along_s: Array, along_t: Array, values: Array) -> Array:
    """Σ over lanes of along_s[a] along_t[b] values[k], blocks (a, b, k)."""
    b, p, lanes = along_t.shape
    right = (jnp.swapaxes(along_t, 1, 2)[..., None] * values[:, :, None]).reshape(b, lanes, -1)
    return jnp.matmul(along_s, right, precision="highest").reshape(b, p, p, -1)


def _projected(
    problem: FootProblem, found: tuple[Array, ...], points: Array, parameters: Array, weights: Array
) -> tuple[Float[Array, "b lanes 6"], Float[Array, "b lanes 3"]]:
    """w Q, its upper triangle, and w Q r."""
    S, S_s, S_t = found
    r = S - points
    _, inverse = _block(problem, r, S_s, S_t, parameters)
    a, b, c = (inverse[..., k, None] for k in range(3))
    left_s, left_t = a * S_s + b * S_t, b * S_s + c * S_t
    columns = [(1.0 if i == j else 0.0) - left_s[..., i] * S_s[..., j] - left_t[..., i] * S_t[..., j] for i, j in UPPER]
    Q = jnp.stack(columns, axis=-1)
    pulls = jnp.stack([sum(Q[..., FULL[i, j]] * r[..., j] for j in range(3)) for i in range(3)], axis=-1)
    return weights[..., None] * Q, weights[..., None] * pulls


def _block(
    problem: FootProblem, r: Array, S_s: Array, S_t: Array, parameters: Array
) -> tuple[Float[Array, "*m 2"], Float[Array, "*m 3"]]:
    """Gradient Jᵀ r and inverse of Jᵀ J of every point; held parameters have a row and column of zeros."""

    def dot(a: Array, b: Array) -> Array:
        return jnp.sum(a * b, axis=-1)

    gradient = jnp.stack([dot(r, S_s), dot(r, S_t)], axis=-1)
    form = jnp.stack([dot(S_s, S_s), dot(S_s, S_t), dot(S_t, S_t)], axis=-1)
    return gradient, invert_two(form, problem.held(parameters, gradient))


def follow(problem: FootProblem, unknowns: Unknowns, step: Float[Array, "n r"]) -> Float[Array, "m 2"]:
    """The eliminated part of a step: how parameters move with the control points, within the square."""
    space, parameters = problem.space, unknowns.parameters
    S, S_s, S_t = jets(space, problem.control_points(unknowns.moves), parameters, 1)
    change = jets(space, problem.displacements(step), parameters, 0)[0]
    gradient, inverse = _block(problem, S - problem.points, S_s, S_t, parameters)
    extra = jnp.stack([jnp.sum(change * S_s, axis=1), jnp.sum(change * S_t, axis=1)], axis=1)
    return problem.within(parameters - multiply_two(inverse, gradient + extra)) - parameters


def bend_of_path(
    problem: FootProblem, unknowns: Unknowns, moves: Float[Array, "n r"], change: Float[Array, "m 2"]
) -> Float[Array, "n r"]:
    """Σ w b Q S̈ along each control point's directions: how the points' surface bends along a step, seen across it."""
    space, parameters = problem.space, unknowns.parameters
    control, shift = problem.control_points(unknowns.moves), problem.displacements(moves)

    def velocity(time: Array) -> Array:
        def place(time: Array) -> Array:
            return jets(space, control + time * shift, parameters + time * change, 0)[0]

        return jax.jvp(place, (time,), (jnp.ones_like(time),))[1]

    start = jnp.zeros((), parameters.dtype)
    bend = jax.jvp(velocity, (start,), (jnp.ones_like(start),))[1]
    S, S_s, S_t = jets(space, control, parameters, 1)
    _, inverse = _block(problem, S - problem.points, S_s, S_t, parameters)
    along = jnp.stack([jnp.sum(bend * S_s, axis=1), jnp.sum(bend * S_t, axis=1)], axis=1)
    slide = multiply_two(inverse, along)
    across = problem.weights[:, None] * (bend - S_s * slide[:, :1] - S_t * slide[:, 1:])
    (pull,) = jax.vjp(lambda c: jets(space, c, parameters, 0)[0], control)[1](across)
    return jnp.einsum("ncr,nc->nr", problem.directions, pull, precision="highest")


def settle(problem: FootProblem, moves: Float[Array, "n r"], parameters: Float[Array, "m 2"]) -> Float[Array, "m 2"]:
    """A few steps of every point's own towards its foot on the moved surface: a long step takes them far off it."""
    control = problem.control_points(moves)

    def closer(_: Array, parameters: Array) -> Array:
        S, S_s, S_t = jets(problem.space, control, parameters, 1)
        gradient, inverse = _block(problem, S - problem.points, S_s, S_t, parameters)
        return problem.within(parameters - multiply_two(inverse, gradient))

    return jax.lax.fori_loop(0, FOOT_STEPS, closer, parameters)


def multiply(system: NormalSystem, hold: Float[Array, "n r"], x: Float[Array, "n r"]) -> Float[Array, "n r"]:
    """The reduced matrix times moves."""
    count, width, r = system.matrices.shape[:3]
    local = x[system.functions].reshape(count, width * r)
    square = system.matrices.reshape(count, width * r, width * r)
    products = jnp.einsum("eij,ej->ei", square, local, precision="highest").reshape(count, width, r)
    return (hold * x).at[system.functions].add(products)


def dense(system: NormalSystem, hold: Float[Array, "n r"]) -> Float[Array, "nr nr"]:
    """The reduced matrix, all of it."""
    n, r = hold.shape
    unknown = system.functions[:, :, None] * r + jnp.arange(r)
    matrix = jnp.zeros((n * r, n * r), hold.dtype)
    matrix = matrix.at[unknown[:, :, :, None, None], unknown[:, None, None]].add(system.matrices)
    return matrix + jnp.diag(hold.ravel())


def blocks_of(system: NormalSystem, hold: Float[Array, "n r"]) -> Float[Array, "n r r"]:
    """The diagonal blocks of the control points."""
    n, r = hold.shape
    own = jnp.einsum("eiaib->eiab", system.matrices)
    empty = jnp.zeros((n, r, r), hold.dtype).at[:, jnp.arange(r), jnp.arange(r)].set(hold)
    return empty.at[system.functions].add(own)
