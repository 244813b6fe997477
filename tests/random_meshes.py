"""Random T-meshes for hypothesis: small lattices, both first cuts, both borders, and refinements of several kinds."""

from functools import partial

import hypothesis.strategies as st
import numpy as np

from tsplinejax.mesh import AbstractRefinement, AnalysisSuitable, TMesh, b_lattice, from_rectangles, refine

MOST_ELEMENTS = 250


def marks_at_points(tmesh: TMesh, points: np.ndarray) -> np.ndarray:
    """One boolean an element: whether its half-open box holds one of the points in [0, 1)²."""
    s, t = np.asarray(points).T[:, :, None]
    s0, t0, s1, t1 = tmesh.element_boxes.T
    return ((s0 <= s) & (s < s1) & (t0 <= t) & (t < t1)).any(axis=0)


def _diagonal(tmesh: TMesh) -> np.ndarray:
    """Elements that the line s = t runs through."""
    s0, t0, s1, t1 = tmesh.element_boxes.T
    return (s0 < t1) & (t0 < s1)


@st.composite
def _marks(draw: st.DrawFn, tmesh: TMesh) -> np.ndarray:
    """A set of elements to bisect: those at points, along the diagonal, a single one, or a random share."""
    kind = draw(st.sampled_from(["points", "diagonal", "single", "share"]))
    if kind == "diagonal":
        return _diagonal(tmesh)
    if kind == "single":
        return np.arange(tmesh.n_elements) == draw(st.integers(0, tmesh.n_elements - 1))
    if kind == "share":
        generator = np.random.default_rng(draw(st.integers(0, 999)))
        return generator.random(tmesh.n_elements) < draw(st.sampled_from([0.1, 0.3, 0.6]))
    coordinate = st.integers(0, 999).map(lambda k: k / 1000)
    return marks_at_points(tmesh, np.array(draw(st.lists(st.tuples(coordinate, coordinate), min_size=1, max_size=3))))


@st.composite
def lattices(draw: st.DrawFn, columns: int = 6, rows: int = 4) -> TMesh:
    """B-lattices from 1 × 1, either direction cut first, either border."""
    return b_lattice(
        draw(st.integers(1, columns)),
        draw(st.integers(1, rows)),
        first_cut=draw(st.sampled_from(["s", "t"])),
        border=draw(st.sampled_from(["clamped", "open"])),
    )


@st.composite
def refinements(
    draw: st.DrawFn, rule: AbstractRefinement | None = None, steps: int = 5, most: int = MOST_ELEMENTS
) -> tuple[TMesh, ...]:
    """A lattice and its successive refinements, analysis-suitable unless another rule is given."""
    meshes = [draw(lattices())]
    for _ in range(draw(st.integers(0, steps))):
        refined = refine(meshes[-1], draw(_marks(meshes[-1])), rule or AnalysisSuitable()).mesh
        if refined.n_elements > most:
            break
        meshes.append(refined)
    return tuple(meshes)


@st.composite
def marked_meshes(draw: st.DrawFn, rule: AbstractRefinement | None = None) -> tuple[TMesh, np.ndarray]:
    """A T-mesh and a set of its elements."""
    tmesh = draw(meshes(rule))
    return tmesh, draw(_marks(tmesh))


def meshes(rule: AbstractRefinement | None = None, **limits: int) -> st.SearchStrategy[TMesh]:
    """The last of such refinements."""
    return refinements(rule, **limits).map(lambda history: history[-1])


def _split(rectangle: tuple[float, ...], axis: int, share: float) -> list[tuple[float, ...]]:
    """A rectangle cut in two across an axis, at a share of its side."""
    s0, t0, s1, t1 = rectangle
    if axis == 0:
        cut = s0 + share * (s1 - s0)
        return [(s0, t0, cut, t1), (cut, t0, s1, t1)]
    cut = t0 + share * (t1 - t0)
    return [(s0, t0, s1, cut), (s0, cut, s1, t1)]


@st.composite
def rectangles(draw: st.DrawFn, cuts: int = 8) -> np.ndarray:
    """Rectangles that tile the unit square, cut one after the other at uneven places: T-junctions of every kind."""
    pieces = [(0.0, 0.0, 1.0, 1.0)]
    for _ in range(draw(st.integers(0, cuts))):
        chosen = pieces.pop(draw(st.integers(0, len(pieces) - 1)))
        pieces += _split(chosen, draw(st.integers(0, 1)), draw(st.sampled_from([0.25, 0.5, 0.625])))
    return np.array(pieces)


@st.composite
def hand_given(draw: st.DrawFn, cuts: int = 8) -> TMesh:
    """A T-mesh given by hand, either border."""
    return from_rectangles(draw(rectangles(cuts)), border=draw(st.sampled_from(["clamped", "open"])))


def _parameters(seed: int, count: int) -> np.ndarray:
    generator = np.random.default_rng(seed)
    places = generator.random((count, 2))
    # Domain ends and dyadic knot lines are where an element is easily lost or met twice.
    lines = generator.integers(0, 9, (count // 4, 2)) / 8
    corners = np.array([[0, 0], [1, 0], [0, 1], [1, 1]], float)
    return np.concatenate([places, lines, corners])


def parameters(count: int = 60) -> st.SearchStrategy[np.ndarray]:
    """Parameters in [0, 1]²: random ones, some on knot lines, and the corners; always the same number."""
    return st.integers(0, 9999).map(partial(_parameters, count=count))
