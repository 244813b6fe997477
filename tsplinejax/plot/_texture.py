"""Texture maps, and one page about a form removal."""

from typing import TYPE_CHECKING, Any

import numpy as np

from ..data import HeightMap, as_data
from ._height_map import draw_heights, draw_raster
from ._raster import raster_of_map
from ._style import (
    ERROR_COLOURS,
    add_colour_bar,
    display_unit,
    is_wide,
    keep_style,
    map_axes,
    new_figure,
    print_style,
    tick_formatter,
    with_unit,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: The colours span this share of the texture's magnitudes; what is beyond is drawn in the end's colour.
_SHOWN = 99.7
_MOST_POINTS = 12_000


def plot_texture(texture: Any, ax: "Axes | None" = None) -> "Axes":
    """Draw a texture on a diverging map symmetric about 0, on physical, equal axes; missing samples are grey.

    **Arguments:**

    - `texture`: a `FormRemoval`, whose `texture_map` is drawn, or a height map of the texture (see `as_data`).
    - `ax`: the axes to draw on; a new figure's if not given.

    **Returns:** the axes.

    **Raises:** `MissingExtraError` without matplotlib.

    >>> plot_texture(HeightMap([[-1.0, 1.0], [0.5, 0.0]])).images[0].get_clim()
    (-1.0, 1.0)
    """
    height_map = as_data(getattr(texture, "texture_map", texture))
    assert isinstance(height_map, HeightMap)
    raster = raster_of_map(height_map)
    with print_style(ax):
        ax = map_axes(raster.size) if ax is None else ax
        drawn = raster.reduced("largest")
        limit, largest = _limit(raster.values)
        factor, unit = display_unit(limit, raster.unit)
        image = draw_raster(drawn, ax, ERROR_COLOURS, (-limit, limit))
        extend = "both" if largest > limit else "neither"
        add_colour_bar(image, with_unit("texture", unit), wide=is_wide(raster.size), factor=factor, extend=extend)
    return ax


def plot_form_removal(removal: Any) -> "Figure":
    """Draw a form removal on one page: what was measured, and the texture.

    A height map is drawn as it was measured; a cloud in space, its points coloured by the texture.

    **Arguments:**

    - `removal`: a `FormRemoval`.

    **Returns:** the figure, to be saved with `figure.savefig`.

    **Raises:** `MissingExtraError` without matplotlib.
    """
    with print_style():
        size = removal.texture_map.extent if removal.texture_map is not None else (1.0, 1.0)
        figure = new_figure(9.0, min(max(3.2 * size[1] / size[0], 1.6), 4.6) + 0.6)
        if isinstance(removal.data, HeightMap):
            left = figure.add_subplot(1, 2, 1)
            draw_heights(raster_of_map(removal.data), left)
            left.set_title("measured")
        else:
            _draw_points(removal, figure.add_subplot(1, 2, 1, projection="3d"))
        right = figure.add_subplot(1, 2, 2)
        if removal.texture_map is not None:
            plot_texture(removal, right)
            right.set_title("texture")
    return figure


def _limit(values: np.ndarray) -> tuple[float, float]:
    """Where the colours end, and the largest magnitude."""
    magnitudes = np.abs(values[np.isfinite(values)])
    if not magnitudes.size or not magnitudes.max():
        return 1.0, 0.0
    largest, usual = float(magnitudes.max()), float(np.percentile(magnitudes, _SHOWN))
    return (largest if largest < 1.5 * usual else usual), largest


def _draw_points(removal: Any, ax: Any) -> None:
    """A cloud in space; lengths are equal along the three axes."""
    inliers = np.flatnonzero(~removal.outliers)
    shown = inliers[:: max(1, len(inliers) // _MOST_POINTS)]
    points, texture = removal.points[shown], removal.texture[shown]
    limit, _ = _limit(texture)
    factor, unit = display_unit(float(np.ptp(points, axis=0).max()), removal.unit)
    ax.scatter(*points.T, c=texture, cmap=ERROR_COLOURS, vmin=-limit, vmax=limit, s=1.0, linewidths=0, rasterized=True)
    ax.set_box_aspect(np.maximum(np.ptp(points, axis=0), 0.1 * np.ptp(points, axis=0).max()))
    for axis, name in ((ax.xaxis, "x"), (ax.yaxis, "y"), (ax.zaxis, "z")):
        axis.set_major_formatter(tick_formatter(factor))
        axis.set_label_text(with_unit(name, unit))
    keep_style(ax)
    ax.locator_params(nbins=4)
    ax.set_title("measured, coloured by the texture")
