"""How a surface is fitted to points in space, and how outliers are weighed."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from .._errors import InputError

if TYPE_CHECKING:
    import optimistix

DEFAULT_SLIP = 10.0


@dataclass(frozen=True)
class AbstractMethod:
    """What moves while a surface is fitted."""


@dataclass(frozen=True)
class Parametric(AbstractMethod):
    """Linear least squares of points in space over fixed parameters (the paper's).

    >>> Parametric()
    Parametric()
    """


@dataclass(frozen=True)
class AbstractFreeMethod(AbstractMethod):
    """Control points and foot points move together, by Gauss-Newton steps."""

    @property
    @abstractmethod
    def components(self) -> int:
        """Components in which a control point moves, along the normal first."""

    @property
    @abstractmethod
    def hold(self) -> float:
        """Weight of a control point's tangential move."""

    @property
    @abstractmethod
    def steps_by(self) -> Any:
        """The optimistix solver, or `None`."""


@dataclass(frozen=True)
class Normal(AbstractFreeMethod):
    """Control points move along the normals of the parametric fit, fixed; foot points move with them.

    **Arguments:**

    - `solver`: `optimistix.GaussNewton` or `optimistix.LevenbergMarquardt`; its descent is replaced by
      [`Elimination`][tsplinejax.orthogonal.Elimination].

    >>> Normal().components
    1
    """

    solver: "optimistix.AbstractLeastSquaresSolver | None" = None

    @property
    def components(self) -> int:
        """One: along the normal."""
        return 1

    @property
    def hold(self) -> float:
        """Nothing to hold."""
        return 0.0

    @property
    def steps_by(self) -> Any:
        """The optimistix solver, or `None`."""
        return self.solver


@dataclass(frozen=True)
class Joint(AbstractFreeMethod):
    """Control points move in space and foot points with them; tangential slip is held.

    The objective carries slip · Σ_i m_i |τ_i|², where τ_i is the tangential part of control point i's move away from
    the parametric fit and m_i = Σ_j w_j b_i(s_j, t_j) the weight of the points it sees. Sliding control points along
    the surface changes its shape little, so that free they would follow the texture: three times as many degrees of
    freedom. With growing slip the fit tends to [`Normal`][tsplinejax.orthogonal.Normal].

    **Arguments:**

    - `slip`: the weight, at least zero; 0 frees the control points, for data without texture or noise.
    - `solver`: `optimistix.GaussNewton` or `optimistix.LevenbergMarquardt`; its descent is replaced by
      [`Elimination`][tsplinejax.orthogonal.Elimination].

    **Raises:** `InputError` for a slip that is negative or not finite.

    >>> Joint(slip=0.0).hold
    0.0
    """

    slip: float = DEFAULT_SLIP
    solver: "optimistix.AbstractLeastSquaresSolver | None" = None

    def __post_init__(self) -> None:
        if not np.isfinite(self.slip) or self.slip < 0:
            raise InputError(f"slip is a finite weight of at least zero; received {self.slip!r}; the default is 10")

    @property
    def components(self) -> int:
        """Three: along the normal, and two along the surface."""
        return 3

    @property
    def hold(self) -> float:
        """The slip's weight."""
        return self.slip

    @property
    def steps_by(self) -> Any:
        """The optimistix solver, or `None`."""
        return self.solver


@dataclass(frozen=True)
class AbstractRobust:
    """Weights that keep outliers from pulling the surface."""

    @abstractmethod
    def weights(self, ratios: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """Weights (m,) in [0, 1] of distances in units of their robust scale."""

    @property
    @abstractmethod
    def limit(self) -> float:
        """The ratio above which a point is called an outlier."""


@dataclass(frozen=True)
class Huber(AbstractRobust):
    """Huber's weights min(1, k / |r|): far points pull with constant force.

    P. J. Huber, "Robust Estimation of a Location Parameter", Annals of Mathematical Statistics 35, 1964.

    >>> Huber().weights(np.array([0.0, 2.69])).tolist()
    [1.0, 0.5]
    """

    k: float = 1.345

    def __post_init__(self) -> None:
        _require_positive(self.k, "k")

    def weights(self, ratios: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """min(1, k / |r|)."""
        return self.k / np.maximum(np.abs(ratios), self.k)

    @property
    def limit(self) -> float:
        """Three times k: about four standard deviations."""
        return 3 * self.k


@dataclass(frozen=True)
class Tukey(AbstractRobust):
    """Tukey's biweight (1 - (r / c)²)²: points farther than c scales do not count.

    A. E. Beaton and J. W. Tukey, "The Fitting of Power Series, Meaning Polynomials, Illustrated on Band-Spectroscopic
    Data", Technometrics 16, 1974.

    >>> Tukey(c=5.0).weights(np.array([0.0, 5.0])).tolist()
    [1.0, 0.0]
    """

    c: float = 4.685

    def __post_init__(self) -> None:
        _require_positive(self.c, "c")

    def weights(self, ratios: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """(1 - (r / c)²)², zero beyond c."""
        return np.maximum(1 - (ratios / self.c) ** 2, 0) ** 2

    @property
    def limit(self) -> float:
        """Points without weight."""
        return self.c


def _require_positive(value: float, name: str) -> None:
    if not np.isfinite(value) or value <= 0:
        raise InputError(f"{name} is a finite number above zero; received {value!r}; leave it out for the default")
