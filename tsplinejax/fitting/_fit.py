"""`fit`: from measured data to a T-spline, the adaptive loop with its options."""

import os
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import ArrayLike
from numpy.typing import DTypeLike

from .._errors import InputError
from ..data import StoredMap, is_stored
from ..mesh import AbstractRefinement, AnalysisSuitable, Direction
from ..space import resolve_dtype
from ._criteria import AbstractCriterion, NoiseCriterion, ToleranceCriterion
from ._energy import default_smoothing
from ._engines import AbstractEngine
from ._finish import finished
from ._options import Length, Request, read_request, read_stored_request
from ._pages import most_control_points
from ._problem import Budget, Problem, pose, start_lattice
from ._result import FitResult
from ._solve import AbstractSolver, LocalSolver
from ._source import StoredSource


def fit(
    data: Any,
    *,
    tolerance: Length | None = None,
    relative_tolerance: float | None = None,
    noise: Length | None = None,
    refinement: AbstractRefinement | None = None,
    solver: AbstractSolver | None = None,
    lattice: tuple[int, int] | Literal["auto"] | None = None,
    first_cut: Direction = "s",
    smoothing: float | Literal["auto"] = "auto",
    weights: ArrayLike | None = None,
    robust: bool = False,
    max_steps: int | None = None,
    max_control_points: int | None = None,
    max_seconds: float | None = None,
    dtype: DTypeLike | None = None,
    progress: bool = False,
    as_surface: bool = False,
    max_memory: float = 4e9,
    engine: AbstractEngine | None = None,
    checkpoint: str | os.PathLike | None = None,
) -> FitResult:
    """Fit a T-spline to measured data, refining until the criterion is met.

    **Arguments:**

    - `data`: a `HeightMap`, a `PointCloud`, `Samples`, or plain arrays (see `as_data`). A cloud is fitted as z over
      (x, y). A `StoredMap`, a memory map, a zarr or a dask array stays where it is and is read page by page.
    - `tolerance`: largest error allowed at any sample, in the data's unit, or with one: `"5nm"`.
    - `relative_tolerance`: the same as a share of the range (max - min) of the samples that are not outliers.
    - `noise`: stop where residuals are no longer significantly above the noise: `"auto"` estimates it, a number is its
      standard deviation. At most one of these three; `"auto"` noise when none is given.
    - `refinement`: `AnalysisSuitable()` (default) or `Dyadic()`, the paper's.
    - `solver`: `LocalSolver()` (default) or `GlobalSolver()`; `Dyadic()` with `LocalSolver(ring=0)` is the paper's
      algorithm.
    - `lattice`: start lattice (M, N), M elements along x; by default near-square elements, eight along the shorter
      side; `"auto"` tries a few and both first cuts, and keeps what needs fewest control points (takes several times
      longer).
    - `first_cut`: direction in which elements of even level are cut, `"s"` (along x) or `"t"`.
    - `smoothing`: weight λ of the bending energy; `"auto"` is a trace that only fills gaps, and for a fit to noise is
      chosen by generalised cross validation.
    - `weights`: one a sample (or a map), not negative.
    - `robust`: set isolated spikes aside first (`find_outliers`).
    - `max_steps`, `max_control_points` (default: half the samples), `max_seconds`: budgets.
    - `dtype`: `"float32"` to fit in single precision; by default the data's.
    - `progress`: show a progress bar on standard error.
    - `as_surface`: fit a cloud's points in space (x, y, z) over planar parameters, not z alone.
    - `max_memory`: bytes that the fit of a stored map may take; it sets the size of a page and the largest number of
      control points. Residuals of a stored map are not kept, and weights and `robust` need data in memory.
    - `engine`: who works on the pages of a stored map: `DaskEngine(client)` or `DevicesEngine()`; by default this
      process, page after page.
    - `checkpoint`: a file that keeps the last step. Where it exists the fit goes on from it, to the same result as
      without the interruption. Delete it once the result is saved. Budgets count from the fit's first start.

    **Returns:** a [`FitResult`][tsplinejax.FitResult]. That a budget ran out is said there, not raised; interrupting
    (Ctrl-C) returns the best step so far.

    **Raises:** `InputError` for bad data or options, and for a checkpoint that is damaged or of another fit.

    >>> import tsplinejax as tsj
    >>> x, y = np.meshgrid(np.linspace(0, 1, 60), np.linspace(0, 1, 50))
    >>> result = tsj.fit(np.exp(-50 * ((x - 0.5) ** 2 + (y - 0.4) ** 2)), tolerance=1e-3)
    >>> result.converged, result.max_error <= 1e-3
    (True, True)
    """
    started = time.perf_counter()
    path = _checked_checkpoint(checkpoint, lattice)
    problem = pose_fit(
        data,
        tolerance=tolerance,
        relative_tolerance=relative_tolerance,
        noise=noise,
        refinement=refinement,
        solver=solver,
        lattice=lattice,
        first_cut=first_cut,
        smoothing=smoothing,
        weights=weights,
        robust=robust,
        max_steps=max_steps,
        max_control_points=max_control_points,
        max_seconds=max_seconds,
        dtype=dtype,
        as_surface=as_surface,
        max_memory=max_memory,
        engine=engine,
    )
    return finished(problem, data, started, lattice=lattice, smoothing=smoothing, progress=progress, path=path)


