"""The style that all pictures share: type, axes, units, colour bars.

matplotlib's state is changed only while a picture of our own is made: axes that the caller hands over keep the caller's
style.
"""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from .._errors import require
from ..data import unit_factor

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.colorbar import Colorbar
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage
    from matplotlib.ticker import Formatter

#: Perceptually uniform, the same for readers with and without colour vision deficiency, and right in black and white.
HEIGHT_COLOURS = "viridis"
ERROR_COLOURS = "RdBu_r"
MISSING = "0.78"
#: Lines in graphs: dark, distinct in lightness.
INK, ACCENT, QUIET = "#17375e", "#c44e1c", "0.45"

_PRINT = {
    # Both come with matplotlib, so a picture is the same on every machine; the second one fills gaps of the first.
    "font.family": ["STIXGeneral", "DejaVu Serif"],
    "mathtext.fontset": "stix",
    "font.size": 10,
    "axes.labelsize": 10,
    "axes.titlesize": 10,
    "axes.linewidth": 0.6,
    "xtick.labelsize": 9,
    "ytick.labelsize": 9,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "legend.fontsize": 9,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
    "figure.dpi": 200,
    "savefig.dpi": "figure",
    "pdf.fonttype": 42,
}
_METRIC = ("pm", "nm", "µm", "mm", "m", "km")
#: Ticks on a logarithmic axis, from sparse to dense.
_STEPS_OF_A_DECADE = ((1,), (1, 2, 5), (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8))
#: A map at least this much wider than high carries its colour bar on top instead of beside it.
_WIDE = 2.4


def print_style(ax: "Axes | None" = None) -> AbstractContextManager[Any]:
    """Return the context in which a picture is drawn: the print style, or the caller's own where axes are given."""
    if ax is not None:
        return nullcontext()
    matplotlib = require("matplotlib", "plot")
    # A notebook's first figure switches matplotlib to interactive drawing; leaving the context must not undo that.
    return _keeping_interaction(matplotlib, matplotlib.rc_context(_PRINT))


@contextmanager
def _keeping_interaction(matplotlib: Any, style: AbstractContextManager[Any]) -> Iterator[None]:
    """The style, with whatever drawing mode the figures made in it have chosen left as it is."""
    with style:
        yield
        interactive = matplotlib.is_interactive()
    matplotlib.interactive(interactive)


def new_figure(width: float, height: float) -> "Figure":
    """Return an empty figure of the given size in inches, laid out so that no label is cut off."""
    return require("matplotlib.pyplot", "plot").figure(figsize=(width, height), layout="constrained")


def keep_style(ax: "Axes") -> None:
    """Tell ticks the style of now: matplotlib makes them when it draws, and would take the style of then."""
    style = require("matplotlib", "plot").rcParams
    for axis in (ax.xaxis, ax.yaxis):
        for which in ("major", "minor"):
            axis.set_tick_params(
                which,
                labelfontfamily=style["font.family"],
                labelsize=style[f"{axis.axis_name}tick.labelsize"],
                width=style[f"{axis.axis_name}tick.{which}.width"],
            )


def map_axes(size: tuple[float, float]) -> "Axes":
    """Return the axes of a new figure that fits a map of this physical size, its labels and its colour bar."""
    scale = min(4.4 / size[0], 4.0 / size[1])
    width, height = size[0] * scale, size[1] * scale
    wide = is_wide(size)
    return new_figure(width + (0.9 if wide else 1.7), max(height, 0.3) + (1.3 if wide else 0.6)).add_subplot()


def panel_inches(ax: "Axes") -> Float[np.ndarray, " 2"]:
    """Return width and height, in inches, of the room that the layout gives to axes."""
    return np.divide(ax.get_position(original=True).transformed(ax.figure.transSubfigure).size, ax.figure.dpi)


def is_wide(size: tuple[float, float]) -> bool:
    """Return whether a map is so wide that a colour bar beside it would be a stub."""
    return size[0] > _WIDE * size[1]


def display_unit(length: float, unit: str | None) -> tuple[float, str | None]:
    """Return the unit in which a length reads easily, and the factor to it; the data's own where that does.

    >>> display_unit(0.000126, "m")
    (1000000.0, 'µm')
    """
    if unit not in _METRIC or 0.1 <= length < 10_000 or length <= 0:
        return 1.0, unit
    factors = [(unit_factor(unit, metric), metric) for metric in _METRIC]
    readable = [(factor, metric) for factor, metric in factors if length * factor >= 1]
    return min(readable, default=factors[0])


def lightened(colours: str, share: float) -> "Colormap":
    """Return a colour map mixed with a share of white, so that dark lines show on all of it."""
    matplotlib = require("matplotlib", "plot")
    table = matplotlib.colormaps[colours](range(256))
    table[:, :3] += share * (1 - table[:, :3])
    return require("matplotlib.colors", "plot").ListedColormap(table, f"light {colours}")


