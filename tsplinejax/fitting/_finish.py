"""From a problem that is posed to the result of its fit: the run, and what is told of it."""

import time
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Array

from .._version import __version__
from ..mesh import require_forest
from ..space import spline_space
from ..surface import TSpline, make_surface
from ._adaptive import State, residuals_of
from ._checkpoint import Checkpoint
from ._discretisation import Discretisation
from ._problem import Problem
from ._result import AtSamples, FitResult, StopReason
from ._run import Run, run, run_best_lattice
from ._smoothing import smooth_automatically
from ._source import HeldSource


def finished(
    problem: Problem,
    data: Any,
    started: float,
    *,
    lattice: tuple[int, int] | str | None = None,
    smoothing: float | str = "auto",
    progress: bool = False,
    path: Path | None = None,
) -> FitResult:
    """The fit of a problem that was made of these data since `started`."""
    keeper = Checkpoint(path, problem)
    if lattice == "auto":
        problem, outcome = run_best_lattice(problem, progress=progress)
    else:
        outcome = run(problem, progress=progress, checkpoint=keeper)
    held = isinstance(problem.source, HeldSource)
    if isinstance(smoothing, str) and outcome.stop is StopReason.NOISE and held:
        problem, outcome = smooth_automatically(problem, outcome)
    source = dict(getattr(data, "provenance", None) or {})
    return _result(problem, outcome, started - keeper.seconds, _provenance(problem, outcome.stop, source))


def surface_of(problem: Problem, state: State) -> TSpline:
    """The surface of a state, in the data's unit and place.

    >>> from tsplinejax.fitting import begin, pose_fit
    >>> problem = pose_fit(np.ones((20, 20)), tolerance=1.0)
    >>> surface_of(problem, begin(problem)).is_height_map
    True
    """
    scaling, n = problem.scaling, state.mesh.tmesh.n_anchors
    points = np.asarray(state.coefficients, np.float64)[:n] * scaling.factor + scaling.offset
    height_map = problem.dimension == 1
    mesh, along = state.mesh, None
    if state.alive:
        along = (_in_order(state.store.along_s, mesh), _in_order(state.store.along_t, mesh))
    space = spline_space(
        mesh.tmesh,
        dtype=problem.dtype,
        rational=problem.rational,
        elements=mesh.elements,
        along=along,
        capacity=mesh.capacity,
    )
    return make_surface(space, points[:, 0] if height_map else points, problem.source.frame)


def _in_order(by_slot: Array, mesh: Discretisation) -> np.ndarray:
    """Device rows in the order of the Bézier elements, padded with zeros to the capacity."""
    rows = np.zeros(by_slot.shape, by_slot.dtype)
    np.take(np.asarray(by_slot), mesh.slots, axis=0, out=rows[: len(mesh.slots)], mode="clip")
    return rows


def _provenance(problem: Problem, stop: StopReason, source: dict[str, Any]) -> dict[str, Any]:
    """Software, input, options and outcome, as they go into the model's file."""
    request, forest = problem.request, require_forest(problem.start)
    options = {
        "tolerance": request.tolerance,
        "noise": None if request.noise is None else request.noise.sigma,
        "refinement": repr(problem.refinement),
        "solver": repr(problem.solver),
        "lattice": list(forest.lattice),
        "first_cut": forest.first_cut,
        "smoothing": problem.smoothing,
        "robust": request.robust,
        "dtype": str(problem.dtype),
    }
    return {"software": f"tsplinejax {__version__}", "input": source, "options": options, "stop": str(stop)}


def _result(problem: Problem, outcome: Run, began: float, provenance: dict[str, Any]) -> FitResult:
    """The frozen result, in the data's unit and order; the clock, which read `began`, stops when all of it is there."""
    request, source = problem.request, problem.source
    state, stop = outcome.best, outcome.stop
    entry = state.history[-1]
    kept, surface = _kept(problem, state), surface_of(problem, state)
    warnings = list(request.warnings)
    if stop not in (StopReason.TOLERANCE, StopReason.NOISE):
        x, y = _worst_place(problem, state, kept)
        warnings.append(
            f"stopped before the criterion was met ({stop}: {stop.message}); the largest error left is "
            f"{entry.max_error:.4g} at (x, y) = ({x:.4g}, {y:.4g})"
        )
    return FitResult(
        surface=surface,
        at_samples=kept,
        n_samples=source.n_samples,
        stop=stop,
        converged=stop in (StopReason.TOLERANCE, StopReason.NOISE),
        tolerance=request.tolerance,
        noise=None if request.noise is None else request.noise.sigma,
        max_error=entry.max_error,
        rms_error=entry.rms_error,
        snr_db=entry.snr_db,
        snr_db_centred=entry.snr_db_centred,
        range=request.range,
        unit=source.frame.unit,
        smoothing=problem.smoothing,
        control_points=state.mesh.tmesh.n_anchors,
        elements=state.mesh.tmesh.n_elements,
        seconds=time.perf_counter() - began,
        history=outcome.history,
        warnings=tuple(warnings),
        provenance=provenance,
    )


def _kept(problem: Problem, state: State) -> AtSamples | None:
    """Samples and residuals of data in memory."""
    if not isinstance(problem.source, HeldSource):
        return None
    residuals = residuals_of(problem, state).astype(np.float64) * problem.scaling.factor
    samples = problem.source.samples
    return AtSamples(samples, residuals if samples.dimension > 1 else residuals[:, 0], problem.source.outliers)


def _worst_place(problem: Problem, state: State, kept: AtSamples | None) -> tuple[float, float]:
    """Where the largest error is: at a sample, or in the middle of its element where residuals are not kept."""
    if kept is None:
        slot = int(np.argmax(state.tally.largest))
        box = state.mesh.elements.boxes[state.mesh.places_of(np.array([slot]))[0]]
        place = (box[:2] + box[2:]) / (2 * np.array(state.mesh.tmesh.extent))
    else:
        size = np.linalg.norm(kept.residuals.reshape(len(kept.residuals), -1), axis=1)
        place = kept.samples.parameters[int(np.argmax(np.where(kept.outliers, -1.0, size)))]
    x, y = problem.source.frame.xy_of(place[None])[0]
    return float(x), float(y)
