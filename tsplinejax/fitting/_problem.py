"""A fit made ready: samples sorted and scaled on the device, criterion, strategies and budgets."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Array, Float, Int

from .._errors import InputError
from ..data import Frame
from ..mesh import AbstractRefinement, AnalysisSuitable, Direction, TMesh, b_lattice
from ..space import capacity_for, to_device
from ._criteria import AbstractCriterion
from ._options import Request
from ._samples import AbstractSamples
from ._solve import AbstractSolver, LocalSolver
from ._source import AbstractSource, Scaling
from ._stages import Marking


@dataclass(frozen=True)
class Budget:
    """Where a fit stops before its criterion is met; `None` is no limit."""

    max_steps: int | None = None
    max_control_points: int | None = None
    max_seconds: float | None = None


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
    - `marking`: how fast the loop descends.
    - `room`: padded length to begin with, where that is more than small data ask for.
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
    marking: Marking = field(default_factory=Marking)
    room: int = 0

    @property
    def source(self) -> AbstractSource:
        """Where the samples come from."""
        return self.request.source

    @property
    def dimension(self) -> int:
        """1 for heights, 3 for points in space."""
        return self.source.dimension

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
        """Smallest padded length: small data and meshes take little memory, large data compile few kernels."""
        sizes = ((1 << 15, 1024), (1 << 17, 4096), (1 << 21, 16384))
        least = next((capacity for limit, capacity in sizes if self.source.n_samples < limit), 65536)
        most = self.budget.max_control_points
        return max(self.room, least if most is None else min(least, capacity_for(2 * int(most))))


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
    return replace(problem, start=start, samples=problem.source.prepare(start, problem.request.noise, problem.dtype))


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
    source = request.source
    return Problem(
        request=request,
        start=start,
        samples=source.prepare(start, request.noise, dtype),
        scaling=source.scaling,
        extent=physical_extent(source.frame, dtype),
        criterion=criterion(source.scaling.factor),
        smoothing=smoothing,
        refinement=refinement,
        solver=solver,
        budget=budget,
        marking=Marking() if isinstance(refinement, AnalysisSuitable) else Marking(twice=np.inf),
    )


def physical_extent(frame: Frame, dtype: np.dtype) -> Float[Array, " 2"]:
    """(Lx, Ly) in units of √(Lx Ly)."""
    sides = np.asarray(frame.extent, np.float64)
    return to_device(sides / np.sqrt(sides.prod()), dtype)