def with_unit(quantity: str, unit: str | None) -> str:
    """Return an axis label.

    >>> with_unit("height", "µm"), with_unit("x", None)
    ('height (µm)', 'x')
    """
    return quantity if unit is None else f"{quantity} ({unit})"


def tick_formatter(factor: float) -> "Formatter":
    """Return the formatter that writes ticks in another unit; plain numbers keep matplotlib's own."""
    ticker = require("matplotlib.ticker", "plot")
    return ticker.ScalarFormatter() if factor == 1 else ticker.FuncFormatter(lambda value, _: number(value * factor))


def number(value: float) -> str:
    """Return a number as it is printed: no trailing zeros, a true minus sign.

    >>> number(-0.25)
    '−0.25'
    """
    return f"{value:.10g}".replace("-", "\N{MINUS SIGN}")


def label_position(ax: "Axes", size: tuple[float, float], unit: str | None) -> None:
    """Label the x and y axes in a unit that reads easily."""
    factor, shown = display_unit(max(size), unit)
    keep_style(ax)
    for axis, name in ((ax.xaxis, "x"), (ax.yaxis, "y")):
        axis.set_major_formatter(tick_formatter(factor))
        axis.set_label_text(with_unit(name, shown))


def add_colour_bar(
    image: "AxesImage", label: str, *, wide: bool, factor: float = 1.0, extend: str = "neither"
) -> "Colorbar":
    """Add a colour bar as high as the map (on top and as wide, for a wide map), without stealing room from its axes."""
    ax = image.axes
    bar_axes = ax.inset_axes((1.0, 0.0, 0.05, 1.0))
    bar_axes.set_axes_locator(_above(ax) if wide else _beside(ax))
    bar = ax.figure.colorbar(
        image,
        cax=bar_axes,
        label=label,
        extend=extend,
        orientation="horizontal" if wide else "vertical",
        ticklocation="top" if wide else "right",
        format=tick_formatter(factor),
    )
    keep_style(bar_axes)
    bar.outline.set_linewidth(0.5)  # pyright: ignore[reportCallIssue]
    return bar


def _beside(ax: "Axes", gap: float = 0.08, width: float = 0.12) -> Callable[..., Any]:
    """Place axes right of others; lengths in inches."""
    return _placed(ax, lambda box, inch: (box.x1 + gap * inch, box.y0, box.x1 + (gap + width) * inch, box.y1))


def _above(ax: "Axes", gap: float = 0.08, height: float = 0.12) -> Callable[..., Any]:
    """Place axes on top of others; lengths in inches."""
    return _placed(ax, lambda box, inch: (box.x0, box.y1 + gap * inch, box.x1, box.y1 + (gap + height) * inch))


def _placed(ax: "Axes", corners: Callable[..., tuple[float, float, float, float]]) -> Callable[..., Any]:
    transforms = require("matplotlib.transforms", "plot")

    def locate(_bar_axes: "Axes", _renderer: Any) -> Any:
        box = transforms.Bbox.from_extents(*corners(ax.bbox, ax.figure.dpi))
        return box.transformed(ax.figure.transSubfigure.inverted())

    return locate


def finish_logarithmic(ax: "Axes", *, x_factor: float = 1.0, y_factor: float = 1.0) -> None:
    """Open the frame of a log-log graph, write plain numbers at its ticks and draw a faint grid."""
    keep_style(ax)
    ax.spines[["top", "right"]].set_visible(False)
    ax.grid(which="major", color="0.9", linewidth=0.5)
    ax.set_axisbelow(True)
    _plain_ticks(ax.xaxis, ax.get_xlim(), x_factor)
    _plain_ticks(ax.yaxis, ax.get_ylim(), y_factor)


def _plain_ticks(axis: "Axis", limits: tuple[float, float], factor: float) -> None:
    """Write the decades, and where they are too few also what lies between."""
    ticker = require("matplotlib.ticker", "plot")
    low, high = sorted(limit * factor for limit in limits)
    locators = [ticker.LogLocator(subs=steps) for steps in _STEPS_OF_A_DECADE]
    shown = [sum(low <= tick <= high for tick in locator.tick_values(low, high)) for locator in locators]
    axis.set_major_locator(next((locator for locator, n in zip(locators, shown, strict=True) if n > 2), locators[-1]))
    axis.set_minor_formatter(ticker.NullFormatter())
    if low > 1e-4 and high < 1e6:
        axis.set_major_formatter(ticker.FuncFormatter(lambda value, _: grouped(value * factor)))


def grouped(value: float) -> str:
    """Return a number with its thousands set apart by thin spaces.

    >>> grouped(12000.0) == "12\N{THIN SPACE}000", grouped(0.05)
    (True, '0.05')
    """
    return f"{value:,.0f}".replace(",", "\N{THIN SPACE}") if value >= 10_000 else number(value)
