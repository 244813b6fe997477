"""How to pick a tolerance: what each one costs, from one fit.

The adaptive loop passes every looser tolerance on its way to the tightest, so its history tells, for each tolerance, a
number of control points that meets it. A fit to that tolerance alone takes about as many, since the marking falls in
stages anyway.

Below the largest error that noise alone makes, about σ √(2 ln m) for m samples, a fit follows the noise: default
tolerances end there.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._errors import InputError
from ..data import Samples, as_data, parse_length
from ._fit import fit
from ._options import Length, Request, read_request
from ._result import FitResult

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
    **options: Any,
) -> ToleranceStudy:
    """Tell what tolerances cost in control points, and suggest three of them.

    **Arguments:**

    - `data`: whatever [`fit`][tsplinejax.fit] accepts.
    - `tolerances`: those to look at, in the data's unit or with one (`"5nm"`); by default round numbers from a tenth of
      the range down to a thousandth, or to the noise where that is reached before.
    - `robust`: set isolated spikes aside, which else decide over every tight tolerance.
    - `max_control_points`, `max_seconds`: where the fit behind the study ends; by default a tenth of the samples, and
      no limit. Tolerances that were not reached are left out, and a warning says so.
    - `options`: further options of [`fit`][tsplinejax.fit], such as `solver`, `lattice` or `as_surface`.

    **Returns:** a [`ToleranceStudy`][tsplinejax.ToleranceStudy].

    **Raises:** `InputError` for data that cannot be fitted, a constant surface, and tolerances that are no positive
    lengths.

    >>> from tsplinejax.data import peaks
    >>> study = tolerance_study(peaks((40, 50)), [0.5, 0.05])
    >>> study.control_points[0] < study.control_points[1]
    True
    """
    source = data if isinstance(data, Samples) else as_data(data)
    wanted = None if tolerances is None else _checked(tolerances, _unit_of(source))
    request = _request(source, robust, options)
    spread, count = request.range, len(request.samples)
    if not spread > 0:
        raise InputError("a tolerance study needs a surface that is not constant; any tolerance suits this one")
    rungs = wanted or _ladder(spread, _sigma(request) * np.sqrt(2 * np.log(max(count, 2))))
    budget = max(256, count // SAMPLES_A_CONTROL_POINT) if max_control_points is None else max_control_points
    result = fit(
        source, tolerance=rungs[-1], robust=robust, max_control_points=budget, max_seconds=max_seconds, **options
    )
    return _study(result, rungs, request, extended=wanted is None)


def _request(source: Any, robust: bool, options: dict[str, Any]) -> Request:
    """The samples that count, and their range."""
    return read_request(
        source,
        tolerance=None,
        relative_tolerance=None,
        noise=None,
        weights=options.get("weights"),
        robust=robust,
        as_surface=options.get("as_surface", False),
    )


def _sigma(request: Request) -> float:
    """The estimated standard deviation of the noise."""
    return 0.0 if request.noise is None else request.noise.sigma


def _unit_of(source: Any) -> str | None:
    return source.frame.unit if isinstance(source, Samples) else source.unit


def _checked(tolerances: Sequence[Length], unit: str | None) -> list[float]:
    """Positive lengths in the data's unit, loosest first."""
    values = sorted({parse_length(tolerance, unit) for tolerance in tolerances}, reverse=True)
    if not values or values[-1] <= 0:
        raise InputError(f"a tolerance study needs tolerances above zero; received {list(tolerances)!r}")
    return values


def _ladder(spread: float, noise: float) -> list[float]:
    """Round tolerances (1, 2, 5, 10, ...) from the range to a thousandth of it, or to the noise; loosest first."""
    low = min(max(TIGHTEST * spread, noise), spread / 4)
    decades = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(spread))) + 1)
    rungs = [float(f"{digit}e{decade}") for decade in decades for digit in ROUND_NUMBERS]
    return [rung for rung in reversed(rungs) if low * (1 - 1e-9) <= rung <= spread]


