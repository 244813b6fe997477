"""Shaded views of a surface in space.

The surface is sampled on a grid, put into the coordinates of the drawn box, and shaded there by a light from the upper
left, so that relief shows the same whatever the units and the exaggeration of heights.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from .._errors import require
from ..surface import parameter_grid
from ._height_map import height_limits
from ._raster import grid_shape
from ._style import (
    HEIGHT_COLOURS,
    display_unit,
    grouped,
    keep_style,
    new_figure,
    panel_inches,
    print_style,
    tick_formatter,
    with_unit,
)

if TYPE_CHECKING:
    from mpl_toolkits.mplot3d import Axes3D

# Private functions take 3-D axes as `Any`: matplotlib's annotations of mplot3d lack most of what they use.

#: Points along the longer side.
_GRID = 280
#: A height surface flatter than this share of its longer side is drawn that high, and the exaggeration stated.
_FLATTEST = 0.16
#: Heights of unknown unit are drawn at most this high: whether they share the unit of x and y is not known.
_STEEPEST = 0.5
_ELEVATION, _TURN = 34.0, -62.0
#: Where the light comes from: to the viewer's left, and higher.
_LIGHT_ALTITUDE, _LIGHT_TURN = 42.0, -130.0
#: Inches beside and below the box.
_ROOM_FOR_LABELS = (1.3, 0.7)
_LABEL_DISTANCE, _NUMBER_DISTANCE = 26.0, 9.0
_AMBIENT, _DIFFUSE = 0.42, 0.72


def plot_surface_3d(surface: Any, ax: "Axes3D | None" = None) -> "Axes3D":
    """Draw a surface in space, shaded and coloured by height.

    The axes are equal. Only a height surface that would look flat is drawn higher than it is, and a line above the
    picture then says by what factor.

    **Arguments:**

    - `surface`: a `TSpline`, of heights or in space.
    - `ax`: 3-D axes to draw on; a new figure's if not given.

    **Returns:** the axes.

    **Raises:** `MissingExtraError` without matplotlib.

    >>> from tsplinejax import mesh, space, surface
    >>> flat = surface.make_surface(space.spline_space(mesh.b_lattice(4, 2)), [1.0] * 35)
    >>> plot_surface_3d(flat).get_zlabel()
    'z'
    """
    positions, of_heights = _positions(surface)
    corner = positions.min(axis=(0, 1))
    sides = np.maximum(np.ptp(positions, axis=(0, 1)), 1e-9 * np.ptp(positions, axis=(0, 1)).max())
    box = _box(sides, of_heights, surface.frame.unit)
    drawn = (positions - corner) / sides * box * ((1, -1, 1) if of_heights else 1)
    with print_style(ax):
        ax = new_figure(5.2, 3.4).add_subplot(projection="3d") if ax is None else ax  # pyright: ignore
        ax.view_init(_ELEVATION, _TURN)
        for name, low, high in zip("xyz", corner, corner + sides, strict=True):
            ax.set(**{f"{name}lim": (high, low) if of_heights and name == "y" else (low, high)})
        _place_labels(ax, _fill_panel(ax, box))
        _dress(ax, sides, box, surface.frame.unit)
        ax.plot_surface(
            *np.moveaxis(positions, 2, 0),
            facecolors=_shaded(drawn, positions[:, :, 2], of_heights),
            shade=False,
            rcount=_GRID,
            ccount=_GRID,
            linewidth=0.2,
            rasterized=True,
            clip_on=False,
        )
    return ax


def _positions(surface: Any) -> tuple[Float[np.ndarray, "rows columns 3"], bool]:
    """Points of the surface on a grid of parameters, and whether it is a surface of heights."""
    rows, columns = grid_shape(surface.frame.extent, _GRID)
    parameters = parameter_grid(rows, columns)
    values = np.asarray(surface(parameters), dtype=np.float64)
    of_heights = values.ndim == 1
    if of_heights:
        values = np.column_stack([surface.frame.xy_of(parameters), values])
    return values.reshape(rows, columns, 3), of_heights


def _box(sides: np.ndarray, of_heights: bool, unit: str | None) -> np.ndarray:
    """The drawn box: proportional to the sides, but for heights that would not show or would stand like towers."""
    box = sides / sides[:2].max()
    if of_heights:
        box[2] = np.clip(box[2], _FLATTEST, _STEEPEST if unit is None else None)
    return box


def _shaded(
    drawn: Float[np.ndarray, "rows columns 3"], heights: Float[np.ndarray, "rows columns"], of_heights: bool
) -> Float[np.ndarray, "rows columns 4"]:
    """Colours by height, lit from the left; both sides of a surface in space are lit as the viewer sees them."""
    matplotlib = require("matplotlib", "plot")
    normals = np.cross(np.gradient(drawn, axis=1), np.gradient(drawn, axis=0))
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-300)
    facing = normals[:, :, 2] if of_heights else normals @ _direction(_ELEVATION, _TURN)
    normals *= np.copysign(1.0, facing)[:, :, np.newaxis]
    light = _AMBIENT + _DIFFUSE * np.maximum(normals @ _direction(_LIGHT_ALTITUDE, _LIGHT_TURN), 0)
    low, high, _ = height_limits(heights)
    colours = matplotlib.colormaps[HEIGHT_COLOURS]((heights - low) / (high - low or 1.0))
    colours[:, :, :3] = np.clip(colours[:, :, :3] * light[:, :, np.newaxis], 0, 1)
    return colours


def _fill_panel(ax: Any, box: np.ndarray) -> Float[np.ndarray, " 3"]:
    """Enlarge the box until it and its labels fill the panel, and return its edges' drawn lengths in points.

    matplotlib's 3-D axes are the largest square in the panel, and the box may reach beyond them.
    """
    figure = ax.get_figure(root=True)
    if (layout := figure.get_layout_engine()) is not None:
        layout.execute(figure)
    ax.set_box_aspect(box)
    limits = (ax.get_xlim(), ax.get_ylim(), ax.get_zlim())
    corners = np.stack(np.meshgrid(*limits, [1.0], indexing="ij"), axis=-1)[:, :, :, 0] @ ax.get_proj().T
    corners = corners[..., :2] / corners[..., 3:] / (ax.viewLim.width, ax.viewLim.height)
    panel = panel_inches(ax)
    zoom = float(np.min((panel - _ROOM_FOR_LABELS) / (panel.min() * np.ptp(corners, axis=(0, 1, 2)))))
    ax.set_box_aspect(box, zoom=zoom)
    edges = np.array([corners[1, 0, 0], corners[0, 1, 0], corners[0, 0, 1]]) - corners[0, 0, 0]
    return np.linalg.norm(edges, axis=1) * 72 * panel.min() * zoom


def _direction(altitude: float, turn: float) -> Float[np.ndarray, " 3"]:
    """The unit vector towards a place given by its angles in degrees."""
    up, around = np.radians([altitude, turn])
    return np.array([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])


def _place_labels(ax: Any, edges: Float[np.ndarray, " 3"]) -> None:
    """Set labels and numbers a fixed distance off the box.

    mplot3d moves them by `4 (pad + offset) / (width + height of the axes in points)` of the edge across, with an offset
    of 21 for labels and 8 for numbers: solved here for the pad.
    """
    size = 2 * 72 * panel_inches(ax).min()
    for axis, across in zip((ax.xaxis, ax.yaxis, ax.zaxis), edges[[1, 0, 0]], strict=True):
        axis.labelpad = _LABEL_DISTANCE * size / (4 * across) - 21
        axis.set_tick_params(pad=_NUMBER_DISTANCE * size / (4 * across) - 8)


def _dress(ax: Any, sides: np.ndarray, box: np.ndarray, unit: str | None) -> None:
    """Label the axes and clear away all that a reader does not need."""
    exaggeration = box[2] / box[0] * sides[0] / sides[2]
    ticker = require("matplotlib.ticker", "plot")
    keep_style(ax)
    across, shown = display_unit(sides[:2].max(), unit)
    upward, shown_upward = display_unit(sides[2], unit)
    if np.isclose(exaggeration, 1.0):
        upward, shown_upward = across, shown
    names = (with_unit("x", shown), with_unit("y", shown), with_unit("z", shown_upward))
    for axis, name, factor, length in zip(
        (ax.xaxis, ax.yaxis, ax.zaxis), names, (across, across, upward), box, strict=True
    ):
        axis.set_label_text(name)
        # x and y meet in the front corner, where only one of them has room for a number.
        axis.set_major_locator(
            ticker.MaxNLocator(max(2, round(4.4 * length)), prune="upper" if axis is ax.xaxis else None)
        )
        axis.set_major_formatter(tick_formatter(factor))
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
        axis.line.set(color="0.3", linewidth=0.6)
    ax.grid(False)
    if exaggeration > 1.05 and unit is not None:
        ax.set_title(f"heights exaggerated {grouped(float(f'{exaggeration:.2g}'))} ×", y=0.93, fontsize="small")
