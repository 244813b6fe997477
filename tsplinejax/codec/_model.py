"""The T-spline of a compressed map: topology, control points in whole steps, and its heights at the pixels."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int
from numpy.typing import DTypeLike

from .._errors import InputError
from ..mesh import TMesh
from ..space import resolve_dtype, spline_space
from ..surface import TSpline, make_surface
from ._compressed import CompressedHeader, ModelPart
from ._entropy import AbstractCoder
from ._points import code_points
from ._topology import code_topology


@dataclass(frozen=True, eq=False)
class RoundedModel:
    """A mesh, and control points as whole steps above the map's offset."""

    tmesh: TMesh
    steps: Int[np.ndarray, " n"]


def code_model(coder: AbstractCoder, part: ModelPart, model: RoundedModel | None) -> RoundedModel:
    """Write a model, or read it where `model` is `None`; either way it is returned.

    **Raises:** `InputError` where what is read is not of the size that the header declares.
    """
    given = None if model is None else model.tmesh
    tmesh = code_topology(coder, part.lattice, part.first_cut, given, part.elements)
    if (tmesh.n_elements, tmesh.n_anchors) != (part.elements, part.control_points):
        raise InputError(
            f"its mesh has {tmesh.n_elements} elements and {tmesh.n_anchors} anchors, but its header says "
            f"{part.elements} and {part.control_points}"
        )
    return RoundedModel(tmesh, code_points(coder, tmesh, None if model is None else model.steps))


def require_x64() -> None:
    """Raise unless JAX holds float64, in which bounds are kept."""
    try:
        resolve_dtype(np.float64)
    except InputError as error:
        raise InputError(
            "a T-spline keeps its bound in float64, and JAX's 64-bit mode is off; run "
            "jax.config.update('jax_enable_x64', True) before the first computation, or compress with mode='grid'"
        ) from error


def surface_of_model(header: CompressedHeader, model: RoundedModel, dtype: DTypeLike) -> TSpline:
    """The T-spline of a model.

    **Raises:** `InputError` where the control points overflow, or for float64 where JAX's x64 mode is off.
    """
    assert header.model is not None
    points = header.offset + model.steps * header.model.point_step
    if not np.isfinite(points).all():
        raise InputError("its control points are not finite; it was damaged: copy it again")
    return make_surface(spline_space(model.tmesh, dtype=dtype, rational=False), points, header.frame)
