"""Where samples stand, and what a number of them is worth."""

from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import ArrayLike, Float

from ._mesh import plot_mesh
from ._style import ACCENT, INK, QUIET, display_unit, finish_logarithmic, new_figure, print_style, with_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: A dot's area in points², between these, for as many dots as the page shows apart.
_LARGEST, _SMALLEST, _INK_OF_ALL = 9.0, 0.4, 6000.0
_MARKERS = "osD^vP*Xp<>h"
#: Errors this far below the range are round-off: drawn at the floor.
_EXACT = 1e-12


def plot_samples(parameters: Float[ArrayLike, "m 2"], surface: Any, ax: "Axes | None" = None) -> "Axes":
    """Draw samples as dots over a surface and its T-mesh.

    **Arguments:**

    - `parameters`: (m, 2), their places (s, t) in [0, 1]².
    - `surface`: a `TSpline` over whose heights they are drawn.
    - `ax`: the axes to draw on; a new figure's if not given.

    **Returns:** the axes.

    **Raises:** `MissingExtraError` without matplotlib.

    >>> from tsplinejax import mesh, space, surface
    >>> flat = surface.make_surface(space.spline_space(mesh.b_lattice(4, 2)), [1.0] * 35)
    >>> len(plot_samples([[0.5, 0.5], [0.1, 0.9]], flat).collections)
    2
    """
    places = surface.frame.xy_of(parameters)
    with print_style(ax):
        drawn = plot_mesh(surface, ax)
        area = float(np.clip(_INK_OF_ALL / len(places), _SMALLEST, _LARGEST))
        drawn.scatter(
            *places.T, s=area, color=ACCENT, linewidths=0, zorder=3, rasterized=len(places) > 5000, clip_on=False
        )
    return drawn


def plot_sampling_study(study: Any, ax: "Axes | None" = None) -> "Axes":
    """Draw the error of reconstructions over the number of samples, a line for each strategy.

    Strategies that know the T-mesh are dark, with full markers; a dotted line stands at one sample a control point.

    **Arguments:**

    - `study`: `strategies` (k names), `sizes` (j), `rms_errors` (k, j), `control_points`, `range` and `unit`.
    - `ax`: the axes to draw on; a new figure's if not given.

    **Returns:** the axes, both logarithmic. Errors below 10⁻¹² of the range are drawn there.

    **Raises:** `MissingExtraError` without matplotlib.
    """
    errors = np.maximum(study.rms_errors, _EXACT * study.range)
    factor, unit = display_unit(float(errors.max()), study.unit)
    with print_style(ax):
        ax = new_figure(6.4, 3.8).add_subplot() if ax is None else ax
        for row, name in enumerate(study.strategies):
            ours = name.startswith(("greville", "t-patch", "adaptive"))
            ax.plot(
                study.sizes,
                errors[row],
                marker=_MARKERS[row % len(_MARKERS)],
                markersize=4.5,
                color=INK if ours else QUIET,
                markerfacecolor=INK if ours else "white",
                linestyle="-" if ours else "--",
                linewidth=1.2 if ours else 0.8,
                label=name,
            )
        ax.axvline(study.control_points, color=ACCENT, linewidth=0.8, linestyle=":")
        ax.set(xscale="log", yscale="log", xlabel="samples", ylabel=with_unit("rms error", unit))
        finish_logarithmic(ax, y_factor=factor)
        ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return ax
