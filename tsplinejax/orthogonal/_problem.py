"""Orthogonal distance fitting as a least-squares problem.

Unknown are the control points' moves q_i (r components along fixed directions of each, the first one normal) and the
parameters u_j of every point. The residuals are √w_j (S(u_j) - x_j), the tangential moves held by their weights, and
the bending of every Bézier element.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..fitting import energy_grams, energy_scales
from ..space import SplineSpace, bernstein
from ..surface import bezier_points, held

CHUNK = 1 << 12


class Unknowns(eqx.Module):
    """Moves of the control points and parameters of the points."""

    moves: Float[Array, "n r"]
    parameters: Float[Array, "m 2"]


class FootProblem(eqx.Module):
    """What is fitted, in the fit's own scale; padded control points have no mass and never move.

    **Attributes:**

    - `space`: the spline space.
    - `points`, `weights`: (m, 3) and (m,).
    - `reference`: the control points that moves are counted from.
    - `directions`: columns along which each control point moves; unit vectors, the first one normal.
    - `mass`: Σ_j w_j b_i(u_j), the weight of the points each control point sees.
    - `hold`: weight of each component of a move.
    - `smoothing`, `sides`: λ, and the parameter square's sides for the bending energy.
    - `reach`: how far beyond the square parameters may go, where the surface goes on as its border's polynomials: a
      surface that slides freely moves its border, too.
    """

    space: SplineSpace
    points: Float[Array, "m 3"]
    weights: Float[Array, " m"]
    reference: Float[Array, "n 3"]
    directions: Float[Array, "n 3 r"]
    mass: Float[Array, " n"]
    hold: Float[Array, "n r"]
    smoothing: Float[Array, ""]
    sides: Float[Array, " 2"]
    reach: Float[Array, ""]

    def within(self, parameters: Float[Array, "m 2"]) -> Float[Array, "m 2"]:
        """Parameters no farther out than they may go."""
        return jnp.clip(parameters, -self.reach, 1 + self.reach)

    def held(self, parameters: Float[Array, "m 2"], gradient: Float[Array, "m 2"]) -> Bool[Array, "m 2"]:
        """Parameters that can go no farther in the direction of descent."""
        return held((parameters + self.reach) / (1 + 2 * self.reach), gradient)

    def control_points(self, moves: Float[Array, "n r"]) -> Float[Array, "n 3"]:
        """Where moves take the control points."""
        return self.reference + self.displacements(moves)

    def displacements(self, moves: Float[Array, "n r"]) -> Float[Array, "n 3"]:
        """Moves as vectors in space."""
        return jnp.einsum("ncr,nr->nc", self.directions, moves, precision="highest")


def residuals(unknowns: Unknowns, problem: FootProblem) -> tuple[Array, Array, Array]:
    """All residuals: half the sum of their squares is the objective."""
    control = problem.control_points(unknowns.moves)
    gap = surface_at(problem.space, control, unknowns.parameters) - problem.points
    return (
        jnp.sqrt(problem.weights)[:, None] * gap,
        jnp.sqrt(problem.hold) * unknowns.moves,
        _bending(problem, control),
    )


@jax.custom_jvp
def surface_at(space: SplineSpace, control: Float[Array, "n 3"], parameters: Float[Array, "m 2"]) -> Array:
    """The surface's points at parameters, with a derivative that keeps little in memory."""
    return jets(space, control, parameters, 0)[0]


@surface_at.defjvp
def _surface_at_jvp(primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    space, control, parameters = primals
    _, moved, shifted = tangents
    S, S_s, S_t = jets(space, control, parameters, 1)
    change = surface_at(space, moved, parameters)
    return S, change + S_s * shifted[:, :1] + S_t * shifted[:, 1:]


def jets(
    space: SplineSpace, control: Float[Array, "n 3"], parameters: Float[Array, "m 2"], order: int
) -> tuple[Float[Array, "m 3"], ...]:
    """S, and with order 1 S_s and S_t: in chunks whose temporaries stay in the cache."""
    pieces = bezier_points(space.tables, control).reshape(-1, 4, 12)

    def of_chunk(places: Float[Array, "chunk 2"]) -> tuple[Array, ...]:
        element = space.locator(jnp.clip(places, 0, 1))
        size = space.tables.size[element]
        local = (places - space.tables.corner[element]) / size
        return piece_jets(pieces[element], local[:, None], size[:, None], order)

    m = len(parameters)
    chunks = -(-m // CHUNK)
    length = -(-m // chunks)
    padded = jnp.pad(parameters, ((0, chunks * length - m), (0, 0))).reshape(chunks, length, 2)
    return tuple(part.reshape(-1, 3)[:m] for part in jax.lax.map(of_chunk, padded))


def piece_jets(
    pieces: Float[Array, "b 4 12"], local: Float[Array, "b lanes 2"], size: Float[Array, "b 1 2"], order: int
) -> tuple[Float[Array, "b lanes 3"], ...]:
    """S, and with order 1 S_s and S_t, at lanes of polynomial pieces given by their Bézier points."""
    along = [[bernstein(local[..., k], n) / size[..., k, None] ** n for n in range(order + 1)] for k in range(2)]
    rows = [jnp.matmul(part, pieces, precision="highest").reshape(*local.shape[:2], 4, 3) for part in along[0]]
    orders = ((0, 0), (1, 0), (0, 1))[: 2 * order + 1]
    return tuple(jnp.sum(along[1][t][..., None] * rows[s], axis=2) for s, t in orders)


def _bending(problem: FootProblem, control: Float[Array, "n 3"]) -> Float[Array, "elements 3 16 3"]:
    """Residuals whose squares add up to λ times the bending energy."""
    tables = problem.space.tables
    pieces = bezier_points(tables, control).reshape(-1, 16, 3)
    scales = jnp.sqrt(problem.smoothing * energy_scales(tables.size * problem.sides))
    roots = jnp.asarray(_roots(), pieces.dtype)
    return scales[:, :, None, None] * jnp.einsum("kij,ejd->ekid", roots, pieces, precision="highest")


def _roots() -> Float[np.ndarray, "3 16 16"]:
    """Square roots of the three quadratic forms of the energy on the unit square."""
    values, vectors = np.linalg.eigh(energy_grams())
    return np.sqrt(np.maximum(values, 0))[:, :, None] * np.swapaxes(vectors, 1, 2)
