"""`fill_missing`: a map's holes filled by the mixture of fillers that its own hidden patches ask for."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from .._errors import InputError
from .._version import __version__
from ..data import HeightMap, as_data
from ..fitting import FitResult, fit
from ._blend import Calibration, blend_weights, calibrated, disagreement
from ._covariance import CovarianceFiller
from ._filled import Filled
from ._filler import AbstractFiller, Field
from ._holes import bounds_of, interior
from ._interpolate import interpolate
from ._patches import hidden_patches
from ._predict import predict
from ._spline import SplineFiller

#: Pixels and patches that are hidden to judge the fillers, in so many rounds: each hides but a small part of a map.
_HIDDEN, _PATCHES, _ROUNDS = 5000, 300, 4
#: Ratio of unevenness above which hidden patches do not stand for the holes.
_UNLIKE = 1.4


def default_fillers(*, edges: bool = False) -> tuple[AbstractFiller, ...]:
    """The fillers that are tried: the covariance of the map, counted in different ways, and splines, creased or smooth.

    With `edges` those that hardly swing.

    >>> [filler.name for filler in default_fillers()][:2]
    ['plate with creases, λ = 0.01', 'covariance of slopes']
    """
    creased, lay = SplineFiller(2, 1e-2, creases=True), CovarianceFiller(1)
    if edges:
        return creased, lay, SplineFiller(1, 1e-2, creases=True), SplineFiller(1, 1e-3)
    return (
        creased,
        lay,
        CovarianceFiller(1, 9, nearby=24),
        CovarianceFiller(2, 6, nearby=24),
        CovarianceFiller(3, 6),
        SplineFiller(2, 1.0),
        SplineFiller(3, 1e-3),
    )


def fill_missing(
    data: Any,
    *,
    exact: bool = False,
    edges: bool = False,
    border: bool = False,
    smooth_all: bool = False,
    tolerance: float | str | None = None,
    relative_tolerance: float | None = None,
    noise: float | str | None = None,
    fillers: Sequence[AbstractFiller] | None = None,
    rng: int | np.random.Generator = 0,
) -> Filled:
    """Fill the holes of a height map from what surrounds them.

    Patches of the shapes of its holes are hidden elsewhere on the map; the convex mixture of fillers that predicts them
    best fills the holes, and their errors say how uncertain the filled heights are. Measured pixels stay as they are.

    **Arguments:**

    - `data`: a `HeightMap`, a 2-D array, NaN where missing, or `(heights, dx, dy)`.
    - `exact`: also give the T-spline through every pixel, measured and filled, as `surface`.
    - `edges`: for structures with steps: only fillers that hardly swing, and no filled height beyond those at the
      rim of its hole.
    - `border`: fill holes that touch the map's border, too, where half of what would tell them is not there.
    - `smooth_all`: fit a T-spline to the complete map, as `surface`, and take every height from it.
    - `tolerance`, `relative_tolerance`, `noise`: where that fit ends, as for [`fit`][tsplinejax.fit].
    - `fillers`: others than `default_fillers()`.
    - `rng`: seed, or a generator, that draws the hidden patches.

    **Returns:** [`Filled`][tsplinejax.Filled].

    **Raises:** `InputError` for a point cloud, a map without a known height, and options that exclude each other.

    >>> x, y = np.meshgrid(np.linspace(0, 1, 60), np.linspace(0, 1, 50))
    >>> heights = np.sin(6 * x) * y
    >>> heights[20:26, 30:37] = np.nan
    >>> filled = fill_missing(heights)
    >>> filled.n_filled, bool(filled.map.valid.all())
    (42, True)
    """
    started = time.perf_counter()
    height_map = as_data(data)
    criterion = {"tolerance": tolerance, "relative_tolerance": relative_tolerance, "noise": noise}
    _check(height_map, exact, smooth_all, criterion)
    assert isinstance(height_map, HeightMap)
    missing = ~height_map.valid
    wanted = missing if border else interior(missing)
    chosen = tuple(fillers) if fillers is not None else default_fillers(edges=edges)
    task = _Task(height_map.heights.astype(np.float64), _sides(height_map.spacing), edges, chosen)
    verdict = _judged(task, wanted, np.random.default_rng(rng))
    # A surface through every pixel needs all of them, also those that the map shall not have.
    heights, spread = _blended(task, verdict, missing if exact or smooth_all else wanted)
    whole = height_map.with_heights(heights.astype(height_map.heights.dtype))
    surface, result = None, None
    if exact:
        surface = interpolate(whole)
    elif smooth_all:
        result = fit(whole, **criterion)
        surface = result.surface
        x, y = (height_map.origin[k] + height_map.spacing[k] * np.arange(height_map.shape[1 - k]) for k in range(2))
        smooth = np.asarray(surface.at(*np.meshgrid(x, y), extrapolate=True))
        whole = whole.with_heights(smooth.astype(height_map.heights.dtype))
    left = missing & ~wanted
    return _result(height_map, whole, wanted, left, verdict, spread, surface, result, time.perf_counter() - started)


@dataclass(frozen=True, eq=False)
class _Task:
    """What stays the same while fillers are judged and used."""

    heights: Float[np.ndarray, "rows columns"]
    sides: tuple[float, float]
    edges: bool
    fillers: tuple[AbstractFiller, ...]

    def predicted(
        self, heights: Float[np.ndarray, "rows columns"], wanted: Bool[np.ndarray, "rows columns"], which: Any
    ) -> Float[np.ndarray, "fillers wanted"]:
        """What each of some fillers gives for the wanted pixels."""
        low, high = bounds_of(heights, wanted) if self.edges else (None, None)
        span = np.nanquantile(self.heights, [0.005, 0.995])
        scale = float(span[1] - span[0]) or float(np.ptp(self.heights[np.isfinite(self.heights)])) or 1.0
        field = Field(heights, self.sides, scale, low, high)
        return np.array([predict(self.fillers[k], field, wanted)[wanted] for k in which])


@dataclass(frozen=True, eq=False)
class _Verdict:
    """What the hidden patches say: weights, whether heights beyond all measured ones are errors, root mean square
    errors, the calibration of the uncertainty, and how many times as uneven as theirs the rims of the holes are.
    """

    names: tuple[str, ...]
    weights: Float[np.ndarray, " fillers"]
    used: Int[np.ndarray, " used"]
    bounded: bool
    alone: Float[np.ndarray, " fillers"]
    rms: float
    hidden: int
    calibration: Calibration | None
    unlike: float


def _judged(task: _Task, wanted: Bool[np.ndarray, "rows columns"], rng: np.random.Generator) -> _Verdict:
    """Hide patches, let every filler predict them, and compare."""
    names, count = tuple(filler.name for filler in task.fillers), len(task.fillers)
    parts, truths, places, limits, known = [], [], [], [], 0
    ratios: list[float] = []
    for _ in range(_ROUNDS if wanted.any() else 0):
        hidden, placed = hidden_patches(task.heights, wanted, rng, _HIDDEN - known, _PATCHES - len(ratios))
        if not hidden.any():
            break
        shown = np.where(hidden, np.nan, task.heights)
        parts.append(task.predicted(shown, hidden, range(count)))
        truths.append(task.heights[hidden])
        places.append(np.argwhere(hidden))
        limits.append(np.broadcast_to(_limits(shown)[:, None], (2, len(truths[-1]))))
        known += len(truths[-1])
        ratios += placed
        if known > 0.9 * _HIDDEN or len(ratios) > 0.9 * _PATCHES:
            break
    if not known:
        unknown = np.full(count, np.nan)
        return _Verdict(names, np.eye(count)[0], np.arange(1), False, unknown, float("nan"), 0, None, 1.0)
    predictions, truth = np.concatenate(parts, axis=1), np.concatenate(truths)
    weights = blend_weights(predictions - truth, np.concatenate(places))
    alone = np.sqrt(np.mean((predictions - truth) ** 2, axis=1))
    used = _compared(weights, alone)
    blended = weights @ predictions
    spread = disagreement(predictions[used], blended)
    clipped = np.clip(blended, *np.concatenate(limits, axis=1))
    bounded = bool(np.sum((clipped - truth) ** 2) < np.sum((blended - truth) ** 2))
    errors = (clipped if bounded else blended) - truth
    rms = float(np.sqrt(np.mean(errors**2)))
    unlike = float(np.sqrt(np.mean(np.square(ratios))))
    return _Verdict(names, weights, used, bounded, alone, rms, known, calibrated(spread, errors), unlike)


def _limits(heights: Float[np.ndarray, "rows columns"]) -> Float[np.ndarray, "2"]:
    """The lowest and the highest known height."""
    return np.array([np.nanmin(heights), np.nanmax(heights)])


def _compared(weights: Float[np.ndarray, " fillers"], alone: Float[np.ndarray, " fillers"]) -> Int[np.ndarray, " used"]:
    """The fillers of the mixture; one alone is joined by the next best, so that there is someone to disagree."""
    used = weights > 0
    if used.sum() == 1 and len(weights) > 1:
        used[np.argmin(np.where(used, np.inf, alone))] = True
    return np.flatnonzero(used)


def _blended(
    task: _Task, verdict: "_Verdict", wanted: Bool[np.ndarray, "rows columns"]
) -> tuple[Float[np.ndarray, "rows columns"], Float[np.ndarray, "rows columns"]]:
    """The heights, filled by the mixture, and how much its fillers disagree."""
    heights, spread = task.heights.copy(), np.full(task.heights.shape, np.nan)
    if wanted.any():
        predictions = task.predicted(task.heights, wanted, verdict.used)
        blended = verdict.weights[verdict.used] @ predictions
        spread[wanted] = disagreement(predictions, blended)
        heights[wanted] = np.clip(blended, *_limits(task.heights)) if verdict.bounded else blended
    return heights, spread


def _result(
    measured: HeightMap,
    whole: HeightMap,
    wanted: Bool[np.ndarray, "rows columns"],
    left: Bool[np.ndarray, "rows columns"],
    verdict: _Verdict,
    spread: Float[np.ndarray, "rows columns"],
    surface: Any,
    fitted: FitResult | None,
    seconds: float,
) -> Filled:
    """The frozen account."""
    count = int(wanted.sum())
    used = {name: float(weight) for name, weight in zip(verdict.names, verdict.weights, strict=True) if weight > 0}
    mixture = ", ".join(f"{weight:.2g} {name}" for name, weight in used.items())
    operation = f"{count} missing pixels filled ({mixture})"
    provenance = {
        **measured.provenance,
        "operations": [*measured.provenance.get("operations", ()), *([operation] if count else [])],
    }
    heights = np.where(left, np.nan, whole.heights)
    marked = wanted if measured.filled is None else wanted | measured.filled
    filled_map = replace(measured, heights=heights, filled=marked, provenance=provenance)
    uncertainty = np.full(heights.shape, np.nan)
    if verdict.calibration is not None:
        uncertainty[wanted] = verdict.calibration(spread[wanted])
    errors = (heights.astype(np.float64) - measured.heights)[measured.valid]
    return Filled(
        map=filled_map,
        n_filled=count,
        uncertainty=uncertainty,
        surface=surface,
        left=left,
        weights=used if count else {},
        validated_rms=verdict.rms,
        hidden=verdict.hidden,
        hidden_rms=dict(zip(verdict.names, verdict.alone.tolist(), strict=True)) if verdict.hidden else {},
        max_error=float(np.abs(errors).max()),
        rms_error=float(np.sqrt(np.mean(errors**2))),
        tolerance=None if fitted is None else fitted.tolerance,
        stop=None if fitted is None else str(fitted.stop),
        converged=fitted is None or fitted.converged,
        range=measured.range,
        unit=measured.unit,
        seconds=seconds,
        warnings=(*_warnings(wanted, left, verdict), *(() if fitted is None else fitted.warnings)),
        provenance={"software": f"tsplinejax {__version__}", "input": dict(measured.provenance)},
    )


def _warnings(wanted: np.ndarray, left: np.ndarray, verdict: _Verdict) -> list[str]:
    """What the user should know."""
    warnings = []
    if left.any():
        warnings.append(
            f"{int(left.sum())} missing pixels touch the map's border through their holes and were left; border=True "
            "(--border) fills them, too"
        )
    if wanted.any() and not verdict.hidden:
        warnings.append(
            "no patch of the shape of the holes fits where heights are known: the filler could not be chosen nor its "
            "uncertainty be judged"
        )
    if verdict.unlike > _UNLIKE:
        warnings.append(
            f"the rims of the holes are {verdict.unlike:.2g} times as uneven as those of the patches that could be "
            "hidden: expect larger errors than validated"
        )
    return warnings


def _check(height_map: Any, exact: bool, smooth_all: bool, criterion: dict[str, Any]) -> None:
    """Data and options that go together."""
    if not isinstance(height_map, HeightMap):
        raise InputError(
            "holes are filled in height maps, but this is a point cloud; read it with as_='map' (--as map)"
        )
    if not height_map.valid.any():
        raise InputError("every height of the map is missing (NaN): there is nothing to fill from")
    if exact and smooth_all:
        raise InputError("exact=True keeps every measured pixel, smooth_all=True none; give one of the two")
    given = [name for name, value in criterion.items() if value is not None]
    if given and not smooth_all:
        raise InputError(f"{given[0]} ends the fit of smooth_all=True (--smooth-all); give both, or neither")


def _sides(spacing: tuple[float, float]) -> tuple[float, float]:
    """Sides of a pixel in units of the root of its area."""
    dx, dy = spacing
    return float(np.sqrt(dx / dy)), float(np.sqrt(dy / dx))
