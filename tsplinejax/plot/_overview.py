"""One page about a fit."""

from typing import TYPE_CHECKING, Any

from ._convergence import plot_convergence
from ._error import plot_error
from ._mesh import plot_mesh
from ._style import new_figure, print_style
from ._surface_3d import plot_surface_3d

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def plot_overview(surface_or_result: Any, data: Any = None) -> "Figure":
    """Draw a fit on one page: the T-mesh over the heights, the errors, the convergence and a view in space.

    A surface without its fit has neither errors nor history: only the first and the last panel are drawn.

    **Arguments:**

    - `surface_or_result`: a `FitResult`, or a `TSpline`.
    - `data`: the data to draw below the mesh; a result brings its own.

    **Returns:** the figure, to be saved with `figure.savefig`.

    **Raises:** `MissingExtraError` without matplotlib.

    >>> from tsplinejax import mesh, space, surface
    >>> flat = surface.make_surface(space.spline_space(mesh.b_lattice(4, 2)), [1.0] * 35)
    >>> len(plot_overview(flat).get_axes())
    2
    """
    surface = getattr(surface_or_result, "surface", surface_or_result)
    with print_style():
        if surface is surface_or_result:
            figure = new_figure(8.6, max(_row_heights(surface.frame.extent)[0], 2.8))
            panels = [figure.add_subplot(1, 2, 1), figure.add_subplot(1, 2, 2, projection="3d")]
        else:
            rows = _row_heights(surface.frame.extent)
            figure = new_figure(8.6, sum(rows))
            parts: Any = figure.subfigures(2, 1, height_ratios=rows)
            maps, graphs = parts
            panels = [maps.add_subplot(1, 2, 1), maps.add_subplot(1, 2, 2), graphs.add_subplot(1, 2, 1)]
            panels.append(graphs.add_subplot(1, 2, 2, projection="3d"))
            plot_error(surface_or_result, panels[1])
            plot_convergence(surface_or_result, panels[2])
        plot_mesh(surface_or_result, panels[0], data)
        plot_surface_3d(surface, panels[-1])  # pyright: ignore[reportArgumentType]
        for letter, ax in zip("abcd", panels, strict=False):
            _letter(ax, letter)
    return figure


def _row_heights(extent: tuple[float, float]) -> tuple[float, float]:
    """Inches for the row of maps, whose width is given, and for the row of graphs."""
    return min(max(2.9 * extent[1] / extent[0], 0.5), 3.6) + 0.7, 3.2


def _letter(ax: "Axes", letter: str) -> None:
    """Put a panel's letter above its upper left corner."""
    ax.annotate(
        f"({letter})", (0, 1), (-6, 6), "axes fraction", "offset points", ha="right", va="bottom", weight="bold"
    )
