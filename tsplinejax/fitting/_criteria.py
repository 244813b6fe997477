"""When is an element good enough? Two criteria, each a multiple of its own threshold per element.

[`ToleranceCriterion`][tsplinejax.fitting.ToleranceCriterion]: the largest residual at the element's samples against the
tolerance.

[`NoiseCriterion`][tsplinejax.fitting.NoiseCriterion]: a score test. With R = Σ_j w_j B(u_j) r_j the moments of an
element's residuals against its sixteen Bernstein products and M their Gram matrix, Rᵀ M⁻¹ R is the part of Σ w r² that
a bicubic patch of its own would explain: σ² χ²(16) for white noise, whatever the number of samples. Structure that a
plain chi-square over all samples drowns in their number is found by it; the plain test stays beside it for detail
inside the element. Noise that is correlated over κ samples explains up to κ times as much.
"""

from abc import abstractmethod
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..data import NoiseEstimate, Samples, noise_deviation
from ._discretisation import Discretisation
from ._moments import Moments
from ._result import StopReason
from ._store import Chosen, over, put
from ._system import bernstein_mass
from ._tally import Tally


@dataclass(frozen=True, eq=False)
class AbstractCriterion:
    """Judges the elements of a T-mesh."""

    @property
    @abstractmethod
    def met(self) -> StopReason:
        """The reason to stop once no element violates the criterion."""

    @abstractmethod
    def resolution(self, tally: Tally) -> float:
        """The error, in the fit's scale, that the threshold stands for: what a solve need not go far below."""

    @abstractmethod
    def stage_tolerance(self, multiple: float, factor: float) -> float | None:
        """What a multiple of the threshold is in the data's unit, if anything; `factor` scales fitted values to it."""

    @abstractmethod
    def excess(self, mesh: Discretisation, tally: Tally, dimension: int) -> Float[np.ndarray, " elements"]:
        """Each element's measure as a multiple of its threshold: above one it violates the criterion."""


@dataclass(frozen=True, eq=False)
class ToleranceCriterion(AbstractCriterion):
    """No residual exceeds the tolerance (in the units of the fit's values)."""

    tolerance: float

    @property
    def met(self) -> StopReason:
        """The tolerance is met."""
        return StopReason.TOLERANCE

    def resolution(self, tally: Tally) -> float:
        """The tolerance."""
        return self.tolerance

    def stage_tolerance(self, multiple: float, factor: float) -> float:
        """The multiple of the tolerance, in the data's unit."""
        return multiple * self.tolerance * factor

    def excess(self, mesh: Discretisation, tally: Tally, dimension: int) -> Float[np.ndarray, " elements"]:
        """Largest residual over tolerance."""
        return mesh.per_element(np.maximum, tally.largest) / self.tolerance


@dataclass(frozen=True, eq=False)
class NoiseCriterion(AbstractCriterion):
    """Residuals are not significantly above the noise.

    **Attributes:**

    - `correlated`: number of samples κ over which the noise is correlated (1 for white noise).
    - `significance`: standard deviations of the test.
    """

    correlated: float = 1.0
    significance: float = 3.0

    @property
    def met(self) -> StopReason:
        """The residuals look like noise."""
        return StopReason.NOISE

    def resolution(self, tally: Tally) -> float:
        """The noise's standard deviation over the square root of the samples of a control point, about sixteen."""
        return 0.25 * float(np.sqrt(tally.variance.sum() / max(tally.counts.sum(), 1.0)))

    def stage_tolerance(self, multiple: float, factor: float) -> float | None:
        """Nothing: the test has thresholds of its own."""
        return None

    def excess(self, mesh: Discretisation, tally: Tally, dimension: int) -> Float[np.ndarray, " elements"]:
        """Root of the larger of both statistics over its threshold: an error ratio, like the tolerance's."""
        parts = (tally.weighted, tally.explained, tally.counts, tally.variance)
        squares, explained, counts, expected = (mesh.per_element(np.add, part) for part in parts)
        d = dimension
        variance = expected / np.maximum(counts, 1)
        freedom = np.minimum(16.0, counts) * d
        share = np.minimum(self.correlated * freedom, counts * d)
        plain = _ratio(squares, variance, counts * d, self.correlated, self.significance)
        score = _ratio(explained, variance, share, self.correlated, self.significance)
        return np.sqrt(np.maximum(plain, score))


FLOOR = 1.5e-4  # of the range: below it "noise" is round-off and quantisation of the arithmetic


def noise_variance(noise: NoiseEstimate, samples: Samples, factor: float) -> Float[np.ndarray, " m"]:
    """Noise variance of each sample times its weight; `factor` scales fitted values to the data's unit."""
    deviation = np.maximum(noise_deviation(noise, samples) / factor, FLOOR)
    weights = 1.0 if samples.weights is None else samples.weights
    return weights * deviation**2


def _ratio(
    statistic: np.ndarray, variance: np.ndarray, mean: np.ndarray, correlated: float, significance: float
) -> np.ndarray:
    """A statistic over its threshold: the quantile of σ² κ χ²(mean / κ), by Wilson and Hilferty's cube root."""
    freedom = np.maximum(mean / correlated, 1e-9)
    spread = 2 / (9 * freedom)
    threshold = variance * mean * (1 - spread + significance * np.sqrt(spread)) ** 3
    return np.where(statistic > 0, statistic / np.maximum(threshold, np.finfo(np.float64).tiny), 0)


@jax.jit
def explained_squares(
    moments: Moments, points: Float[Array, "capacity 4 4 c"], chosen: Chosen
) -> Float[Array, " capacity"]:
    """The part of each chosen element's Σ w r² that a bicubic patch of its own would explain, in the list's order.

    It comes from moments, without a pass over the samples.
    """
    d = moments.load.shape[-1]

    def turn(at: Array, real: Array, carry: Array) -> Array:
        rows = chosen.rows[at]
        mass, load = bernstein_mass(moments.mass[rows]), moments.load[rows].reshape(len(rows), 16, d)
        rest = load - jnp.matmul(mass, points[rows][..., :d].reshape(len(rows), 16, d), precision="highest")
        # A ridge far below the mass keeps elements with few samples solvable and the statistic a lower bound.
        ridge = 1e-9 * jnp.trace(mass, axis1=1, axis2=2) + jnp.finfo(mass.dtype).tiny * 1e10
        factor = jnp.linalg.cholesky(mass + ridge[:, None, None] * jnp.eye(16, dtype=mass.dtype))
        whitened = jax.scipy.linalg.solve_triangular(factor, rest, lower=True)
        return put(carry, at, real, jnp.sum(whitened**2, axis=(1, 2)))

    return over(chosen.places, turn, jnp.zeros(len(chosen.rows), points.dtype))
