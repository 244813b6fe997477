"""What a filter lets through, and what it takes off."""

from typing import TYPE_CHECKING, Any

import numpy as np

from ._height_map import draw_heights
from ._raster import raster_of_map
from ._style import ACCENT, INK, QUIET, display_unit, keep_style, new_figure, print_style, tick_formatter, with_unit
from ._texture import plot_texture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def plot_transmission(measured: Any, ax: "Axes | None" = None, *, cutoff: float | None = None) -> "Axes":
    """Draw a filter's transmission over the wavelength: a line an amplitude, and the band of directions and phases.

    **Arguments:**

    - `measured`: a `Transmission`.
    - `ax`: the axes to draw on; a new figure's if not given.
    - `cutoff`: draw 1 / (1 + (λc / λ)⁴) too, of this λc.

    **Returns:** the axes.

    **Raises:** `MissingExtraError` without matplotlib.
    """
    lengths, low, high = measured.wavelengths, measured.ratios.min(axis=(2, 3)), measured.ratios.max(axis=(2, 3))
    factor, unit = display_unit(float(lengths.min()), measured.unit)
    with print_style(ax):
        matplotlib_colours = _colours(len(measured.amplitudes))
        ax = new_figure(4.8, 3.2).add_subplot() if ax is None else ax
        if cutoff is not None:
            fine = np.geomspace(lengths.min(), lengths.max(), 200)
            label = r"$1 / (1 + (\lambda_c / \lambda)^4)$"
            ax.plot(fine, 1 / (1 + (cutoff / fine) ** 4), color=QUIET, linewidth=0.8, label=label)
            ax.axvline(cutoff, color=QUIET, linewidth=0.6, linestyle=":")
        for k, (amplitude, colour) in enumerate(zip(measured.amplitudes, matplotlib_colours, strict=True)):
            scale, height_unit = display_unit(float(amplitude), measured.unit)
            label = with_unit(f"amplitude {amplitude * scale:.4g}", None) + (f" {height_unit}" if height_unit else "")
            ax.plot(lengths, measured.mean[k], "o", color=colour, markersize=4, markeredgecolor="white", label=label)
            ax.vlines(lengths, low[k], high[k], color=colour, linewidth=1.0)
        ax.set(xscale="log", xlabel=with_unit("wavelength", unit), ylabel="transmission")
        keep_style(ax)
        ticker = _ticker()
        ax.xaxis.set_major_locator(ticker.LogLocator(subs=(1, 2, 5)))
        ax.xaxis.set_major_formatter(
            tick_formatter(factor) if factor != 1 else ticker.FuncFormatter(lambda v, _: f"{v:g}")
        )
        ax.xaxis.set_minor_formatter(ticker.NullFormatter())
        ax.spines[["top", "right"]].set_visible(False)
        ax.grid(color="0.9", linewidth=0.5)
        ax.set_axisbelow(True)
        ax.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    return ax


def plot_filtered(result: Any) -> "Figure":
    """Draw a filter's work on one page: the filtered map, and what was taken off.

    **Arguments:**

    - `result`: a `Filtered`.

    **Returns:** the figure, to be saved with `figure.savefig`.

    **Raises:** `MissingExtraError` without matplotlib.
    """
    with print_style():
        width, height = result.filtered.extent
        figure = new_figure(9.0, min(max(3.2 * height / width, 1.6), 4.6) + 0.6)
        left, right = figure.subplots(1, 2)
        draw_heights(raster_of_map(result.filtered), left)
        left.set_title("filtered")
        plot_texture(result.residual, right)
        right.set_title("taken off")
    return figure


def _colours(count: int) -> list[Any]:
    """Two inks, or shades where there are more amplitudes."""
    if count <= 2:
        return [INK, ACCENT][:count]
    from .._errors import require

    shades = require("matplotlib", "plot").colormaps["viridis"]
    return [shades(0.85 * k / (count - 1)) for k in range(count)]


def _ticker() -> Any:
    from .._errors import require

    return require("matplotlib.ticker", "plot")
