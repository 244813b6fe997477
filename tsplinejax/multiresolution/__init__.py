"""Multi-resolution analysis: a surface as a sum of bands in nested spline spaces, from coarse to fine."""

from ._mra import mra as mra
from ._result import Band as Band, Multiresolution as Multiresolution
