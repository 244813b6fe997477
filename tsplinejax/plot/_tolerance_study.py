"""What a tolerance costs in control points."""

from typing import TYPE_CHECKING, Any

from ._style import INK, display_unit, finish_logarithmic, grouped, new_figure, print_style, with_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot_tolerance_study(study: Any, ax: "Axes | None" = None) -> "Axes":
    """Draw the control points that each tolerance takes; tighter tolerances lie to the left.

    **Arguments:**

    - `study`: `tolerances` and the `control_points` each takes, of the same length, and the `unit` of the tolerances.
    - `ax`: the axes to draw on; a new figure's if not given.

    **Returns:** the axes, both logarithmic.

    **Raises:** `MissingExtraError` without matplotlib.
    """
    factor, unit = display_unit(min(study.tolerances), study.unit)
    with print_style(ax):
        ax = new_figure(4.6, 3.4).add_subplot() if ax is None else ax
        ax.plot(study.tolerances, study.control_points, marker="o", color=INK, markersize=4, markeredgecolor="white")
        for tolerance, count in zip(study.tolerances, study.control_points, strict=True):
            ax.annotate(grouped(count), (tolerance, count), (5, 4), textcoords="offset points", size="small")
        ax.margins(x=0.14)
        ax.set(xscale="log", yscale="log", xlabel=with_unit("tolerance", unit), ylabel="control points")
        finish_logarithmic(ax, x_factor=factor)
    return ax
