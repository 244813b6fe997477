"""A drawn history of refinements, bisected again step by step from a start whose local knots are at hand."""

import numpy as np

from tsplinejax.mesh import Refinement, TMesh, bisect, forest_from_boxes


def replay(history: tuple[TMesh, ...]) -> list[tuple[TMesh, Refinement]]:
    """Each mesh and its refinement; every step carries on from the traces of the step before."""
    tmesh, steps = history[0], []
    assert len(tmesh.local_knots) == tmesh.n_anchors
    for finer in history[1:]:
        holder = finer.locate(tmesh.boxes[:, 0], tmesh.boxes[:, 1])
        step = bisect(tmesh, finer.levels[holder] > tmesh.levels)
        np.testing.assert_array_equal(step.mesh.boxes, finer.boxes)
        steps.append((tmesh, step))
        tmesh = step.mesh
    return steps


def seen_first(tmesh: TMesh) -> TMesh:
    """The same mesh without a memory of the one before."""
    forest = tmesh.forest
    return forest_from_boxes(tmesh.boxes, forest.lattice, first_cut=forest.first_cut, border=tmesh.border)
