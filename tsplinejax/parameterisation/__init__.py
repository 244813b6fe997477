"""Parameters of point clouds: a place in [0, 1]² for every point, planar or conformal."""

from ._boundary import find_boundary as find_boundary
from ._conformal import conformal as conformal
from ._corners import find_corners as find_corners
from ._planar import planar as planar
from ._result import Dilatation as Dilatation, Parameterisation as Parameterisation
