"""How far compression moved two parameters of a map: Sq and Sdq of ISO 25178-2."""

import numpy as np

from ..data import HeightMap


def heights_and_slopes(data: HeightMap) -> tuple[float, float]:
    """Sq, and Sdq by central differences, of the valid pixels; Sdq is NaN where no pixel has all four neighbours.

    >>> heights_and_slopes(HeightMap([[0.0, 1.0, 2.0]] * 3, spacing=2.0))
    (0.816496580927726, 0.5)
    """
    heights = data.heights.astype(np.float64)
    deviations = heights[data.valid] - heights[data.valid].mean()
    along_x = (heights[1:-1, 2:] - heights[1:-1, :-2]) / (2 * data.spacing[0])
    along_y = (heights[2:, 1:-1] - heights[:-2, 1:-1]) / (2 * data.spacing[1])
    squares = along_x**2 + along_y**2
    squares = squares[np.isfinite(squares)]
    slopes = float(np.sqrt(squares.mean())) if squares.size else float("nan")
    return float(np.sqrt(np.mean(deviations**2))), slopes


def drift(given: HeightMap, decoded: HeightMap) -> dict[str, float | None]:
    """Sq of the given map, and by what share of itself Sq and Sdq changed; `None` where the share means nothing.

    >>> drift(HeightMap([[0.0, 1.0]]), HeightMap([[0.0, 1.5]]))
    {'sq': 0.5, 'sq_drift': 0.5, 'sdq_drift': None}
    """
    before, after = heights_and_slopes(given), heights_and_slopes(decoded)
    shares = [b / a - 1 if a > 0 and np.isfinite(b) else None for a, b in zip(before, after, strict=True)]
    return {"sq": before[0], "sq_drift": shares[0], "sdq_drift": shares[1]}
