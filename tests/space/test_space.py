"""Spline spaces: partition of unity, independence, nesting, and a space that remembers its mesh."""

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings

from tsplinejax import InputError
from tsplinejax.mesh import AnalysisSuitable, Dyadic, b_lattice, is_analysis_suitable, refine
from tsplinejax.space import SplineSpace, bezier_elements, capacity_for, gram, pad, resolve_dtype, spline_space

from ..random_meshes import hand_given, meshes


def sums(space: SplineSpace) -> np.ndarray:
    """Bézier points of the sum of all blending functions on the real elements."""
    count = int(space.n_elements)
    along = (np.asarray(part)[:count] for part in (space.tables.along_s, space.tables.along_t))
    return np.einsum("eka,ekb->eab", *along)


def gram_matrix(space: SplineSpace) -> np.ndarray:
    """∫ b_i b_j over the square, exact, (n, n)."""
    mass, count, n = gram(0), int(space.n_elements), int(space.n_functions)
    matrix = np.zeros((n, n))
    functions, size = np.asarray(space.tables.functions)[:count], np.asarray(space.tables.size)[:count]
    s, t = (
        np.einsum("eka,ab,elb->ekl", part, mass, part)
        for part in (np.asarray(space.tables.along_s)[:count], np.asarray(space.tables.along_t)[:count])
    )
    np.add.at(matrix, (functions[:, :, None], functions[:, None]), s * t * size.prod(axis=1)[:, None, None])
    return matrix


def least_eigenvalue(matrix: np.ndarray) -> float:
    """Of the matrix scaled to a unit diagonal."""
    scale = 1 / np.sqrt(np.diagonal(matrix))
    return float(np.linalg.eigvalsh(matrix * scale * scale[:, None])[0])


@given(meshes())
def test_partition_of_unity(tmesh):
    """With the closure the blending functions sum to one everywhere, so the space is polynomial."""
    space = spline_space(tmesh)
    assert not space.rational
    np.testing.assert_allclose(sums(space), 1, atol=1e-12)


@settings(max_examples=40)
@given(meshes(most=100))
def test_linear_independence(tmesh):
    """With the closure no combination of blending functions vanishes: the Gram matrix has full rank, by a margin."""
    assert least_eigenvalue(gram_matrix(spline_space(tmesh))) > 1e-7


@given(hand_given())
def test_suitable_meshes_by_hand(tmesh):
    """Whatever mesh the checker passes sums to one; whatever does not sum to one it does not pass."""
    space = spline_space(tmesh)
    if is_analysis_suitable(tmesh):
        assert not space.rational
        np.testing.assert_allclose(sums(space), 1, atol=1e-12)
        assert least_eigenvalue(gram_matrix(space)) > 1e-9


@given(meshes(Dyadic()))
def test_dyadic_meshes(tmesh):
    """Without closure the checker's pass still means partition of unity, and sums stay above zero for the division."""
    space = spline_space(tmesh)
    assert sums(space).min() > 0
    if is_analysis_suitable(tmesh):
        np.testing.assert_allclose(sums(space), 1, atol=1e-12)


def test_the_closure_is_needed():
    """Random dyadic refinements without closure lose partition of unity, with it they keep it."""
    lost = 0
    for seed in range(12):
        for rule in (Dyadic(), AnalysisSuitable()):
            generator, tmesh = np.random.default_rng(seed), b_lattice(4, 4)
            for _ in range(3):
                marked = generator.random(tmesh.n_elements) < 0.3
                tmesh = refine(tmesh, marked, rule).mesh
            rational = spline_space(tmesh).rational
            assert not (rational and isinstance(rule, AnalysisSuitable))
            lost += rational
    assert lost >= 9


