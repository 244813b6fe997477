"""The height step of data that were rounded to counts."""

import numpy as np
from jaxtyping import Float

_ENOUGH = 200_000
_FEWEST_LEVELS = 6


def height_step(values: Float[np.ndarray, " m"]) -> float:
    """Return the step q when heights are whole multiples of it (plus an offset), else 0.

    Distinct heights of rounded data lie on a lattice, most of whose levels are used in the bulk of the data. At least
    six levels are asked for: two plateaus are no sign of rounding. The rounding of the number format is not reported.

    **Arguments:**

    - `values`: (m,) finite heights; of more than 200 000 an evenly spread part is looked at.

    >>> x = np.linspace(0.0, 1.0, 500)
    >>> round(height_step(np.round(np.sin(3 * x) / 0.01) * 0.01), 12)
    0.01
    >>> height_step(np.sin(3 * x))
    0.0
    """
    values = np.asarray(values)[:: max(1, len(values) // _ENOUGH)]
    if values.size < 4 * _FEWEST_LEVELS:
        return 0.0
    low, high = np.quantile(values, [0.01, 0.99])
    levels, counts = np.unique(values[(values >= low) & (values <= high)], return_counts=True)
    ulp = 4.0 * float(np.finfo(values.dtype).eps) * float(np.abs(values).max())
    gaps = np.diff(levels.astype(np.float64))
    gaps = gaps[gaps > ulp]
    if len(gaps) + 1 < _FEWEST_LEVELS or 2 * len(gaps) > counts.sum():
        return 0.0
    return _lattice_step(gaps, ulp)


def _lattice_step(gaps: Float[np.ndarray, " n"], ulp: float) -> float:
    """The step of which all gaps are whole multiples, 0 if there is none or few of its levels are used."""
    step = float(np.quantile(gaps, 0.02))
    if step < 4.0 * ulp:
        return 0.0
    multiples = np.round(gaps / step)
    small = (multiples >= 1) & (multiples <= 8)
    step = float(np.mean(gaps[small] / multiples[small])) if small.any() else step
    multiples = np.round(gaps / step)
    off = np.abs(gaps / step - multiples) > 0.05 + 2.0 * ulp / step
    used = (len(gaps) + 1) / (multiples.sum() + 1)
    return step if off.mean() < 0.02 and used > 0.2 else 0.0
