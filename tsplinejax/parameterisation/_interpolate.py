"""Carry parameters from some points of a surface to others near them: (s, t) vary smoothly along it."""

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree  # pyright: ignore[reportAttributeAccessIssue] -- compiled, without annotations

_NEAREST = 12
_CHUNK = 1 << 16
_RIDGE = 1e-6


def interpolated(
    known: Float[np.ndarray, "m 3"], parameters: Float[np.ndarray, "m 2"], points: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 2"]:
    """Return parameters of further points: a plane through those of the twelve nearest known ones, clipped to [0, 1]².

    >>> square = np.array([[0.0, 0, 0], [2, 0, 0], [0, 1, 0], [2, 1, 0]])
    >>> interpolated(square, square[:, :2] / [2, 1], np.array([[0.5, 0.25, 0.0]])).round(4)
    array([[0.25, 0.25]])
    """
    tree = cKDTree(known)
    parts = np.split(points, np.arange(_CHUNK, len(points), _CHUNK))
    return np.concatenate([_part(tree, known, parameters, part) for part in parts])


def _part(tree: cKDTree, known: np.ndarray, parameters: np.ndarray, points: np.ndarray) -> np.ndarray:
    distance, near = tree.query(points, min(_NEAREST, len(known)))
    weight = 1.0 / (distance + 1e-3 * distance[:, -1:] + 1e-300) ** 2
    weight = (weight / weight.sum(axis=1, keepdims=True))[:, :, None]
    places, values = known[near], parameters[near]
    middle, mean = (weight * places).sum(axis=1, keepdims=True), (weight * values).sum(axis=1, keepdims=True)
    offsets = places - middle
    weighted = np.swapaxes(weight * offsets, 1, 2)
    moments = weighted @ offsets
    # Off the tangent plane nothing is known: the ridge keeps the slope there at 0.
    moments += (_RIDGE * np.trace(moments, axis1=1, axis2=2) + 1e-300)[:, None, None] * np.eye(3)
    slopes = np.linalg.solve(moments, weighted @ (values - mean))
    return np.clip((mean + (points[:, None] - middle) @ slopes)[:, 0], 0.0, 1.0)
