"""Orthogonal distance fitting: surfaces through points in space, by their distances along the normals."""

from ._descent import Elimination as Elimination
from ._differentiable import fit_points as fit_points
from ._fit import fit_orthogonal as fit_orthogonal
from ._methods import (
    AbstractMethod as AbstractMethod,
    AbstractRobust as AbstractRobust,
    Huber as Huber,
    Joint as Joint,
    Normal as Normal,
    Parametric as Parametric,
    Tukey as Tukey,
)
from ._result import (
    OrthogonalFit as OrthogonalFit,
    OrthogonalStep as OrthogonalStep,
    OrthogonalStop as OrthogonalStop,
)
