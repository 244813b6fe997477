"""Fitting: the adaptive loop, its criteria and solvers, and least squares on a fixed space."""

from ._adaptive import State as State, advance as advance, begin as begin, terminate as terminate
from ._batch import BatchItem as BatchItem, fit_batch as fit_batch
from ._criteria import (
    AbstractCriterion as AbstractCriterion,
    NoiseCriterion as NoiseCriterion,
    ToleranceCriterion as ToleranceCriterion,
)
from ._design import blending as blending
from ._energy import (
    default_smoothing as default_smoothing,
    element_energy as element_energy,
    energy_grams as energy_grams,
    energy_scales as energy_scales,
)
from ._engines import (
    AbstractEngine as AbstractEngine,
    DaskEngine as DaskEngine,
    DevicesEngine as DevicesEngine,
)
from ._finish import surface_of as surface_of
from ._fit import fit as fit, pose_fit as pose_fit
from ._lstsq import lstsq as lstsq
from ._options import resolved_limit as resolved_limit
from ._problem import Budget as Budget, Problem as Problem, scaled_lattice as scaled_lattice
from ._result import FitResult as FitResult, Step as Step, StopReason as StopReason
from ._shared import SharedFit as SharedFit, fit_shared as fit_shared
from ._solve import (
    AbstractSolver as AbstractSolver,
    GlobalSolver as GlobalSolver,
    LocalSolver as LocalSolver,
)
from ._stages import (
    SMALLEST as SMALLEST,
    Marking as Marking,
    bisect_worst as bisect_worst,
    mark_in_stages as mark_in_stages,
)
from ._study import (
    SuggestedTolerance as SuggestedTolerance,
    ToleranceStudy as ToleranceStudy,
    tolerance_study as tolerance_study,
)
from ._system import bernstein_mass as bernstein_mass
from ._tiles import in_turns as in_turns
