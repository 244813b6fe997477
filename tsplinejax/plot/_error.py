"""Maps of the fitting error."""

from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from ..surface import normals
from ._height_map import draw_raster
from ._raster import raster_of_samples
from ._style import ERROR_COLOURS, add_colour_bar, display_unit, is_wide, map_axes, number, print_style, with_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colorbar import Colorbar

#: The colours reach at most so many tolerances: errors far beyond it (spikes) are drawn in the end's colour.
_MOST_TOLERANCES = 4.0


def plot_error(result: Any, ax: "Axes | None" = None) -> "Axes":
    """Draw the error at every sample, data minus surface, with the tolerance marked on the colour bar.

    A pixel that stands for several samples shows the largest error among them, so that a single violation stays
    visible. For a model in space the magnitude is the Euclidean error and the sign tells the side of the surface.
    Outliers that the fit set aside are crossed and do not stretch the colours.

    **Arguments:**

    - `result`: a `FitResult`.
    - `ax`: the axes to draw on; a new figure's if not given.

    **Returns:** the axes.

    **Raises:** `MissingExtraError` without matplotlib.
    """
    errors = signed_errors(result)
    outliers = np.zeros(len(errors), bool) if result.outliers is None else np.asarray(result.outliers, bool)
    kept = np.where(outliers, 0, errors)
    raster = raster_of_samples(result.samples, np.where(outliers, np.nan, errors), "largest")
    limit = _limit(np.abs(kept), result.tolerance)
    factor, unit = display_unit(limit, raster.unit)
    with print_style(ax):
        ax = map_axes(raster.size) if ax is None else ax
        image = draw_raster(raster.reduced("largest"), ax, ERROR_COLOURS, (-limit, limit))
        extend = "both" if np.abs(kept).max() > limit else "neither"
        bar = add_colour_bar(image, with_unit("error", unit), wide=is_wide(raster.size), factor=factor, extend=extend)
        if result.tolerance is not None:
            _mark_tolerance(bar, result.tolerance, limit, factor)
        if outliers.any():
            _cross(ax, result.samples.frame.xy_of(result.samples.parameters[outliers]))
    return ax


def signed_errors(result: Any) -> Float[np.ndarray, " m"]:
    """Return each sample's Euclidean error, positive where the data lie on the side of the surface's normal."""
    residuals = np.asarray(result.residuals, dtype=np.float64)
    if residuals.ndim == 1 or residuals.shape[1] == 1:
        return residuals.reshape(-1)
    directions = np.asarray(normals(result.surface, result.samples.parameters))
    side = np.einsum("md,md->m", residuals, directions)
    return np.copysign(np.linalg.norm(residuals, axis=1), side)


def _limit(magnitudes: np.ndarray, tolerance: float | None) -> float:
    """Where the colours end: a little beyond the tolerance or at the largest error, whichever is larger."""
    largest = float(magnitudes.max())
    if tolerance is None:
        return largest or 1.0
    return min(max(largest, 1.25 * tolerance), _MOST_TOLERANCES * tolerance)


def _mark_tolerance(bar: "Colorbar", tolerance: float, limit: float, factor: float) -> None:
    """Draw lines at ±ε across the colour bar, and write ε at its ticks."""
    draw = bar.ax.axvline if bar.orientation == "horizontal" else bar.ax.axhline
    for value in (-tolerance, tolerance):
        draw(value, color="black", linewidth=0.9)
    shown = f"{tolerance * factor:.3g}"
    ticks = {-tolerance: rf"$-\varepsilon = -{shown}$", 0.0: "0", tolerance: rf"$\varepsilon = {shown}$"}
    if limit > 1.6 * tolerance:
        ends = f"{limit * factor:.3g}"
        ticks |= {-limit: f"\N{MINUS SIGN}{ends}", limit: number(float(ends))}
    bar.set_ticks(list(ticks), labels=list(ticks.values()))
    bar.minorticks_off()


def _cross(ax: "Axes", positions: Float[np.ndarray, "k 2"]) -> None:
    """Cross out samples that were set aside."""
    label = f"{len(positions)} set aside"
    ax.scatter(*positions.T, marker="x", s=9, linewidths=0.5, color="black", label=label, rasterized=True)
    ax.legend(loc="lower right", frameon=True, framealpha=0.9, edgecolor="none", borderpad=0.3, handletextpad=0.2)
