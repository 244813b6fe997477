"""Errors against control points, step by step."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .._errors import InputError
from ._style import ACCENT, INK, QUIET, display_unit, finish_logarithmic, new_figure, print_style, with_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot_convergence(result_or_history: Any, ax: "Axes | None" = None) -> "Axes":
    """Draw the largest and the rms error of every step against its control points, with the tolerance.

    Where the tolerance falls in stages, the stages are drawn as steps.

    **Arguments:**

    - `result_or_history`: a `FitResult`, or its history.
    - `ax`: the axes to draw on; a new figure's if not given.

    **Returns:** the axes, both logarithmic.

    **Raises:** `MissingExtraError` without matplotlib; `InputError` for an empty history.
    """
    history: Sequence[Any] = getattr(result_or_history, "history", result_or_history)
    if not history:
        raise InputError("a convergence plot needs at least one step, but the history is empty")
    unit = getattr(result_or_history, "unit", None)
    final = getattr(result_or_history, "tolerance", history[-1].tolerance)
    control_points = [step.control_points for step in history]
    factor, shown = display_unit(history[-1].max_error, unit)
    with print_style(ax):
        ax = new_figure(4.6, 3.4).add_subplot() if ax is None else ax
        _draw_tolerance(ax, history, final)
        for name, label, colour, marker in (
            ("rms_error", "rms error", INK, "s"),
            ("max_error", "largest error", ACCENT, "o"),
        ):
            errors = [getattr(step, name) or np.nan for step in history]
            ax.plot(
                control_points, errors, marker=marker, color=colour, label=label, markersize=4, markeredgecolor="white"
            )
        ax.set(xscale="log", yscale="log", xlabel="control points", ylabel=with_unit("error", shown))
        finish_logarithmic(ax, y_factor=factor)
        lines, labels = ax.get_legend_handles_labels()
        ax.legend(lines[::-1], labels[::-1], loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    return ax


def _draw_tolerance(ax: "Axes", history: Sequence[Any], final: float | None) -> None:
    """Draw the stages as steps and the tolerance asked for as a line."""
    stages = [step.tolerance for step in history]
    if None not in stages and len(set(stages)) > 1:
        control_points = [step.control_points for step in history]
        ax.step(
            control_points,
            stages,
            where="post",
            color=QUIET,
            linewidth=0.8,
            linestyle=":",
            label="tolerance of the stage",
        )
    if final is not None:
        ax.axhline(final, color="black", linewidth=0.8, linestyle="--", label=r"tolerance $\varepsilon$")
