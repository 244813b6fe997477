"""`sample`: few places of a surface that are enough to have it back."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from .._errors import InputError
from ..data import Samples
from ..fitting import fit
from ..surface import TSpline
from ._measured import measured_samples, nearest, sample_count
from ._names import strategy_of
from ._site import Site
from ._strategies import AbstractStrategy


@dataclass(frozen=True, eq=False, repr=False)
class SampleSet:
    """A few samples of a surface.

    **Attributes:**

    - `samples`: values at parameters, as a fit takes them.
    - `model`: the T-spline whose space they are to recover; some strategies refine the given one.
    - `strategy`: how their places were chosen.
    - `index`: (m,), which of the data they are: pixels of the flattened map, points of the cloud, rows of the samples;
      `None` where a model was sampled.
    - `warnings`: what the user should know, in sentences.
    """

    samples: Samples
    model: TSpline
    strategy: AbstractStrategy
    index: Int[np.ndarray, " m"] | None = None
    warnings: tuple[str, ...] = ()

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.samples)

    def __repr__(self) -> str:
        n, unit = int(self.model.space.n_functions), f", unit {self.unit}" if self.unit else ""
        return f"SampleSet({len(self)} samples by {self.strategy!r}, {len(self) / n:.3g} a control point{unit})"

    @property
    def parameters(self) -> Float[np.ndarray, "m 2"]:
        """Their places (s, t) in [0, 1]²."""
        return self.samples.parameters

    @property
    def values(self) -> Float[np.ndarray, "m d"]:
        """Heights (m, 1) or points in space (m, 3)."""
        return self.samples.values

    @property
    def unit(self) -> str | None:
        """The unit of values and frame."""
        return self.model.unit


def sample(
    data: Any,
    *,
    model: Any = None,
    strategy: AbstractStrategy | str = "greville",
    size: int | None = None,
    parameters: Any = "planar",
    rng: np.random.Generator | int = 0,
) -> SampleSet:
    """Sample a surface at places from which its T-spline space recovers it.

    **Arguments:**

    - `data`: a `TSpline` (or the result of a fit), which is evaluated at the places; or measured data: a `HeightMap`, a
      `PointCloud`, `Samples` or plain arrays, of which the sample nearest to each place is taken, none twice.
    - `model`: for measured data: the T-spline that says where (of the nominal surface, or of an earlier part); by
      default one that is fitted to the data.
    - `strategy`: `Greville()` (default), `TPatch()`, `Adaptive()`, ..., or a name: "greville", "greville-centres",
      "t-patch", "t-patch-random", "adaptive", "element-area", "element-curvature", "curvature", "uniform", "random",
      "halton", "latin-hypercube".
    - `size`: how many samples; by default the strategy's own number.
    - `parameters`: of a cloud: "planar", "conformal", an (m, 2) array or a `Parameterisation`. A cloud without model is
      sampled as heights over (x, y) where they are planar, else as points in space.
    - `rng`: a seed or a generator, for the strategies with randomness.

    **Returns:** a [`SampleSet`][tsplinejax.SampleSet].

    **Raises:** `InputError` for an unknown strategy, a size below one or above the number of measured samples, and data
    that do not fit the model.

    >>> import tsplinejax as tsj
    >>> surface = tsj.make_surface(tsj.spline_space(tsj.b_lattice(6, 4)), np.arange(63.0))
    >>> samples = tsj.sample(surface)
    >>> bool(abs(tsj.reconstruct(samples).surface.control_points - np.arange(63)).max() < 1e-9)
    True
    """
    chosen = strategy_of(strategy)
    site, index = site_of(data, model, parameters)
    return drawn(site, index, chosen, checked_size(site, chosen, size), np.random.default_rng(rng))


def site_of(data: Any, model: Any, parameters: Any) -> tuple[Site, Int[np.ndarray, " m"] | None]:
    """Where samples can be taken, and which of the data the candidates are."""
    data, model = (getattr(given, "surface", given) for given in (data, model))
    if isinstance(data, TSpline):
        if model is not None:
            raise InputError("a T-spline is sampled by its own space; leave model= out, or pass measured data")
        return Site(data), None
    if model is not None and not isinstance(model, TSpline):
        raise InputError(f"a model is a TSpline or the result of a fit; received {type(model).__name__}")
    candidates, index = measured_samples(data, model, parameters)
    surface = fit(candidates).surface if model is None else model
    return Site(surface, candidates, sample_count(data) - len(candidates)), index


def checked_size(site: Site, strategy: AbstractStrategy, size: int | None) -> int:
    """A whole number of samples that there are."""
    number = strategy.natural_size(site) if size is None else size
    if isinstance(number, bool) or int(number) != number or number < 1:
        raise InputError(f"a sample size is a whole number of at least 1; received {size!r}")
    if site.candidates is not None and number > len(site.candidates):
        raise InputError(
            f"{int(number)} samples are asked for, but only {len(site.candidates)} were measured on the model; "
            "give a smaller size"
        )
    return int(number)


def drawn(
    site: Site, index: Int[np.ndarray, " m"] | None, strategy: AbstractStrategy, size: int, rng: np.random.Generator
) -> SampleSet:
    """The samples of a strategy at a site."""
    model, places = strategy.planned(site, size, rng)
    site = site if model is site.model else replace(site, model=model)
    if site.candidates is None:
        values = site.values(places.astype(site.space.dtype))
        return SampleSet(Samples(places, values, None, site.model.frame), site.model, strategy)
    candidates = site.candidates
    assert index is not None
    taken = np.sort(nearest(candidates.parameters, places, site.sides))
    samples = Samples(
        candidates.parameters[taken],
        candidates.values[taken],
        None,
        candidates.frame,
        candidates.grid_shape,
        None if candidates.grid_index is None else candidates.grid_index[taken],
    )
    return SampleSet(samples, site.model, strategy, index[taken], _warnings(site))


def _warnings(site: Site) -> tuple[str, ...]:
    """Say so where data were left out."""
    if not site.left_out:
        return ()
    return (f"{site.left_out} samples of the data lie beyond the model and are left out",)
