"""T-spline surfaces: values, derivatives, normals, curvatures, exact transfer to refined spaces."""

from ._evaluate import bezier_points as bezier_points, jet as jet
from ._geometry import Curvatures as Curvatures, curvatures as curvatures, normals as normals
from ._grid import heights_on_grid as heights_on_grid, parameter_grid as parameter_grid
from ._parameters import check_parameters as check_parameters
from ._project import Projection as Projection, project as project
from ._transfer import beside_anchors as beside_anchors, blossom as blossom, transfer as transfer
from ._tspline import TSpline as TSpline, make_surface as make_surface
from ._two import held as held, invert_two as invert_two, multiply_two as multiply_two
