"""Spline spaces by Bézier extraction: from host topology to padded device arrays."""

from ._bernstein import (
    bernstein as bernstein,
    bernstein6 as bernstein6,
    bernstein_terms as bernstein_terms,
    blossom_weights as blossom_weights,
    gram as gram,
    product_weights as product_weights,
)
from ._extraction import BezierElements as BezierElements, bezier_elements as bezier_elements
from ._space import (
    ElementTables as ElementTables,
    SplineSpace as SplineSpace,
    Topology as Topology,
    capacity_for as capacity_for,
    extract as extract,
    knot_arrays as knot_arrays,
    pad as pad,
    resolve_dtype as resolve_dtype,
    spline_space as spline_space,
    to_device as to_device,
)
from ._update import ElementUpdate as ElementUpdate, refine_elements as refine_elements
