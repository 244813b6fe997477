"""How to pick a tolerance: what each one costs, from one fit.

One fit goes down a ladder of tolerances: where one is met, its control points are noted and refinement goes on to the
next. So each count is that of a fit to that tolerance alone, or nearly so, at the price of one fit to the tightest.

Below the largest error that noise alone makes, about σ √(2 ln m) for m samples, a fit follows the noise: default
tolerances end there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import ArrayLike
from numpy.typing import DTypeLike

from .._errors import InputError
from ..data import Samples, as_data, parse_length
from ..mesh import AbstractRefinement, AnalysisSuitable, Direction
from ._adaptive import State, advance, begin, polish, terminate
from ._criteria import ToleranceCriterion
from ._fit import prepare
from ._options import Length, Request, read_request
from ._problem import Budget, Problem
from ._result import Step, StopReason
from ._solve import AbstractSolver, LocalSolver

LOOSEST, TIGHTEST = 0.1, 0.001  # of the range
FEWEST_RUNGS = 3
SAMPLES_A_CONTROL_POINT = 10
ROUND_NUMBERS = (1.0, 2.0, 5.0)


@dataclass(frozen=True)
class SuggestedTolerance:
    """One way to choose: `name` (coarse, medium, fine), the tolerance, the control points it takes, and the reason."""

    name: str
    tolerance: float
    control_points: int
    reason: str


@dataclass(frozen=True)
class ToleranceStudy:
    """What tolerances cost; lengths are in the data's unit.

    **Attributes:**

    - `tolerances`: those that were met, loosest first.
    - `control_points`, `max_errors`: of the first step that met each.
    - `suggested`: three of them, from coarse to fine.
    - `unit`, `range`: of the data; `noise`: the estimated standard deviation.
    - `warnings`: what the user should know, in sentences.

    `plot.plot_tolerance_study` draws it.
    """

    tolerances: tuple[float, ...]
    control_points: tuple[int, ...]
    max_errors: tuple[float, ...]
    suggested: tuple[SuggestedTolerance, ...]
    unit: str | None
    range: float
    noise: float
    warnings: tuple[str, ...]

    def __repr__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        steps = ", ".join(
            f"{tolerance:.4g}{unit}: {count}"
            for tolerance, count in zip(self.tolerances, self.control_points, strict=True)
        )
        return f"ToleranceStudy(control points by tolerance: {steps})"


def tolerance_study(
    data: Any,
    tolerances: Sequence[Length] | None = None,
    *,
    robust: bool = True,
    max_control_points: int | None = None,
    max_seconds: float | None = None,
    refinement: AbstractRefinement | None = None,
    solver: AbstractSolver | None = None,
    lattice: tuple[int, int] | None = None,
    first_cut: Direction = "s",
    smoothing: float | str = "auto",
    weights: ArrayLike | None = None,
    dtype: DTypeLike | None = None,
    as_surface: bool = False,
) -> ToleranceStudy:
    """Tell what tolerances cost in control points, and suggest three of them.

    **Arguments:**

    - `data`: whatever [`fit`][tsplinejax.fit] accepts.
    - `tolerances`: those to look at, in the data's unit or with one (`"5nm"`); by default round numbers from a tenth of
      the range down to a thousandth, or to the noise where that is reached before.
    - `robust`: set isolated spikes aside, which else decide over every tight tolerance.
    - `max_control_points`, `max_seconds`: where the study ends; by default at a tenth of the samples, and without a
      limit of time. Tolerances that were not met are left out, and a warning says so.
    - The others are those of [`fit`][tsplinejax.fit].

    **Returns:** a [`ToleranceStudy`][tsplinejax.ToleranceStudy].

    **Raises:** `InputError` for data that cannot be fitted, a constant surface, and tolerances that are no positive
    lengths, or of which none was met.

    >>> from tsplinejax.data import peaks
    >>> study = tolerance_study(peaks((40, 50)), [0.5, 0.05])
    >>> study.control_points[0] < study.control_points[1]
    True
    """
    source = data if isinstance(data, Samples) else as_data(data)
    request = read_request(
        source,
        tolerance=None,
        relative_tolerance=None,
        noise=None,
        weights=weights,
        robust=robust,
        as_surface=as_surface,
    )
    if not request.range > 0:
        raise InputError("a tolerance study needs a surface that is not constant; any tolerance suits this one")
    rungs = _ladder(request) if tolerances is None else _checked(tolerances, request.samples.frame.unit)
    most = max(256, len(request.samples) // SAMPLES_A_CONTROL_POINT)
    budget = Budget(None, most if max_control_points is None else max_control_points, max_seconds)
    problem = prepare(
        replace(request, tolerance=rungs[0], noise=None),
        refinement or AnalysisSuitable(),
        solver or LocalSolver(),
        budget,
        smoothing,
        dtype,
        first_cut,
        lattice,
    )
    steps, history, stop = _descend(problem, rungs)
    left = rungs[len(steps) :]
    table = dict(zip(rungs, steps, strict=False))
    return _study(request, _chosen(table, history, request.range) if tolerances is None else table, left, stop)


def _checked(tolerances: Sequence[Length], unit: str | None) -> list[float]:
    """Positive lengths in the data's unit, loosest first."""
    values = sorted({parse_length(tolerance, unit) for tolerance in tolerances}, reverse=True)
    if not values or values[-1] <= 0:
        raise InputError(f"a tolerance study needs tolerances above zero; received {list(tolerances)!r}")
    return values


