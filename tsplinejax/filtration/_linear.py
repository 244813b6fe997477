"""The linear filter: a smoothing spline over a uniform lattice, whose transmission is 1 / (1 + (λc / λ)⁴).

Minimising Σ (z - f)² + (λc / 2π)⁴ / (dx dy) ∫ f_xx² + 2 f_xy² + f_yy² damps a wave of length λ, in whatever direction,
by that factor (ISO 16610-62 has it along profiles): the energy's symbol is |k|⁴. What a lattice of spacing h cannot
follow, waves shorter than 2 h, has to be damped enough: h ≤ λc / 4 leaves 6 % of a wave of 2 h at most, λc / 6 leaves
1.2 %, of which a part passes or not as the wave lies to the lattice.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..data import HeightMap
from ._lattice import lattice_of_spacing, smoother

_SPACINGS, _FEWEST_SPACINGS = 6, 4  # elements to a cut-off: taken, and needed at least
_TRACE = 0.3  # cut-off, in pixels, of the smoothing that only fills gaps
_UNSOLVED = 1e-6


@dataclass(frozen=True, eq=False)
class Linear:
    """A filter's lattice (M, N), its control points on a grid, the heights at all pixels, and what to know."""

    lattice: tuple[int, int]
    points: Float[np.ndarray, "rows columns"]
    heights: Float[np.ndarray, "rows columns"]
    warnings: tuple[str, ...] = ()


def smoothing_of(cutoff: float, height_map: HeightMap) -> float:
    """λ of a cut-off, for the physical bending energy and one sample a pixel."""
    dx, dy = height_map.spacing
    return (cutoff / (2 * np.pi)) ** 4 / (dx * dy)


def linear(height_map: HeightMap, cutoff: float | None, finest_spacing: float | None) -> Linear:
    """Smooth a map by a cut-off, or by the spacing of the lattice alone; a given spacing is the lattice's."""
    weight = smoothing_of(_TRACE * max(height_map.spacing) if cutoff is None else cutoff, height_map)
    if finest_spacing is not None:
        lattice = lattice_of_spacing(height_map, finest_spacing, finer=False)
    else:
        assert cutoff is not None
        lattice = lattice_of_spacing(height_map, cutoff / _SPACINGS, finer=True)
    warnings = []
    if cutoff is not None and max(element_sides(height_map, lattice)) > 1.01 * cutoff / _FEWEST_SPACINGS:
        warnings.append(
            f"the cut-off {cutoff:.4g} is too near to the pixel for its transmission: the spline's elements are "
            f"{max(element_sides(height_map, lattice)):.4g}, where a quarter of the cut-off is needed"
        )
    equations = smoother(height_map, lattice, weight)
    centre = float(np.mean(height_map.heights, where=height_map.valid, dtype=np.float64))
    points, rest = equations.solve(height_map.heights.astype(np.float64) - centre)
    if rest > _UNSOLVED:
        warnings.append(
            f"the filter's equations are solved to {rest:.1g} only: large parts are missing; fill or crop them"
        )
    points = points + centre
    return Linear(lattice, points, equations.values(points), tuple(warnings))


def element_sides(height_map: HeightMap, lattice: tuple[int, int]) -> tuple[float, float]:
    """Width and height of a lattice's elements."""
    width, height = height_map.extent
    return width / lattice[0], height / lattice[1]
