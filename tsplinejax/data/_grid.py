"""What the synthetic height maps share: coordinates of their pixels, their pose, bumps summed, and noise.

Every synthetic map is a formula over the unit square, u down the rows (t) and v along the columns (s); a resolution
only samples it. A pose moves the formula below the square: pixels see it at R (p - c) + c + shift, c being the middle.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .._errors import InputError
from ._height_map import HeightMap


@dataclass(frozen=True)
class Pose:
    """A shift (along s, along t) in parts of the square, and a rotation about its middle in radians.

    >>> Pose(shift=(0.25, 0.0)).seen_at(np.array([[0.5]]), np.array([[0.5]]))
    (array([[0.5]]), array([[0.75]]))
    """

    shift: tuple[float, float] = (0.0, 0.0)
    rotation: float = 0.0

    def seen_at(self, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return where in the formula the positions (u, v) of the square lie; exact when nothing is moved."""
        if self.rotation:
            cosine, sine = math.cos(self.rotation), math.sin(self.rotation)
            u, v = 0.5 + cosine * (u - 0.5) - sine * (v - 0.5), 0.5 + sine * (u - 0.5) + cosine * (v - 0.5)
        return u + self.shift[1], v + self.shift[0]

    def place_of(self, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return where in the square the positions (u, v) of the formula appear: the inverse of `seen_at`."""
        u, v = u - self.shift[1], v - self.shift[0]
        return Pose(rotation=-self.rotation).seen_at(u, v)


@dataclass(frozen=True)
class PixelGrid:
    """The pixels of a map over the unit square: corner to corner, or centred in cells.

    >>> PixelGrid((2, 3)).v
    array([[0. , 0.5, 1. ]])
    """

    shape: tuple[int, int]
    cell_centred: bool = False

    def __post_init__(self) -> None:
        try:
            rows, columns = (int(count) for count in self.shape)
        except (TypeError, ValueError) as error:
            raise InputError(f"a shape is (rows, columns), but got {self.shape!r}") from error
        if rows < 2 or columns < 2 or (rows, columns) != tuple(self.shape):
            raise InputError(f"a synthetic map needs at least 2 × 2 whole pixels, but got the shape {self.shape}")
        object.__setattr__(self, "shape", (rows, columns))

    @property
    def u(self) -> Float[np.ndarray, "rows 1"]:
        """Positions down the rows, t."""
        return self._along(self.shape[0])[:, np.newaxis]

    @property
    def v(self) -> Float[np.ndarray, "1 columns"]:
        """Positions along the columns, s."""
        return self._along(self.shape[1])[np.newaxis, :]

    def _along(self, count: int) -> np.ndarray:
        return (np.arange(count) + 0.5) / count if self.cell_centred else np.arange(count) / (count - 1.0)

    def height_map(self, heights: np.ndarray, name: str, noise: float, noise_seed: int) -> HeightMap:
        """Return the map, with Gaussian noise of `noise` times its range added."""
        if not (math.isfinite(noise) and noise >= 0):
            raise InputError(f"noise is a standard deviation relative to the range, not negative, but got {noise}")
        if noise:
            generator = np.random.default_rng(noise_seed)
            heights = heights + generator.normal(0.0, noise * np.ptp(heights), heights.shape)
        u, v = self.u[:2, 0], self.v[0, :2]
        return HeightMap(
            heights,
            (float(v[1] - v[0]), float(u[1] - u[0])),
            origin=(float(v[0]), float(u[0])),
            provenance={"name": name, "operations": [] if not noise else [f"noise {noise:g} of the range"]},
        )


def add_bumps(
    heights: np.ndarray,
    grid: PixelGrid,
    centres: Iterable[tuple[float, float, float]],
    bump: Callable[[int, np.ndarray, np.ndarray], np.ndarray],
) -> None:
    """Add bumps to a map, each within its own window only.

    **Arguments:**

    - `heights`: (rows, columns), changed in place.
    - `centres`: (u, v, reach) of each bump; beyond its reach it is negligible.
    - `bump`: from the bump's number and the offsets (rows, 1) and (1, columns) from its centre to heights.
    """
    u, v = grid.u[:, 0], grid.v[0]
    for number, (centre_u, centre_v, reach) in enumerate(centres):
        rows = slice(*np.searchsorted(u, [centre_u - reach, centre_u + reach]))
        columns = slice(*np.searchsorted(v, [centre_v - reach, centre_v + reach]))
        window = heights[rows, columns]
        if window.size:
            window += bump(number, u[rows, np.newaxis] - centre_u, v[np.newaxis, columns] - centre_v)
