"""All bands of a multi-resolution analysis on one page."""

from typing import TYPE_CHECKING, Any

import numpy as np

from ..data import HeightMap
from ._height_map import draw_heights
from ._raster import raster_of_map
from ._style import display_unit, new_figure, print_style
from ._texture import plot_texture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLUMNS = 3


def plot_bands(analysis: Any) -> "Figure":
    """Draw data, every band, their sum and what is left, each with its own colours and Sq.

    **Arguments:**

    - `analysis`: a `Multiresolution`.

    **Returns:** the figure, to be saved with `figure.savefig`.

    **Raises:** `MissingExtraError` without matplotlib.
    """
    count = len(analysis.bands) + 2
    rows = -(-count // _COLUMNS)
    width, height = analysis.fitted.extent
    with print_style():
        figure = new_figure(9.6, rows * (min(max(2.1 * height / width, 1.1), 3.2) + 0.75))
        axes = figure.subplots(rows, _COLUMNS, squeeze=False).ravel()
        for k, band in enumerate(analysis.bands):
            _draw(band.heights, axes[k], f"{_range(band)}\nSq {_length(band.sq, analysis.unit)}", diverging=k > 0)
        _draw(analysis.fitted, axes[count - 2], f"sum of the bands\nSq {_length(analysis.sq_fitted, analysis.unit)}")
        rest = f"remainder\nSq {_length(analysis.sq_remainder, analysis.unit)}"
        _draw(analysis.remainder, axes[count - 1], rest, diverging=True)
        for ax in axes[count:]:
            ax.set_axis_off()
    return figure


def _draw(heights: HeightMap, ax: Any, title: str, *, diverging: bool = False) -> None:
    """A map; what lies about zero on a diverging one."""
    if diverging:
        plot_texture(heights, ax)
    else:
        draw_heights(raster_of_map(heights), ax)
    ax.set_title(title)


def _range(band: Any) -> str:
    """The wavelengths of a band."""
    unit = band.heights.unit
    if np.isinf(band.longest):
        return f"waves above {_length(band.shortest, unit)}"
    factor, shown = display_unit(band.shortest, unit)
    numbers = f"waves of {band.shortest * factor:.3g} to {band.longest * factor:.3g}"
    return f"{numbers} {shown}" if shown else numbers


def _length(value: float, unit: str | None) -> str:
    factor, shown = display_unit(value, unit)
    return f"{value * factor:.3g} {shown}" if shown else f"{value:.3g}"