def _study(result: FitResult, rungs: list[float], request: Request, *, extended: bool) -> ToleranceStudy:
    """Read the tolerances off the history."""
    met = [rung for rung in rungs if _first_within(result, rung) is not None]
    if extended:
        met = _enough(result, met)
    if not met:
        best = min(step.max_error for step in result.history)
        raise InputError(
            f"none of the tolerances was met: the smallest error reached is {best:.4g} with {result.control_points} "
            "control points; allow more (max_control_points, max_seconds) or give looser tolerances"
        )
    steps = [_first_within(result, rung) for rung in met]
    counts = tuple(step.control_points for step in steps if step)
    return ToleranceStudy(
        tolerances=tuple(met),
        control_points=counts,
        max_errors=tuple(step.max_error for step in steps if step),
        suggested=_suggested(result, met, _sigma(request)),
        unit=result.unit,
        range=result.range,
        noise=_sigma(request),
        warnings=(*request.warnings, *_unreached(result, rungs, met)),
    )


def _unreached(result: FitResult, rungs: list[float], met: list[float]) -> list[str]:
    """A sentence about the tolerances that were not met, if any."""
    left = [rung for rung in rungs if rung not in met]
    if not left:
        return []
    names = ", ".join(f"{rung:.4g}" for rung in left) + (f" {result.unit}" if result.unit else "")
    reason = f"the trial fit ended first ({result.stop}: {result.stop.message})"
    return [f"not met and left out: the tolerances {names}; {reason}"]


def _first_within(result: FitResult, tolerance: float) -> Any:
    """The first step whose largest error is within the tolerance, or `None`."""
    return next((step for step in result.history if step.max_error <= tolerance), None)


def _enough(result: FitResult, met: list[float]) -> list[float]:
    """Tolerances of at most a tenth of the range, or looser ones too where these are too few."""
    first = sum(rung > LOOSEST * result.range for rung in met)
    while first > 0 and len(_worthwhile(result, met[first:])) < FEWEST_RUNGS:
        first -= 1
    if len(_worthwhile(result, met)) < FEWEST_RUNGS:
        return sorted({*met, *_between(result)}, reverse=True)
    return met[first:]


def _worthwhile(result: FitResult, tolerances: list[float]) -> dict[int, float]:
    """The tightest of the tolerances for each number of control points."""
    steps = [(_first_within(result, tolerance), tolerance) for tolerance in tolerances]
    return {step.control_points: tolerance for step, tolerance in steps if step is not None}


def _between(result: FitResult) -> list[float]:
    """Tolerances from the start lattice's error to the smallest one reached, rounded up to two digits."""
    first, best = result.history[0].max_error, min(step.max_error for step in result.history)
    if best <= 0:
        return []
    return [float(f"{error * 1.05:.1e}") for error in np.geomspace(first, best, FEWEST_RUNGS)]


def _suggested(result: FitResult, tolerances: list[float], noise: float) -> tuple[SuggestedTolerance, ...]:
    """The loosest, the middle and the tightest that are worth their control points, each with its reason."""
    table = list(_worthwhile(result, tolerances).items())
    chosen = {"coarse": table[0], "medium": table[(len(table) - 1) // 2], "fine": table[-1]}
    sense = {
        "coarse": "the smallest model",
        "medium": "a compromise",
        "fine": _why_no_finer(table[-1][1], result, noise),
    }
    return tuple(
        SuggestedTolerance(name, tolerance, count, f"{_percent(tolerance / result.range)} of the range: {sense[name]}")
        for name, (count, tolerance) in chosen.items()
    )


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %" if share < 0.995 else f"{100 * share:.0f} %"


def _why_no_finer(tolerance: float, result: FitResult, noise: float) -> str:
    """What keeps the finest tolerance from being finer still."""
    if not result.converged:
        return "the tightest that was reached within the budget"
    if noise > 0 and tolerance < 10 * noise:
        return f"{tolerance / noise:.2g} standard deviations of the noise, which a tighter one would follow"
    return "fine detail, well above the noise"
