"""What a user should know about a tolerance: that it hardly shows the surface, follows the noise, or is stretched."""

import numpy as np
from jaxtyping import Float

_SPIKED = 3.0


def tolerance_cautions(
    tolerance: float,
    spread: float,
    noise: float,
    *,
    result: str,
    remedy: str,
    name: str = "tolerance",
    deviations: float = 1.0,
) -> list[str]:
    """Say what a tolerance means for a surface of some range and noise.

    **Arguments:**

    - `tolerance`, `spread`, `noise`: the tolerance, the range and the noise's standard deviation, in one unit.
    - `result`: what would hardly show the surface, or follow the noise; `remedy`: what to do against the latter.
    - `name`: what the tolerance is called.
    - `deviations`: how many standard deviations of the noise are still too few.

    >>> tolerance_cautions(3.0, 4.0, 1.0, result="the fit", remedy="relax it")
    ['the tolerance 3 is above half the range 4: the fit will hardly show the surface']
    """
    cautions = []
    if tolerance > spread / 2 > 0:
        cautions.append(
            f"the {name} {tolerance:.4g} is above half the range {spread:.4g}: {result} will hardly show the surface"
        )
    if 0 < tolerance < deviations * noise:
        times = "" if deviations == 1 else f"{deviations:g} times "
        cautions.append(
            f"the {name} {tolerance:.4g} is below {times}the estimated noise {noise:.4g}: {result} will follow the "
            f"noise; {remedy}"
        )
    return cautions


def robust_span(values: Float[np.ndarray, " m"]) -> float:
    """Length of the interval that holds the middle 99.8 % of some numbers.

    >>> robust_span(np.append(np.linspace(0, 1, 1000), 50.0)) < 1.1
    True
    """
    return float(np.ptp(np.quantile(values.astype(np.float64), [0.001, 0.999])))


def is_spiked(spread: float, span: float) -> bool:
    """Whether a range is stretched by few numbers beyond the span of the others.

    >>> is_spiked(50.0, 1.0)
    True
    """
    return spread > _SPIKED * span
