"""Missing data: holes filled from what surrounds them, with an uncertainty that held-out patches of the map validate.

Several fillers stand by: bicubic splines on the pixel lattice of different energies, with creases or without, and the
covariance of the map itself. Which of them, in which mixture, is decided by the map: patches of the shapes of its own
holes are hidden elsewhere, and what predicts them best fills the holes.
"""

from ._covariance import CovarianceFiller as CovarianceFiller
from ._fill import default_fillers as default_fillers, fill_missing as fill_missing
from ._filled import Filled as Filled
from ._filler import AbstractFiller as AbstractFiller
from ._interpolate import interpolate as interpolate
from ._spline import SplineFiller as SplineFiller