def pose_fit(
    data: Any,
    *,
    tolerance: Length | None = None,
    relative_tolerance: float | None = None,
    noise: Length | None = None,
    refinement: AbstractRefinement | None = None,
    solver: AbstractSolver | None = None,
    lattice: tuple[int, int] | Literal["auto"] | None = None,
    first_cut: Direction = "s",
    smoothing: float | Literal["auto"] = "auto",
    weights: ArrayLike | None = None,
    robust: bool = False,
    max_steps: int | None = None,
    max_control_points: int | None = None,
    max_seconds: float | None = None,
    dtype: DTypeLike | None = None,
    as_surface: bool = False,
    max_memory: float = 4e9,
    engine: AbstractEngine | None = None,
) -> Problem:
    """Make everything ready for a fit that is driven by hand, with `begin`, `advance` and `terminate`.

    Data and options are those of [`fit`][tsplinejax.fit]; a lattice of `"auto"` is the default one here.

    **Raises:** `InputError` for bad data or options.

    >>> from tsplinejax.fitting import advance, begin, surface_of, terminate
    >>> problem = pose_fit(np.add.outer(np.arange(30.0) ** 2, np.arange(40.0)), tolerance=1.0)
    >>> state = begin(problem)
    >>> while terminate(problem, state) is None:
    ...     state = advance(problem, state)
    >>> surface_of(problem, state).control_points.shape
    (120,)
    """
    criterion: dict[str, Any] = {
        "tolerance": tolerance,
        "relative_tolerance": relative_tolerance,
        "noise": noise,
    }
    if is_stored(data):
        data = StoredMap(data)
    if isinstance(data, StoredMap):
        if weights is not None or robust or as_surface:
            raise InputError(
                "weights, robust=True and as_surface=True need data in memory; this map is stored elsewhere; leave "
                "them out, or read it: HeightMap(numpy.asarray(data))"
            )
        memory, engine = _checked_memory(max_memory), _checked_engine(engine)
        request = read_stored_request(data, **criterion, max_memory=memory, engine=engine)
    elif engine is not None:
        raise InputError(
            "an engine works on the pages of a stored map; data in memory are fitted in this process; leave engine "
            "out, or pass a StoredMap"
        )
    else:
        request = read_request(data, **criterion, weights=weights, robust=robust, as_surface=as_surface)
    budget = _checked_budget(max_steps, max_control_points, max_seconds)
    refinement, solver = refinement or AnalysisSuitable(), solver or LocalSolver()
    if not isinstance(refinement, AbstractRefinement) or not isinstance(solver, AbstractSolver):
        raise InputError(
            "a refinement is AnalysisSuitable() or Dyadic(), a solver GlobalSolver() or LocalSolver(); "
            f"received {refinement!r} and {solver!r}"
        )
    return prepare(request, refinement, solver, budget, smoothing, dtype, first_cut, lattice)


