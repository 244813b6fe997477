"""What fills holes: a strategy that sees a map once, and then one window after the other."""

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

#: From a window's heights, missing ones NaN, the window's place in the map and what is wanted, the wanted heights.
Predict = Callable[["Window"], Float[np.ndarray, " wanted"]]


@dataclass(frozen=True, eq=False)
class Field:
    """A map on its way to be filled.

    **Attributes:**

    - `heights`: NaN where unknown.
    - `sides`: (dx, dy) of a pixel in units of √(dx dy).
    - `scale`: a robust measure of the range of the heights.
    - `low`, `high`: what filled heights may be, infinite where that is free.
    """

    heights: Float[np.ndarray, "rows columns"]
    sides: tuple[float, float]
    scale: float
    low: Float[np.ndarray, "rows columns"] | None = None
    high: Float[np.ndarray, "rows columns"] | None = None


@dataclass(frozen=True, eq=False)
class Window:
    """A part of a field that a filler works on.

    **Attributes:**

    - `rows`, `columns`: where it lies in the field.
    - `wanted`: which of its pixels are to be filled.
    """

    rows: slice
    columns: slice
    wanted: Bool[np.ndarray, "height width"]


class AbstractFiller:
    """Predicts missing heights from those around them."""

    @abstractmethod
    def prepare(self, field: Field) -> Predict:
        """Look at the whole field once; the function returned fills one window."""

    @property
    @abstractmethod
    def name(self) -> str:
        """What reports call it."""

    @property
    @abstractmethod
    def margin(self) -> int:
        """How many pixels around a hole it looks at."""
