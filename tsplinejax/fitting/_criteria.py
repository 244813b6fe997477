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
from ._residuals import Residuals
from ._result import StopReason
from ._system import bernstein_mass


@dataclass(frozen=True, eq=False)
class AbstractCriterion:
    """Judges the elements of a T-mesh."""

    @property
    @abstractmethod
    def met(self) -> StopReason:
        """The reason to stop once no element violates the criterion."""

    @abstractmethod
    def stage_tolerance(self, multiple: float, factor: float) -> float | None:
        """What a multiple of the threshold is in the data's unit, if anything; `factor` scales fitted values to it."""

    @abstractmethod
    def excess(
        self, mesh: Discretisation, moments: Moments, points: Array, residuals: Residuals
    ) -> Float[np.ndarray, " elements"]:
        """Each element's measure as a multiple of its threshold: above one it violates the criterion."""


@dataclass(frozen=True, eq=False)
class ToleranceCriterion(AbstractCriterion):
    """No residual exceeds the tolerance (in the units of the fit's values)."""

    tolerance: float

    @property
    def met(self) -> StopReason:
        """The tolerance is met."""
        return StopReason.TOLERANCE

    def stage_tolerance(self, multiple: float, factor: float) -> float:
        """The multiple of the tolerance, in the data's unit."""
        return multiple * self.tolerance * factor

    def excess(
        self, mesh: Discretisation, moments: Moments, points: Array, residuals: Residuals
    ) -> Float[np.ndarray, " elements"]:
        """Largest residual over tolerance."""
        largest = mesh.per_element(np.maximum, mesh.per_bezier(np.maximum, residuals.largest))
        return largest / self.tolerance


@dataclass(frozen=True, eq=False)
class NoiseCriterion(AbstractCriterion):
    """Residuals are not significantly above the noise.

    **Attributes:**

    - `variance`: noise variance of each sorted sample times its weight, (m,).
    - `correlated`: number of samples κ over which the noise is correlated (1 for white noise).
    - `significance`: standard deviations of the test.
    """

    variance: Float[np.ndarray, " m"]
    correlated: float = 1.0
    significance: float = 3.0

    @property
    def met(self) -> StopReason:
        """The residuals look like noise."""
        return StopReason.NOISE

    def stage_tolerance(self, multiple: float, factor: float) -> float | None:
        """Nothing: the test has thresholds of its own."""
        return None

    def excess(
        self, mesh: Discretisation, moments: Moments, points: Array, residuals: Residuals
    ) -> Float[np.ndarray, " elements"]:
        """Root of the larger of both statistics over its threshold: an error ratio, like the tolerance's."""
        counts = np.diff(mesh.ranges).astype(np.float64)
        d = points.shape[-1]
        sums = np.append(0.0, np.cumsum(self.variance))
        expected = np.diff(sums[mesh.ranges])
        squares = mesh.per_bezier(np.add, residuals.weighted)
        explained = np.asarray(explained_squares(moments, points))[: len(counts)]
        totals = [mesh.per_element(np.add, part) for part in (squares, explained, counts, expected)]
        squares, explained, counts, expected = totals
        variance = expected / np.maximum(counts, 1)
        freedom = np.minimum(16.0, counts) * d
        share = np.minimum(self.correlated * freedom, counts * d)
        plain = _ratio(squares, variance, counts * d, self.correlated, self.significance)
        score = _ratio(explained, variance, share, self.correlated, self.significance)
        return np.sqrt(np.maximum(plain, score))


FLOOR = 1.5e-4  # of the range: below it "noise" is round-off and quantisation of the arithmetic


def noise_criterion(noise: NoiseEstimate, samples: Samples, factor: float, permutation: np.ndarray) -> NoiseCriterion:
    """The criterion for a noise estimate; `factor` scales fitted values to the data's unit."""
    deviation = np.maximum(noise_deviation(noise, samples) / factor, FLOOR)
    weights = 1.0 if samples.weights is None else samples.weights
    return NoiseCriterion((weights * deviation**2)[permutation], noise.correlated_samples)


def _ratio(
    statistic: np.ndarray, variance: np.ndarray, mean: np.ndarray, correlated: float, significance: float
) -> np.ndarray:
    """A statistic over its threshold: the quantile of σ² κ χ²(mean / κ), by Wilson and Hilferty's cube root."""
    freedom = np.maximum(mean / correlated, 1e-9)
    spread = 2 / (9 * freedom)
    threshold = variance * mean * (1 - spread + significance * np.sqrt(spread)) ** 3
    return np.where(statistic > 0, statistic / np.maximum(threshold, np.finfo(np.float64).tiny), 0)


@jax.jit
def explained_squares(moments: Moments, points: Float[Array, "e 4 4 d"]) -> Float[Array, " e"]:
    """The part of each element's Σ w r² that a bicubic patch of its own would explain; no pass over the samples."""
    mass = bernstein_mass(moments.mass)
    count = len(mass)
    load = moments.load.reshape(count, 16, -1)
    rest = load - jnp.einsum("eab,ebd->ead", mass, points.reshape(count, 16, -1), precision="highest")
    # A ridge far below the mass keeps elements with few samples solvable and the statistic a lower bound.
    ridge = 1e-9 * jnp.trace(mass, axis1=1, axis2=2) + jnp.finfo(mass.dtype).tiny * 1e10
    factor = jnp.linalg.cholesky(mass + ridge[:, None, None] * jnp.eye(16, dtype=mass.dtype))
    whitened = jax.scipy.linalg.solve_triangular(factor, rest, lower=True)
    return jnp.sum(whitened**2, axis=(1, 2))
