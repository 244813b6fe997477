"""`reconstruct`: a surface from few samples, over the space it is known to lie in."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from .._errors import InputError
from ..data import Frame, Samples
from ..space import SplineSpace
from ..surface import TSpline, make_surface
from ._adaptive import Adaptive
from ._regression import Regression, surface_of
from ._sample import SampleSet
from ._site import Site


@dataclass(frozen=True, eq=False, repr=False)
class Reconstruction:
    """A surface from samples, and how well they determine it; lengths are in `unit`.

    **Attributes:**

    - `surface`: the T-spline.
    - `n_samples`: how many samples there were.
    - `smoothing`: the weight λ of the bending energy; 0 is plain least squares.
    - `noise_gain`: rms of what noise of standard deviation 1 at the samples becomes on the surface.
    - `max_error`, `rms_error`: at the samples.
    - `warnings`: what the user should know, in sentences.
    """

    surface: TSpline
    n_samples: int
    smoothing: float
    noise_gain: float
    max_error: float
    rms_error: float
    unit: str | None
    warnings: tuple[str, ...]

    def __repr__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        return (
            f"Reconstruction({self.n_samples} samples, {self.surface.control_points.shape[0]} control points, "
            f"rms {self.rms_error:.4g}{unit} at the samples, noise gain {self.noise_gain:.3g}, "
            f"smoothing {self.smoothing:.3g})"
        )


def reconstruct(
    samples: Any, space: SplineSpace | TSpline | None = None, *, smoothing: float | Literal["auto"] = "auto"
) -> Reconstruction:
    """Recover a surface from samples over a known spline space, by least squares.

    **Arguments:**

    - `samples`: a `SampleSet`, `Samples`, or a pair of parameters (m, 2) and values (m,), (m, 1) or (m, 3).
    - `space`: the space; a T-spline (of the nominal surface, say) brings its frame along. A `SampleSet` knows its own.
    - `smoothing`: weight λ of the bending energy. `"auto"` is 0, plain least squares (for fewer samples than control
      points a trace, which meets the samples and bends least between them), where noise at the samples then becomes at
      most three times larger on the surface; else the λ of the least predicted error (generalised cross validation,
      times 1 + g² with the noise gain g).

    **Returns:** a [`Reconstruction`][tsplinejax.Reconstruction].

    **Raises:** `InputError` for samples that do not fit the space, and for those that do not determine the surface:
    with a λ of 0 too few or badly placed ones, with any other those on one line.

    >>> from tsplinejax import b_lattice, spline_space
    >>> places = np.random.default_rng(0).random((200, 2))
    >>> reconstruct((places, places[:, 0]), spline_space(b_lattice(4, 4))).max_error < 1e-10
    True
    """
    given, frame = _samples(samples)
    site = _site(samples, space, given, frame)
    values = given.values.astype(np.float64)
    middle = values.mean(axis=0)
    regression = Regression(site, given.parameters, values - middle)
    if isinstance(smoothing, str):
        if smoothing != "auto":
            raise InputError(f"smoothing is 'auto' or a number λ of at least zero; received {smoothing!r}")
        trial = regression.automatic()
    else:
        trial = regression.solved(_weight(smoothing))
    if trial is None:
        raise InputError(
            f"the {len(given)} samples do not determine the {site.control_points} control points with a smoothing of "
            f"{smoothing:g}; leave it at 'auto', take more samples, or sample by strategy 'greville'"
        )
    errors = np.linalg.norm(trial.residuals, axis=1)
    silent = not isinstance(smoothing, str) or (space is None and _few_by_design(samples))
    return Reconstruction(
        surface=surface_of(site, trial.points + middle),
        n_samples=len(given),
        smoothing=trial.smoothing,
        noise_gain=trial.noise_gain,
        max_error=float(errors.max()),
        rms_error=float(np.sqrt(np.mean(errors**2))),
        unit=site.model.unit,
        warnings=() if silent else _warnings(len(given), site.control_points, trial.smoothing),
    )


def _samples(samples: Any) -> tuple[Samples, Frame | None]:
    """Samples, and their frame where they have one."""
    given = getattr(samples, "samples", samples)
    if isinstance(given, Samples):
        if given.weights is not None:
            raise InputError("samples to reconstruct from weigh the same; leave the weights out, or use fit or lstsq")
        return given, given.frame
    if not isinstance(given, tuple | list) or len(given) != 2:
        raise InputError(
            "a surface is reconstructed from a SampleSet, Samples, or (parameters, values); received "
            f"{type(samples).__name__}"
        )
    return Samples(*given), None


def _site(samples: Any, space: SplineSpace | TSpline | None, given: Samples, frame: Frame | None) -> Site:
    """The space and the place of the surface."""
    if given.dimension not in (1, 3):
        raise InputError(f"values are heights (m, 1) or points in space (m, 3); received dimension {given.dimension}")
    if space is None and isinstance(samples, SampleSet):
        space = samples.model
    if isinstance(space, TSpline):
        return Site(space)
    if not isinstance(space, SplineSpace):
        raise InputError(
            f"the space is a SplineSpace, or a TSpline of it; received {type(space).__name__}; it is that of a fit to "
            "the nominal surface, to an earlier part, or spline_space(mesh)"
        )
    flat = np.zeros(int(space.n_functions))
    return Site(make_surface(space, flat if given.dimension == 1 else np.zeros((len(flat), 3)), frame))


def _weight(smoothing: float) -> float:
    weight = float(smoothing)
    if not np.isfinite(weight) or weight < 0:
        raise InputError(f"smoothing λ is finite and at least zero; received {smoothing!r}; try 'auto'")
    return weight


def _few_by_design(samples: Any) -> bool:
    """Whether they are measured samples with a space of more functions, in which the surface bends least between."""
    return isinstance(samples, SampleSet) and samples.index is not None and isinstance(samples.strategy, Adaptive)


def _warnings(m: int, n: int, smoothing: float) -> tuple[str, ...]:
    if smoothing == 0:
        return ()
    reason = "are too few to" if m < n else "are not placed so that they"
    return (f"{m} samples {reason} determine {n} control points; smoothing (λ = {smoothing:.3g}) fills the gaps",)
