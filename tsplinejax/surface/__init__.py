"""T-spline surfaces: values, derivatives, normals, curvatures, exact transfer to refined spaces."""

from ._geometry import Curvatures as Curvatures, curvatures as curvatures, normals as normals
from ._transfer import beside_anchors as beside_anchors, blossom as blossom, transfer as transfer
from ._tspline import (
    TSpline as TSpline,
    bezier_points as bezier_points,
    check_parameters as check_parameters,
    make_surface as make_surface,
)