def _ladder(request: Request) -> list[float]:
    """Round tolerances (1, 2, 5, 10, ...) from the range to a thousandth of it, or to the noise; loosest first."""
    spread, count = request.range, len(request.samples)
    largest_noise = _sigma(request) * np.sqrt(2 * np.log(max(count, 2)))
    low = min(max(TIGHTEST * spread, largest_noise), spread / 4)
    decades = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(spread))) + 1)
    rungs = [float(f"{digit}e{decade}") for decade in decades for digit in ROUND_NUMBERS]
    return [rung for rung in reversed(rungs) if low * (1 - 1e-9) <= rung <= spread]


def _sigma(request: Request) -> float:
    """The estimated standard deviation of the noise."""
    return 0.0 if request.noise is None else request.noise.sigma


def _descend(problem: Problem, rungs: list[float]) -> tuple[list[Step], tuple[Step, ...], StopReason]:
    """The steps that met the tolerances, one after the other, as far as the budget goes; all steps; why it ended."""
    steps: list[Step] = []
    stop = StopReason.TOLERANCE
    state = begin(problem)
    try:
        for before, rung in zip([rungs[0], *rungs], rungs, strict=False):
            problem = replace(problem, criterion=ToleranceCriterion(rung / problem.scaling.factor))
            state, stop = _down_to(problem, replace(state, excess=state.excess * (before / rung), stage=np.inf))
            if state.worst > 1:
                break
            steps.append(state.history[-1])
    except KeyboardInterrupt:
        stop = StopReason.INTERRUPTED
    return steps, state.history, stop


def _down_to(problem: Problem, state: State) -> tuple[State, StopReason]:
    """Advance until the tolerance is met, or nothing more can be done."""
    while True:
        stop = terminate(problem, state)
        if stop is StopReason.FINEST and not state.polished:
            state = polish(problem, state)
        elif stop is None:
            state = advance(problem, state)
        else:
            return state, stop


def _chosen(table: dict[float, Step], history: tuple[Step, ...], spread: float) -> dict[float, Step]:
    """The tolerances of at most a tenth of the range; looser ones too, where these are too few."""
    loose = sum(rung > LOOSEST * spread for rung in table)
    first = max(0, min(loose, len(table) - FEWEST_RUNGS))
    chosen = dict(list(table.items())[first:])
    if len(chosen) >= FEWEST_RUNGS:
        return chosen
    # Hardly anything was met: what the steps did reach, rounded up to two digits.
    reached = {float(f"{1.05 * step.max_error:.1e}"): step for step in reversed(history)}
    picked = sorted(reached, reverse=True)[:: max(1, (len(reached) - 1) // 2)]
    return dict(sorted({**{rung: reached[rung] for rung in picked}, **chosen}.items(), reverse=True))


def _study(request: Request, table: dict[float, Step], left: list[float], stop: StopReason) -> ToleranceStudy:
    """The frozen study."""
    unit = request.samples.frame.unit
    names = ", ".join(f"{rung:.4g}" for rung in left) + (f" {unit}" if unit else "")
    if not table:
        raise InputError(f"none of the tolerances {names} was met ({stop}: {stop.message}); give looser ones")
    warnings = list(request.warnings)
    if left:
        warnings.append(
            f"not met and left out: the tolerances {names}; the trial fit ended first ({stop}: {stop.message})"
        )
    return ToleranceStudy(
        tolerances=tuple(table),
        control_points=tuple(step.control_points for step in table.values()),
        max_errors=tuple(step.max_error for step in table.values()),
        suggested=_suggested(request, table, _why_no_finer(list(table)[-1], _sigma(request), bool(left))),
        unit=unit,
        range=request.range,
        noise=_sigma(request),
        warnings=tuple(warnings),
    )


def _suggested(request: Request, table: dict[float, Step], why_no_finer: str) -> tuple[SuggestedTolerance, ...]:
    """The loosest, the middle and the tightest, each with its reason; the tightest of those that cost the same."""
    worthwhile = {step.control_points: rung for rung, step in table.items()}
    rungs = list(worthwhile.values() if len(worthwhile) >= FEWEST_RUNGS else table)
    chosen = {"coarse": rungs[0], "medium": rungs[(len(rungs) - 1) // 2], "fine": rungs[-1]}
    sense = {"coarse": "the smallest model", "medium": "a compromise", "fine": why_no_finer}
    return tuple(
        SuggestedTolerance(
            name, rung, table[rung].control_points, f"{_percent(rung / request.range)} of the range: {sense[name]}"
        )
        for name, rung in chosen.items()
    )


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %" if share < 0.995 else f"{100 * share:.0f} %"


def _why_no_finer(tolerance: float, noise: float, ended_early: bool) -> str:
    """What keeps the finest tolerance from being finer still."""
    if ended_early:
        return "the tightest that was reached within the budget"
    if noise > 0 and tolerance < 15 * noise:
        return f"{tolerance / noise:.2g} standard deviations of the noise, which a tighter one would follow"
    return "fine detail, well above the noise"