@given(meshes(Dyadic()))
def test_the_space_remembers_its_mesh(tmesh):
    """The T-mesh rebuilt from a space has the elements, anchors and local knots that the space was made from."""
    again = spline_space(tmesh, rational=True).mesh
    np.testing.assert_array_equal(again.boxes, tmesh.boxes)
    np.testing.assert_array_equal(again.anchors, tmesh.anchors)
    np.testing.assert_array_equal(again.local_knots, tmesh.local_knots)
    assert (again.border, again.forest.first_cut) == (tmesh.border, tmesh.forest.first_cut)


@given(hand_given())
def test_the_space_remembers_meshes_by_hand(tmesh):
    """So it does for rectangles given by hand, to the last bit of their knots."""
    again = spline_space(tmesh, rational=True).mesh
    np.testing.assert_array_equal(again.element_boxes, tmesh.element_boxes)
    np.testing.assert_array_equal(again.local_knots, tmesh.local_knots)
    assert again.border == tmesh.border


def test_padding_changes_nothing():
    """A larger capacity appends rows and leaves the others as they are."""
    tmesh = b_lattice(3, 3)
    small, large = spline_space(tmesh), spline_space(tmesh, capacity=1024)
    for name in ("functions", "along_s", "along_t", "corner", "size"):
        a, b = np.asarray(getattr(small.tables, name)), np.asarray(getattr(large.tables, name))
        assert len(b) == 1024
        np.testing.assert_array_equal(a[:9], b[:9])
    assert not np.asarray(large.tables.along_s)[9:].any()


def test_known_elements_are_used():
    """Elements that the caller has found already give the same space."""
    tmesh = b_lattice(3, 2)
    again = spline_space(tmesh, elements=bezier_elements(tmesh))
    np.testing.assert_array_equal(again.tables.along_s, spline_space(tmesh).tables.along_s)


def test_capacities_grow_fourfold():
    """The least capacity that fits, so that a growing mesh meets few sizes."""
    assert [capacity_for(n) for n in (1, 256, 257, 1024, 1025)] == [256, 256, 1024, 1024, 4096]
    assert capacity_for(5000, 1024) == 16384
    with pytest.raises(InputError, match="capacity"):
        spline_space(b_lattice(20, 20), capacity=128)


def test_pad_appends():
    """Rows of a constant follow the array's own."""
    np.testing.assert_array_equal(pad(np.array([[1, 2]]), 3, np.array([7, 8])), [[1, 2], [7, 8], [7, 8]])


def test_precision(dtype):
    """A space holds what it was asked for, and only real numbers of the two precisions."""
    space = spline_space(b_lattice(2, 2), dtype=dtype)
    assert space.dtype == dtype
    np.testing.assert_allclose(sums(space), 1, atol=2e-6 if dtype == np.float32 else 1e-14)
    assert resolve_dtype(None) == np.float64
    for bad in ("int32", "complex128", "float16", "double-double"):
        with pytest.raises(InputError, match="float32 or float64"):
            spline_space(b_lattice(2, 2), dtype=bad)


def test_double_precision_needs_x64():
    """With JAX's 64-bit mode off, float64 is refused with the line that fixes it, and the default is float32."""
    code = """
import numpy as np, tsplinejax as tsj
assert tsj.spline_space(tsj.b_lattice(2, 2)).dtype == np.float32
try:
    tsj.spline_space(tsj.b_lattice(2, 2), dtype="float64")
except tsj.InputError as error:
    assert "jax_enable_x64" in str(error) and "float32" in str(error)
else:
    raise SystemExit(1)
"""
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_space_is_a_pytree():
    """Spaces pass through jit as arguments; two meshes of one capacity share a trace."""
    traces = 0

    @jax.jit
    def total(space: SplineSpace) -> jax.Array:
        nonlocal traces
        traces += 1
        return jnp.sum(space.tables.along_s)

    for rows in (2, 3, 4):
        assert np.isfinite(total(spline_space(b_lattice(3, rows))))
    assert traces == 1
    assert "polynomial" in repr(spline_space(b_lattice(1, 1)))
