"""What a number of samples is worth: the error of reconstructions, by strategy and size (Fig. 10c)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from .._errors import InputError
from ..data import Samples
from ._allocation import in_rows
from ._names import STRATEGIES, strategy_of
from ._reconstruct import reconstruct
from ._sample import SampleSet, checked_size, drawn, site_of
from ._site import Site
from ._strategies import AbstractStrategy

SAMPLES_A_CONTROL_POINT = (1.2, 2.0, 3.0, 4.0)
_CHECKED = 1 << 16


@dataclass(frozen=True, eq=False, repr=False)
class SamplingStudy:
    """Reconstruction errors by strategy and size; lengths are in `unit`.

    **Attributes:**

    - `strategies`: k names.
    - `sizes`: j numbers of samples, ascending.
    - `rms_errors`, `max_errors`: (k, j), over the whole surface.
    - `control_points`: of the space.
    - `range`: of the true surface: max - min of the heights, the diagonal of a bounding box for points in space.
    - `unit`: of the errors, or `None`.

    `plot.plot_sampling_study` draws it.
    """

    strategies: tuple[str, ...]
    sizes: tuple[int, ...]
    rms_errors: Float[np.ndarray, "k j"]
    max_errors: Float[np.ndarray, "k j"]
    control_points: int
    range: float
    unit: str | None

    def __repr__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        best = ", ".join(
            f"{size}: {self.strategies[row]} ({self.rms_errors[row, column]:.3g}{unit})"
            for column, (size, row) in enumerate(zip(self.sizes, self.rms_errors.argmin(axis=0), strict=True))
        )
        return f"SamplingStudy({self.control_points} control points, best rms error by size: {best})"


def sampling_study(
    data: Any,
    strategies: Sequence[AbstractStrategy | str] = tuple(STRATEGIES),
    sizes: Sequence[int] | None = None,
    *,
    model: Any = None,
    smoothing: float | Literal["auto"] = "auto",
    parameters: Any = "planar",
    rng: int = 0,
) -> SamplingStudy:
    """Tell how well a surface is recovered from samples by several strategies, at several sizes.

    **Arguments:**

    - `data`, `model`, `parameters`: as for [`sample`][tsplinejax.sample]. A T-spline is the truth itself, judged at
      65 536 evenly spread places; of measured data every valid sample is.
    - `strategies`: names or strategies; by default all.
    - `sizes`: numbers of samples; by default 1.2, 2, 3 and 4 for each control point.
    - `smoothing`: as for [`reconstruct`][tsplinejax.reconstruct].
    - `rng`: a seed; every strategy and size begins with it.

    **Returns:** a [`SamplingStudy`][tsplinejax.SamplingStudy].

    **Raises:** `InputError` as for `sample` and `reconstruct`.

    >>> from tsplinejax import b_lattice, make_surface, spline_space
    >>> wavy = make_surface(spline_space(b_lattice(6, 6)), np.random.default_rng(0).random(81))
    >>> study = sampling_study(wavy, ["greville", "random"], [100, 200])
    >>> bool((study.rms_errors[0] < 1e-12).all())
    True
    """
    chosen = [strategy_of(strategy) for strategy in strategies]
    if not chosen:
        raise InputError("a sampling study needs at least one strategy; received none")
    site, index = site_of(data, model, parameters)
    if sizes is None:
        sizes = [round(share * site.control_points) for share in SAMPLES_A_CONTROL_POINT]
    numbers = sorted({checked_size(site, chosen[0], size) for size in sizes})
    truth = true_samples(site)
    errors = np.empty((2, len(chosen), len(numbers)))
    for row, strategy in enumerate(chosen):
        for column, size in enumerate(numbers):
            samples = drawn(site, index, strategy, size, np.random.default_rng(rng))
            errors[:, row, column] = errors_of(samples, truth, smoothing)
    return SamplingStudy(
        strategies=tuple(_name(strategy) for strategy in chosen),
        sizes=tuple(numbers),
        rms_errors=errors[0],
        max_errors=errors[1],
        control_points=site.control_points,
        range=range_of(truth),
        unit=site.model.unit,
    )


def true_samples(site: Site) -> Samples:
    """What reconstructions are judged by: every measured sample, or evenly spread places of the model."""
    if site.candidates is not None:
        return site.candidates
    places = in_rows(np.array([_CHECKED]), np.array([site.sides[1] / site.sides[0]]))[1]
    return Samples(places, site.values(places), None, site.model.frame)


def range_of(truth: Samples) -> float:
    """Norm of the largest minus the smallest value of each component."""
    low, high = truth.values.min(axis=0), truth.values.max(axis=0)
    return float(np.linalg.norm(high.astype(np.float64) - low))


def errors_of(samples: SampleSet, truth: Samples, smoothing: float | Literal["auto"] = "auto") -> tuple[float, float]:
    """Root-mean-square and largest distance of what is reconstructed from samples to the true values."""
    surface = reconstruct(samples, smoothing=smoothing).surface
    reached = np.asarray(surface(truth.parameters), np.float64).reshape(truth.values.shape)
    errors = np.linalg.norm(truth.values - reached, axis=1)
    return float(np.sqrt(np.mean(errors**2))), float(errors.max())


def _name(strategy: AbstractStrategy) -> str:
    """The name of a strategy, or how it is written."""
    return next((name for name, known in STRATEGIES.items() if known == strategy), repr(strategy))
