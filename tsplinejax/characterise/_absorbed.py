"""How much of the texture the form has taken for itself: an estimate.

A form of `edf` degrees of freedom follows whatever part of the texture looks like form, and that part is lost to any
method. What is left tells its size: split the texture into cosines over the parameter rectangle, p along s, q along t.
The form took those with p < P and q < Q, P Q = edf; were the texture's spectrum flat down there, each would have held
what the next ones above, up to 2P and 2Q, hold on average. So the share is

    a / (a + Sq²),    a = edf · (mean square of the cosines in that band).

Marks much finer than an element leave the band empty, so nothing is said to be lost; texture as coarse as an element is
reported as what it is: half form.
"""

import numpy as np
from jaxtyping import Float

_MOST = 200_000  # samples that are used


def absorbed_share(
    texture: Float[np.ndarray, " m"],
    parameters: Float[np.ndarray, "m 2"],
    weights: Float[np.ndarray, " m"],
    edf: float,
    aspect: float,
) -> float:
    """The share of the texture's mean square that the form has absorbed, from 0 to 1.

    **Arguments:**

    - `texture`: (m,), in any unit.
    - `parameters`: (m, 2).
    - `weights`: (m,), the area each sample stands for.
    - `edf`: the form's effective degrees of freedom.
    - `aspect`: the parameter rectangle's length along s over that along t.
    """
    keep = np.linspace(0, len(texture) - 1, min(len(texture), _MOST)).astype(int)
    texture, parameters, weights = texture[keep], parameters[keep], weights[keep] / weights[keep].sum()
    texture = texture - weights @ texture
    square = float(weights @ texture**2)
    P, Q = (max(1, round(float(np.sqrt(edf * ratio)))) for ratio in (aspect, 1 / aspect))
    along = np.cos(np.pi * parameters[:, :1] * np.arange(2 * P))
    across = np.cos(np.pi * parameters[:, 1:] * np.arange(2 * Q))
    products = along.T @ ((weights * texture)[:, None] * across)
    norms = (along**2).T @ (weights[:, None] * across**2)
    band = np.ones((2 * P, 2 * Q), bool)
    band[:P, :Q] = False
    absorbed = edf * float(np.mean((products**2 / norms)[band]))
    return absorbed / (absorbed + square) if square > 0 else 0.0
