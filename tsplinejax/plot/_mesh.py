"""T-meshes as thin lines over the height map they were refined for."""

from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from .._errors import require
from ._height_map import draw_heights
from ._raster import Raster, raster_of_data, raster_of_samples, raster_of_surface
from ._style import HEIGHT_COLOURS, lightened, map_axes, panel_inches, print_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Elements closer than this share an edge: their coordinates differ by rounding.
_TOUCHING = 1e-9
_LINE, _WHITENED = "0.05", 0.35
#: Width of a line in points, thinner where elements are small, so that a fine mesh leaves the heights visible.
_THINNEST, _THICKEST, _SHARE_OF_ELEMENT = 0.12, 0.6, 0.06


def plot_mesh(surface_or_result: Any, ax: "Axes | None" = None, data: Any = None) -> "Axes":
    """Draw a surface's T-mesh over the heights.

    Each line of the mesh is drawn once and ends where the mesh ends it, so T-junctions show as such.

    **Arguments:**

    - `surface_or_result`: a `TSpline`, or a `FitResult`, whose samples are then drawn below the mesh.
    - `ax`: the axes to draw on; a new figure's if not given.
    - `data`: the data to draw below the mesh instead; without data the surface itself is drawn.

    **Returns:** the axes.

    **Raises:** `MissingExtraError` without matplotlib.

    >>> from tsplinejax import mesh, space, surface
    >>> flat = surface.make_surface(space.spline_space(mesh.b_lattice(4, 2)), [1.0] * 35)
    >>> len(plot_mesh(flat).collections[0].get_segments())  # 5 upright lines and 3 level ones
    8
    """
    surface = getattr(surface_or_result, "surface", surface_or_result)
    raster = _background(surface_or_result, data)
    with print_style(ax):
        ax = map_axes(raster.size) if ax is None else ax
        draw_heights(raster, ax, lightened(HEIGHT_COLOURS, _WHITENED))
        _draw_lines(surface, ax, raster)
    return ax


def mesh_lines(boxes: Float[np.ndarray, "elements 4"]) -> Float[np.ndarray, "lines 2 2"]:
    """Return the skeleton of a T-mesh as maximal straight lines.

    **Arguments:**

    - `boxes`: the elements as s0, t0, s1, t1.

    **Returns:** both ends (s, t) of each line; no two lines overlap.

    >>> len(mesh_lines(np.array([[0.0, 0.0, 0.5, 1.0], [0.5, 0.0, 1.0, 1.0]])))
    5
    """
    s0, t0, s1, t1 = np.asarray(boxes).T
    place, start, end = _merged(np.concatenate([s0, s1]), np.tile(t0, 2), np.tile(t1, 2))
    upright = np.stack([np.stack([place, start], -1), np.stack([place, end], -1)], axis=1)
    place, start, end = _merged(np.concatenate([t0, t1]), np.tile(s0, 2), np.tile(s1, 2))
    level = np.stack([np.stack([start, place], -1), np.stack([end, place], -1)], axis=1)
    return np.concatenate([upright, level])


def _merged(place: np.ndarray, start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unite intervals that touch or overlap on the same grid line; coordinates lie in [0, 1]."""
    place, start, end = (np.round(values, 12) for values in (place, start, end))
    order = np.lexsort((start, place))
    place, start, end = place[order], start[order], end[order]
    line = np.cumsum(np.diff(place, prepend=place[0]) > 0)
    # Lines are set 2 apart, so that one running maximum serves them all.
    reach = np.maximum.accumulate(end + 2 * line) - 2 * line
    first = np.ones(len(place), bool)
    first[1:] = (line[1:] > line[:-1]) | (start[1:] > reach[:-1] + _TOUCHING)
    last = np.append(first[1:], True)
    return place[first], start[first], reach[last]


def _background(surface_or_result: Any, data: Any) -> Raster:
    if data is not None:
        return raster_of_data(data)
    samples = getattr(surface_or_result, "samples", None)
    if samples is not None and samples.grid_shape is not None:
        return raster_of_samples(samples, samples.values[:, -1], "mean")
    return raster_of_surface(getattr(surface_or_result, "surface", surface_or_result))


def _draw_lines(surface: Any, ax: "Axes", raster: Raster) -> None:
    boxes = np.asarray(surface.space.mesh.element_boxes)
    origin, extent = np.array(surface.frame.origin), np.array(surface.frame.extent)
    lines = require("matplotlib.collections", "plot").LineCollection(
        list(origin + mesh_lines(boxes) * extent),
        colors=_LINE,
        linewidths=_line_width(boxes, extent, ax, raster),
        capstyle="projecting",
    )
    ax.add_collection(lines, autolim=False)


def _line_width(boxes: np.ndarray, extent: np.ndarray, ax: "Axes", raster: Raster) -> float:
    """Width in points: a fixed share of the smaller elements' sides, within what prints well."""
    sides = np.minimum(*((boxes[:, 2:] - boxes[:, :2]) * extent).T)
    points = 72 * np.min(panel_inches(ax) / raster.size)
    return float(np.clip(_SHARE_OF_ELEMENT * np.median(sides) * points, _THINNEST, _THICKEST))