def prepare(
    request: Request,
    refinement: AbstractRefinement,
    solver: AbstractSolver,
    budget: Budget,
    smoothing: float | str,
    dtype: DTypeLike | None,
    first_cut: Direction,
    lattice: tuple[int, int] | str | None,
) -> Problem:
    """Choose precision, start lattice, criterion and λ, and put the samples on the device."""
    source = request.source
    resolved = resolve_dtype(source.dtype if dtype is None else dtype)
    given = None if isinstance(lattice, str) and lattice == "auto" else lattice
    start = start_lattice(source.frame, source.n_samples, given, first_cut, budget.max_control_points)
    if budget.max_control_points is None:
        share = 5 if request.tolerance is None else 2
        most = max(2 * start.n_anchors, source.n_samples // share)
        if isinstance(source, StoredSource):
            most = min(most, most_control_points(source.max_memory))
        budget = replace(budget, max_control_points=most)

    def criterion(factor: float) -> AbstractCriterion:
        if request.tolerance is not None:
            return ToleranceCriterion(request.tolerance / factor)
        assert request.noise is not None
        return NoiseCriterion(request.noise.correlated_samples)

    return pose(
        request,
        start=start,
        criterion=criterion,
        smoothing=_smoothing_weight(smoothing, source.n_samples, refinement),
        refinement=refinement,
        solver=solver,
        budget=budget,
        dtype=resolved,
    )


def _smoothing_weight(smoothing: float | str, n_samples: int, refinement: AbstractRefinement) -> float:
    """λ as a number; automatic smoothing starts from a trace that only fills gaps (none on rational surfaces)."""
    if isinstance(smoothing, str):
        if smoothing != "auto":
            raise InputError(f"smoothing is 'auto' or a number λ of at least zero; received {smoothing!r}")
        return default_smoothing(n_samples) if isinstance(refinement, AnalysisSuitable) else 0.0
    weight = float(smoothing)
    if not np.isfinite(weight) or weight < 0:
        raise InputError(f"smoothing λ is finite and at least zero; received {smoothing!r}; try 'auto'")
    return weight


def _checked_budget(max_steps: int | None, max_control_points: int | None, max_seconds: float | None) -> Budget:
    """Budgets above zero."""
    named = {"max_steps": max_steps, "max_control_points": max_control_points, "max_seconds": max_seconds}
    for name, value in named.items():
        if value is not None and (not np.isfinite(value) or value < (0 if name == "max_steps" else 1e-9)):
            raise InputError(f"{name} is a positive number; received {value!r}; leave it out for no limit")
    return Budget(max_steps, max_control_points, max_seconds)


def _checked_memory(max_memory: float) -> float:
    """A budget that leaves room for a page and a mesh."""
    if not np.isfinite(max_memory) or max_memory < 2e8:
        raise InputError(f"max_memory is a number of bytes, at least 2e8; received {max_memory!r}; try 4e9")
    return float(max_memory)


def _checked_engine(engine: AbstractEngine | None) -> AbstractEngine | None:
    """An engine, or none."""
    if engine is not None and not isinstance(engine, AbstractEngine):
        raise InputError(f"an engine is DaskEngine(client) or DevicesEngine(); received {type(engine).__name__}")
    return engine


def _checked_checkpoint(checkpoint: str | os.PathLike | None, lattice: object) -> Path | None:
    """The path of a checkpoint that can be written, for a fit that is a single run."""
    if checkpoint is None:
        return None
    path = Path(checkpoint)
    if isinstance(lattice, str) and lattice == "auto":
        raise InputError(
            "a checkpoint is of one run, but lattice='auto' makes several; give a lattice (M, N), or no checkpoint"
        )
    if path.is_dir() or not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
        raise InputError(f"a checkpoint is a file in a folder that exists and can be written to; received {path}")
    return path
