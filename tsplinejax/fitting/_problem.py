"""A fit made ready: samples sorted and scaled on the device, criterion, strategies and budgets."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._errors import InputError
from ..data import Frame, Samples
from ..mesh import AbstractRefinement, AnalysisSuitable, Direction, TMesh, b_lattice
from ..space import to_device
from ._criteria import AbstractCriterion, noise_variance
from ._options import Request
from ._samples import AbstractSamples, grid_samples, scattered_samples
from ._solve import AbstractSolver, LocalSolver
from ._tiles import LANES


@dataclass(frozen=True)
class Budget:
    """Where a fit stops before its criterion is met; `None` is no limit."""

    max_steps: int | None = None
    max_control_points: int | None = None
    max_seconds: float | None = None


@dataclass(frozen=True, eq=False)
class Scaling:
    """Values are fitted centred and scaled: value = offset + factor · fitted. Metres in float32 are safe."""

    offset: Float[np.ndarray, " d"]
    factor: float


@dataclass(frozen=True, eq=False)
class Problem:
    """Everything a fit needs that does not change from step to step.

    **Attributes:**

    - `request`: the samples, the outliers among them, and what was asked.
    - `start`: the T-mesh to start from.
    - `samples`: the samples on the device, scaled; outliers have weight zero.
    - `scaling`: from fitted values back to the data's.
    - `extent`: physical extent in units of √(Lx Ly).
    - `criterion`, `refinement`, `solver`, `budget`: the strategies.
    - `smoothing`: weight λ of the bending energy.
    - `stage_factor`: by how much the marking threshold falls from stage to stage.
    """

    request: Request
    start: TMesh
    samples: AbstractSamples
    scaling: Scaling
    extent: Float[Array, " 2"]
    criterion: AbstractCriterion
    smoothing: float
    refinement: AbstractRefinement = field(default_factory=AnalysisSuitable)
    solver: AbstractSolver = field(default_factory=LocalSolver)
    budget: Budget = field(default_factory=Budget)
    stage_factor: float = 0.25

    @property
    def data(self) -> Samples:
        """The samples as given."""
        return self.request.samples

    @property
    def outliers(self) -> Bool[np.ndarray, " m"]:
        """Which samples are set aside, (m,)."""
        return self.request.outliers

    @property
    def dimension(self) -> int:
        """1 for heights, 3 for points in space."""
        return self.data.dimension

    @property
    def n_samples(self) -> int:
        """Number of samples, outliers included."""
        return len(self.data)

    @cached_property
    def counted(self) -> Bool[np.ndarray, " m"]:
        """Samples that count: neither outliers nor of weight zero."""
        return ~self.outliers if self.data.weights is None else ~self.outliers & (self.data.weights > 0)

    @cached_property
    def n_counted(self) -> int:
        """Number of samples that count."""
        return int(self.counted.sum())

    @cached_property
    def signal(self) -> tuple[float, float]:
        """Σ |v|² of the samples that count, as they are and with their mean removed: the signals of the two SNRs."""
        values = self.data.values[self.counted].astype(np.float64)
        return float(np.sum(values**2)), float(np.sum((values - values.mean(axis=0)) ** 2))

    @property
    def dtype(self) -> np.dtype:
        """The precision of the fit."""
        return np.dtype(self.extent.dtype)

    @cached_property
    def lattice(self) -> Int[Array, " 2"]:
        """Squares of the start lattice (M, N), on the device."""
        assert self.start.forest is not None
        return to_device(np.asarray(self.start.forest.lattice, np.int32))

    @property
    def rational(self) -> bool:
        """Whether the refinement leaves meshes that need Eq. 2's division."""
        return not isinstance(self.refinement, AnalysisSuitable)

    @property
    def least_capacity(self) -> int:
        """Smallest padded length: small data take little memory, large data compile few kernels."""
        sizes = ((1 << 15, 1024), (1 << 17, 4096), (1 << 21, 16384))
        return next((capacity for limit, capacity in sizes if self.n_samples < limit), 65536)


def tile_of(n_samples: int) -> int:
    """Blocks of sixteen samples in a tile: a power of two that suits the number of samples and the device."""
    largest = 1024 if jax.default_backend() == "cpu" else 65536
    return int(np.clip(2 ** np.ceil(np.log2(n_samples / LANES + 1)), 64, largest))


def scale_values(data: Samples, counted: Bool[np.ndarray, " m"]) -> Scaling:
    """Centre on the mean of the counted values and divide by their range (the diagonal of their box)."""
    values = data.values[counted].astype(np.float64)
    spread = float(np.linalg.norm(np.ptp(values, axis=0)))
    return Scaling(values.mean(axis=0), spread if spread > 0 else 1.0)


