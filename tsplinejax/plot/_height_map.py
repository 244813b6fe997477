"""Height maps in colour."""

from typing import TYPE_CHECKING, Any

import numpy as np

from ._raster import Raster, raster_of_data
from ._style import (
    HEIGHT_COLOURS,
    MISSING,
    add_colour_bar,
    display_unit,
    is_wide,
    label_position,
    map_axes,
    print_style,
    with_unit,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from matplotlib.image import AxesImage

#: Heights are spiked at an end that lies further off the span of 99.8 % of them than this many times that span.
_SPIKED = 1.0


def plot_height_map(data: Any, ax: "Axes | None" = None) -> "Axes":
    """Draw a height map, or a point cloud's mean heights, in physical coordinates with a colour bar.

    Missing heights are grey. Where single spikes would leave the rest one colour, the colours span 99.8 % of the
    heights and the colour bar ends in arrows.

    **Arguments:**

    - `data`: whatever is accepted as data (see [`as_data`][tsplinejax.data.as_data]).
    - `ax`: the axes to draw on; a new figure's if not given.

    **Returns:** the axes.

    **Raises:** `MissingExtraError` without matplotlib; `InputError` for anything that is not data.

    >>> plot_height_map([[0.0, 1.0], [1.0, 3.0]]).get_ylabel()
    'y'
    """
    raster = raster_of_data(data)
    with print_style(ax):
        ax = map_axes(raster.size) if ax is None else ax
        draw_heights(raster, ax)
    return ax


def draw_heights(raster: Raster, ax: "Axes", colours: "str | Colormap" = HEIGHT_COLOURS) -> None:
    """Draw a raster of heights with its axes and colour bar."""
    drawn = raster.reduced("mean")
    low, high, extend = height_limits(drawn.values)
    factor, unit = display_unit(high - low, raster.unit)
    image = draw_raster(drawn, ax, colours, (low, high))
    add_colour_bar(image, with_unit("height", unit), wide=is_wide(raster.size), factor=factor, extend=extend)


def draw_raster(raster: Raster, ax: "Axes", colours: "str | Colormap", limits: tuple[float, float]) -> "AxesImage":
    """Draw a raster with row 0 at the top, on physical, equal axes."""
    image = ax.imshow(raster.values, cmap=colours, vmin=limits[0], vmax=limits[1], extent=raster.edges, aspect="equal")
    image.set_cmap(image.get_cmap().with_extremes(bad=MISSING))
    (x, y), (width, height) = raster.start, raster.size
    ax.set(xlim=(x, x + width), ylim=(y + height, y))
    label_position(ax, raster.size, raster.unit)
    return image


def height_limits(heights: np.ndarray) -> tuple[float, float, str]:
    """Return the heights at both ends of the colours, and at which of them a colour bar needs an arrow."""
    valid = heights[np.isfinite(heights)]
    if valid.size == 0:
        return 0.0, 1.0, "neither"
    lowest, highest = float(valid.min()), float(valid.max())
    low, high = (float(height) for height in np.percentile(valid, [0.1, 99.9]))
    beyond = _SPIKED * (high - low) or np.inf
    spiked = (low - lowest > beyond, highest - high > beyond)
    extend = {(False, False): "neither", (True, False): "min", (False, True): "max", (True, True): "both"}[spiked]
    return low if spiked[0] else lowest, high if spiked[1] else highest, extend
