"""What a reader of one format hands over: the file's own numbers, before any option is applied."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class RawMap:
    """Heights in rows and columns as they stand in a file; `None` where the file says nothing.

    `unit` is the unit of the spacing and of the heights alike; `filled` marks heights that were not measured.
    """

    heights: np.ndarray
    spacing: tuple[float, float] | None = None
    unit: str | None = None
    origin: tuple[float, float] = (0.0, 0.0)
    notes: tuple[str, ...] = ()
    filled: np.ndarray | None = None


@dataclass(frozen=True)
class RawCloud:
    """Points (m, 3) as they stand in a file, with triangles if it has any."""

    points: np.ndarray
    unit: str | None = None
    triangles: np.ndarray | None = None
    notes: tuple[str, ...] = ()
