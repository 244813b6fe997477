"""Sampling strategies that need no linear algebra: T-patch, Wang's, and the usual ones.

A strategy gives `size` places (s, t) on the parameter square of a site. Every strategy takes any size; without one it
takes its natural size.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .._errors import InputError
from ..surface import TSpline
from ._allocation import apportioned, in_rows
from ._site import Site


@dataclass(frozen=True)
class AbstractStrategy(ABC):
    """Where to sample."""

    def natural_size(self, site: Site) -> int:
        """How many samples it takes where nobody says: as many as there are control points."""
        return site.control_points

    def planned(self, site: Site, size: int, rng: np.random.Generator) -> tuple[TSpline, Float[np.ndarray, "size 2"]]:
        """The places, and the model whose space they are to recover: the site's own, unless a strategy refines it."""
        return site.model, self.places(site, size, rng)

    @abstractmethod
    def places(self, site: Site, size: int, rng: np.random.Generator) -> Float[np.ndarray, "size 2"]:
        """Parameters (s, t) in [0, 1]², exactly `size` of them."""


@dataclass(frozen=True)
class TPatch(AbstractStrategy):
    """T-patch sampling: the same number of samples in every element of the T-mesh (§6.1 of the paper).

    Four samples an element are enough to recover a surface of the space; a size that is no multiple of the elements
    gives some of them one more.

    **Attributes:**

    - `random`: at random places of the element, instead of in even rows.
    - `per_element`: of the natural size.
    """

    random: bool = False
    per_element: int = 4

    def __post_init__(self) -> None:
        if self.per_element < 1:
            raise InputError(f"T-patch sampling takes at least one sample an element; received {self.per_element}")

    def natural_size(self, site: Site) -> int:
        """Four samples an element."""
        return self.per_element * len(site.elements)

    def places(self, site: Site, size: int, rng: np.random.Generator) -> Float[np.ndarray, "size 2"]:
        """Even rows or random places in each element."""
        return _in_elements(site, np.ones(len(site.elements)), size, rng if self.random else None)


@dataclass(frozen=True)
class ElementArea(AbstractStrategy):
    """Element-area sampling after Wang et al. 2020: a sample in each element, further ones where elements are largest.

    The elements' areas are those of the surface over them. How samples are shared out among elements is our reading of
    the abstract: the largest piece of an element that a sample stands for is cut next.

    Source: J. Wang, Y. Lu, L. Ye, R. Chen, R. Leach, Precision Engineering 66 (2020), doi
    10.1016/j.precisioneng.2020.08.008.
    """

    def places(self, site: Site, size: int, rng: np.random.Generator) -> Float[np.ndarray, "size 2"]:
        """Even rows in each element."""
        return _in_elements(site, site.integrals(site.elements, of_curvature=False), size, None)


@dataclass(frozen=True)
class ElementCurvature(AbstractStrategy):
    """Element-curvature sampling after Wang et al. 2020: as `ElementArea`, by the integral of √(k₁² + k₂²)."""

    def places(self, site: Site, size: int, rng: np.random.Generator) -> Float[np.ndarray, "size 2"]:
        """Even rows in each element."""
        return _in_elements(site, site.integrals(site.elements, of_curvature=True), size, None)


@dataclass(frozen=True)
class Grid(AbstractStrategy):
    """A uniform grid from border to border, as square as the size allows; its rows differ by one sample at most."""

    def places(self, site: Site, size: int, rng: np.random.Generator) -> Float[np.ndarray, "size 2"]:
        """Rows of equal distance."""
        width, height = site.sides
        return in_rows(np.array([size]), np.array([height / width]), to_border=True)[1]


@dataclass(frozen=True)
class Random(AbstractStrategy):
    """Independent, uniformly distributed places."""

    def places(self, site: Site, size: int, rng: np.random.Generator) -> Float[np.ndarray, "size 2"]:
        """Uniform random numbers."""
        return rng.random((size, 2))


@dataclass(frozen=True)
class Halton(AbstractStrategy):
    """The Halton sequence in bases 2 and 3, randomly shifted: evenly spread without being a grid."""

    def places(self, site: Site, size: int, rng: np.random.Generator) -> Float[np.ndarray, "size 2"]:
        """The first numbers of the sequence."""
        from scipy.stats.qmc import Halton as Sequence

        return (Sequence(2, scramble=False).random(size) + rng.random(2)) % 1


@dataclass(frozen=True)
class LatinHypercube(AbstractStrategy):
    """Latin hypercube sampling: as many columns and rows as samples, one in each."""

    def places(self, site: Site, size: int, rng: np.random.Generator) -> Float[np.ndarray, "size 2"]:
        """Random places in a random permutation's cells."""
        cells = np.stack([np.arange(size), rng.permutation(size)], axis=1)
        return (cells + rng.random((size, 2))) / size


@dataclass(frozen=True)
class Curvature(AbstractStrategy):
    """Curvature-weighted sampling: denser where the surface bends.

    The density is a mixture of one that is even over the surface's area and one that follows √(k₁² + k₂²); samples are
    drawn systematically along a curve that fills the square, so that they do not clump as independent ones do.

    **Attributes:**

    - `share`: of the samples that follow the curvature, from 0 to 1.
    """

    share: float = 0.5

    def __post_init__(self) -> None:
        if not 0 <= self.share <= 1:
            raise InputError(f"the share of samples that follow the curvature is from 0 to 1; received {self.share!r}")

    def places(self, site: Site, size: int, rng: np.random.Generator) -> Float[np.ndarray, "size 2"]:
        """Random places in cells of constant density."""
        boxes = site.pieces
        area, bent = (site.integrals(boxes, of_curvature=flag) for flag in (False, True))
        share = self.share if bent.any() else 0.0
        weights = (1 - share) * area / area.sum() + share * bent / (bent.sum() or 1.0)
        ends = np.cumsum(weights)
        drawn = (np.arange(size) + rng.random()) / size * ends[-1]
        cell = np.minimum(np.searchsorted(ends, drawn), len(boxes) - 1)
        return boxes[cell, :2] + rng.random((size, 2)) * (boxes[cell, 2:] - boxes[cell, :2])


def _in_elements(
    site: Site, weights: Float[np.ndarray, " e"], size: int, rng: np.random.Generator | None
) -> Float[np.ndarray, "size 2"]:
    """Samples shared out among the elements: in even rows, or at random places."""
    lengths = (site.elements[:, 2:] - site.elements[:, :2]) * site.sides
    owner, local = in_rows(apportioned(weights, size), lengths[:, 1] / lengths[:, 0])
    if rng is not None:
        local = rng.random(local.shape)
    boxes = site.elements[owner]
    return boxes[:, :2] + local * (boxes[:, 2:] - boxes[:, :2])
