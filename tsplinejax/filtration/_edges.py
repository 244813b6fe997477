"""The filter that keeps edges: a T-mesh refined around features, and on it a plate that may bend for nothing there."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from ..data import HeightMap
from ..fitting import Problem, StopReason, pose_fit, scaled_lattice, surface_of
from ..fitting._adaptive import State, advance, residuals_of, resumed, revived, terminate, with_coefficients
from ..fitting._run import Run, run
from ..fitting._stopwatch import Stopwatch
from ..surface import TSpline
from ._features import FeatureCriterion, Features, cumulated, plain_deviation
from ._plate import Plate

_CLEARER = 0.95  # of a deviation, below which a new one is worth another refinement
_AGAIN = 4  # refinements at most where residuals of the plate stand out together
_SPACINGS = 4  # elements of the start lattice to a cut-off


@dataclass(frozen=True, eq=False)
class EdgesKept:
    """A surface, its residuals at the valid pixels, which of them are outliers, and the account."""

    surface: TSpline
    residuals: Float[np.ndarray, " m"]
    outliers: Bool[np.ndarray, " m"]
    edge_share: float
    stop: StopReason


def default_cutoff(height_map: HeightMap) -> float:
    """What is taken for smooth away from edges where no cut-off is asked for: a quarter of the shorter side."""
    return min(height_map.extent) / 4


def keep_edges(
    height_map: HeightMap,
    features: Features,
    tolerance: float,
    cutoff: float,
    finest_spacing: float | None,
    options: dict[str, Any],
) -> EdgesKept:
    """Refine around features, and smooth everything but edges."""
    problem, outcome = _refined(height_map, features, tolerance, cutoff, finest_spacing, options)
    state = outcome.best
    if not state.tally.counts.any():  # an earlier step was the best, and its device rows moved on
        state = resumed(problem, state)
    plain = state.history[-1].max_error
    plate = Plate(problem, cutoff / float(np.sqrt(np.prod(height_map.extent))))
    smooth, weights = plate.smoothed(state)
    for _ in range(_AGAIN):
        smooth = replace(smooth, excess=plate.criterion.excess_together(smooth.mesh, smooth.tally), stage=1.0)
        if terminate(problem, smooth) is not None:
            break
        smooth, weights = plate.smoothed(advance(problem, smooth))
    if smooth.history[-1].max_error > max(tolerance, plain):
        smooth = with_coefficients(problem, revived(problem, state), state.coefficients, Stopwatch(state.history[-1]))
        weights = np.zeros(len(smooth.mesh.slots))
    areas = np.prod(plate.sides(smooth), axis=1)
    return EdgesKept(
        surface_of(problem, smooth),
        _residuals(problem, smooth),
        problem.request.outliers,
        float(areas @ (weights < 0.5) / areas.sum()),
        _stop(outcome, smooth.history[-1].max_error <= tolerance),
    )


def _refined(
    height_map: HeightMap,
    features: Features,
    tolerance: float,
    cutoff: float,
    finest_spacing: float | None,
    options: dict[str, Any],
) -> tuple[Problem, Run]:
    """A fit that resolves the features; again, where blurred edges had hidden what stands out."""
    problem = _problem(height_map, features, tolerance, cutoff, finest_spacing, options)
    outcome = run(problem)
    if features.at.any():
        plain = features.plain[height_map.valid] & ~problem.request.outliers
        deviation = plain_deviation(_residuals(problem, outcome.best)[plain], tolerance)
        if deviation < _CLEARER * features.deviation:
            criterion = replace(problem.criterion, deviation=deviation / problem.scaling.factor)  # type: ignore[call-arg]
            problem = replace(problem, criterion=criterion)
            outcome = run(problem)
    return problem, outcome


def _residuals(problem: Problem, state: State) -> Float[np.ndarray, " m"]:
    """Residuals of the samples, in the map's unit."""
    return residuals_of(problem, state).astype(np.float64)[:, 0] * problem.scaling.factor


def _problem(
    height_map: HeightMap,
    features: Features,
    tolerance: float,
    cutoff: float,
    finest_spacing: float | None,
    options: dict[str, Any],
) -> Problem:
    """A fit whose criterion resolves the features."""
    frame = height_map.frame
    shorter, least = min(frame.extent), finest_spacing or 0.0
    count = int(np.ceil(shorter * _SPACINGS / cutoff - 1e-9))
    if finest_spacing is not None:
        count = min(count, int(shorter / finest_spacing + 1e-9))
    count = max(1, min(count, min(height_map.shape) - 3))
    most = options.get("max_control_points") or np.inf
    while count > 1 and np.prod(np.add(scaled_lattice(frame, count), 3)) > most:
        count -= 1
    lattice = scaled_lattice(frame, count)
    problem = pose_fit(height_map, tolerance=tolerance, lattice=lattice, **options)
    factor = problem.scaling.factor
    criterion = FeatureCriterion(
        tolerance / factor,
        features.deviation / factor,
        cumulated(features.at),
        (least / frame.extent[0], least / frame.extent[1]),
    )
    return replace(problem, criterion=criterion)


def _stop(outcome: Run, met: bool) -> StopReason:
    """Why refinement stopped; elements that may not be smaller do not ask for it."""
    if met:
        return StopReason.TOLERANCE
    return StopReason.FINEST if outcome.stop is StopReason.TOLERANCE else outcome.stop