def start_lattice(
    frame: Frame, n_samples: int, lattice: tuple[int, int] | str | None, first_cut: Direction, limit: int | None = None
) -> TMesh:
    """The B-lattice asked for, or one of near-square elements: eight along the shorter side, fewer for few samples.

    `limit` is the most control points it may have.
    """
    if lattice is None:
        width, height = frame.extent
        shorter = int(np.clip(np.sqrt(n_samples / max(width / height, height / width)) / 4, 1, 8))
        lattice = scaled_lattice(frame, shorter)
        while limit is not None and shorter > 1 and _lattice_points(lattice) > limit:
            shorter -= 1
            lattice = scaled_lattice(frame, shorter)
        if lattice[0] * lattice[1] > 4 * n_samples:
            raise InputError(
                f"the data's sides are {width:g} and {height:g}, too unequal for near-square elements with "
                f"{n_samples} samples; give a lattice, for instance (64, 1)"
            )
    if not isinstance(lattice, tuple | list) or len(lattice) != 2:
        raise InputError(f"a lattice is 'auto' or two whole numbers (M, N); received {lattice!r}")
    if limit is not None and _lattice_points(lattice) > limit:
        raise InputError(
            f"the start lattice {lattice[0]} × {lattice[1]} has {_lattice_points(lattice)} control points, but "
            f"max_control_points is {limit}; raise it, or give a coarser lattice"
        )
    return b_lattice(*lattice, first_cut=first_cut)


def _lattice_points(lattice: tuple[int, int]) -> int:
    """Control points of a lattice."""
    return (lattice[0] + 3) * (lattice[1] + 3)


def scaled_lattice(frame: Frame, shorter: int) -> tuple[int, int]:
    """A lattice of near-square elements with the given number along the shorter side."""
    width, height = frame.extent
    unit = min(width, height) / shorter
    return max(1, round(width / unit)), max(1, round(height / unit))


def restart(problem: Problem, lattice: tuple[int, int], first_cut: Direction) -> Problem:
    """The same problem from another start lattice."""
    start = b_lattice(*lattice, first_cut=first_cut)
    if start.forest is not None and problem.start.forest is not None:
        same = (start.forest.lattice, first_cut) == (problem.start.forest.lattice, problem.start.forest.first_cut)
        if same:
            return problem
    counted, scaling = problem.counted, problem.scaling
    return replace(
        problem, start=start, samples=prepare_samples(problem.request, start, scaling, counted, problem.dtype)
    )


def prepare_samples(
    request: Request, start: TMesh, scaling: Scaling, counted: Bool[np.ndarray, " m"], dtype: np.dtype
) -> AbstractSamples:
    """Scale the samples and put them on the device, as pixels where they come from a grid."""
    data = request.samples
    weights = None
    if data.weights is not None or not counted.all():
        weights = np.where(counted, 1.0 if data.weights is None else data.weights, 0.0)
    variance = None if request.noise is None else noise_variance(request.noise, data, scaling.factor)
    values = (data.values.astype(np.float64) - scaling.offset) / scaling.factor
    length = tile_of(len(data))
    shape = data.grid_shape
    if shape is None or not _on_grid(data, shape):
        return scattered_samples(start, data.parameters, values, weights, variance, dtype=dtype, tile=length)
    index = None if len(data) == shape[0] * shape[1] else data.grid_index
    return grid_samples(start, shape, index, values, weights, variance, dtype=dtype, tile=length)


def _on_grid(data: Samples, shape: tuple[int, int]) -> bool:
    """Whether the samples are pixels of their grid, each at most once, in order and in their places."""
    index = data.grid_index
    if index is None or min(shape) < 2 or not (np.diff(index) > 0).all():
        return False
    places = np.stack([index % shape[1] / (shape[1] - 1), index // shape[1] / (shape[0] - 1)], axis=1)
    return np.array_equal(places, data.parameters)


def pose(
    request: Request,
    *,
    start: TMesh,
    criterion: Callable[[float], AbstractCriterion],
    smoothing: float,
    refinement: AbstractRefinement,
    solver: AbstractSolver,
    budget: Budget,
    dtype: np.dtype,
) -> Problem:
    """Make a problem of a request; `criterion` receives the scaling's factor."""
    data, outliers = request.samples, request.outliers
    counted = ~outliers if data.weights is None else ~outliers & (data.weights > 0)
    scaling = scale_values(data, counted)
    return Problem(
        request=request,
        start=start,
        samples=prepare_samples(request, start, scaling, counted, dtype),
        scaling=scaling,
        extent=physical_extent(data.frame, dtype),
        criterion=criterion(scaling.factor),
        smoothing=smoothing,
        refinement=refinement,
        solver=solver,
        budget=budget,
    )


def physical_extent(frame: Frame, dtype: np.dtype) -> Float[Array, " 2"]:
    """(Lx, Ly) in units of √(Lx Ly)."""
    sides = np.asarray(frame.extent, np.float64)
    return to_device(sides / np.sqrt(sides.prod()), dtype)
