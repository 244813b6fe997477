"""One page about a filled map."""

from typing import TYPE_CHECKING, Any

import numpy as np

from ..data import HeightMap, as_data
from ._height_map import draw_raster, height_limits
from ._raster import raster_of_map
from ._style import HEIGHT_COLOURS, add_colour_bar, display_unit, is_wide, new_figure, print_style, with_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_UNCERTAINTY_COLOURS = "magma_r"


def plot_filling(data: Any, filled: Any) -> "Figure":
    """Draw a map before and after its holes were filled, and how uncertain the filled heights are.

    Missing pixels are grey. Both maps share their colours.

    **Arguments:**

    - `data`: the height map with its holes (see [`as_data`][tsplinejax.data.as_data]).
    - `filled`: a `Filled`: `map`, the same with heights in them, and `uncertainty`, (rows, columns), NaN where nothing
      was filled.

    **Returns:** the figure, to be saved with `figure.savefig`.

    **Raises:** `MissingExtraError` without matplotlib.
    """
    before = as_data(data)
    assert isinstance(before, HeightMap)
    rasters = [raster_of_map(before), raster_of_map(filled.map)]
    size = rasters[0].size
    low, high, extend = height_limits(rasters[1].values)
    factor, unit = display_unit(high - low, before.unit)
    with print_style():
        figure = new_figure(11.0, min(max(2.5 * size[1] / size[0], 0.8), 4.2) + 0.7)
        for place, (raster, title) in enumerate(zip(rasters, ("measured", "filled"), strict=True), start=1):
            ax = figure.add_subplot(1, 3, place)
            image = draw_raster(raster.reduced("mean"), ax, HEIGHT_COLOURS, (low, high))
            ax.set_title(title)
            add_colour_bar(image, with_unit("height", unit), wide=is_wide(size), factor=factor, extend=extend)
        _draw_uncertainty(filled, figure.add_subplot(1, 3, 3))
    return figure


def _draw_uncertainty(filled: Any, ax: Any) -> None:
    """The standard uncertainty of the filled heights."""
    raster = raster_of_map(filled.map.with_heights(filled.uncertainty))
    known = raster.values[np.isfinite(raster.values)]
    highest = float(known.max()) if known.size and known.max() > 0 else 1.0
    factor, unit = display_unit(highest, raster.unit)
    image = draw_raster(raster.reduced("largest"), ax, _UNCERTAINTY_COLOURS, (0.0, highest))
    image.set_cmap(image.get_cmap().with_extremes(bad="white"))
    ax.set_title("standard uncertainty")
    add_colour_bar(image, with_unit("uncertainty", unit), wide=is_wide(raster.size), factor=factor)
