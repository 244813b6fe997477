"""Exact transfer of a surface to a refined space, by blossoms.

The coefficient of a blending function is the tensor blossom of the surface's Bézier piece beside the function's
anchor, at the function's three inner knots in each direction. On nested spaces the refined surface is the old one to
round-off.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._errors import InputError
from ..mesh import TMesh
from ..space import BezierElements, bezier_elements, blossom_weights, spline_space, to_device
from ._evaluate import bezier_points
from ._tspline import TSpline


def transfer(surface: TSpline, tmesh: TMesh) -> TSpline:
    """The same surface over a refined T-mesh.

    **Arguments:**

    - `surface`: a polynomial T-spline over a dyadic, analysis-suitable mesh.
    - `tmesh`: a refinement of its mesh.

    **Raises:** `InputError` for rational surfaces, whose spaces are not nested, and for meshes that are no refinement.

    >>> from tsplinejax.mesh import b_lattice, refine
    >>> from tsplinejax.space import spline_space
    >>> from tsplinejax.surface import make_surface
    >>> coarse = make_surface(spline_space(b_lattice(1, 1)), np.arange(16.0))
    >>> fine = transfer(coarse, refine(coarse.space.mesh, [True]).mesh)
    >>> bool(abs(fine(np.array([[0.3, 0.4]])) - coarse(np.array([[0.3, 0.4]])))[0] < 1e-12)
    True
    """
    old = surface.space.mesh
    if surface.space.rational or old.forest is None or tmesh.forest is None:
        raise InputError(
            "only polynomial T-splines over dyadic meshes transfer exactly; refit this one over the new mesh"
        )
    _require_refinement(old, tmesh)
    space = spline_space(tmesh, dtype=surface.space.dtype, rational=False)
    coefficients = surface.control_points.reshape(surface.control_points.shape[0], -1)
    element, knots = beside_anchors(old, bezier_elements(old), tmesh)
    pieces = bezier_points(surface.space.tables, coefficients)
    moved = blossom(pieces, to_device(element, np.int32), to_device(knots))
    points = moved.reshape(-1, *surface.control_points.shape[1:])
    return TSpline(space, points, surface.origin, surface.extent, surface.unit)


def beside_anchors(
    old: TMesh, elements: BezierElements, new: TMesh, chosen: Int[np.ndarray, " n"] | None = None
) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, "n 2 3"]]:
    """For each new blending function, or each chosen one: the old Bézier element beside its anchor, and its inner knots
    in that element.
    """
    assert elements.codes is not None
    assert old.forest is not None
    anchors, knots = new.anchors, new.local_knots[:, :, 1:4]
    if chosen is not None:
        anchors, knots = anchors[chosen], knots[chosen]
    anchors = np.clip(anchors, 0, np.array(new.extent) - 1)
    element = np.searchsorted(elements.codes, old.forest.code(anchors[:, 0], anchors[:, 1]), side="right") - 1
    if new.border == "clamped":
        knots = np.clip(knots, 0, np.array(new.extent)[:, None])
    box = elements.boxes[element]
    return element, (knots - box[:, :2, None]) / (box[:, 2:] - box[:, :2])[:, :, None]


@jax.jit
def blossom(
    points: Float[Array, "elements 4 4 d"], element: Int[Array, " n"], knots: Float[Array, "n 2 3"]
) -> Float[Array, "n d"]:
    """Tensor blossoms of Bézier pieces at three arguments in each direction."""
    weights = blossom_weights(knots.astype(points.dtype))
    return jnp.einsum("na,nb,nabd->nd", weights[:, 0], weights[:, 1], points[element], precision="highest")


def _require_refinement(old: TMesh, new: TMesh) -> None:
    """Raise unless every new element lies in an old one of the same lattice."""
    assert old.forest is not None
    assert new.forest is not None
    same = (old.forest.lattice, old.forest.first_cut, old.border) == (
        new.forest.lattice,
        new.forest.first_cut,
        new.border,
    )
    if same:
        holder = old.boxes[old.locate(new.boxes[:, 0], new.boxes[:, 1])]
        same = bool((new.boxes[:, 2:] <= holder[:, 2:]).all())
    if not same:
        raise InputError(
            "a surface transfers to a refinement of its own mesh; this mesh is not one; make it with refine"
        )
