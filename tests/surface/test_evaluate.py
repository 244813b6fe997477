"""Evaluation of many parameters: chunks, padding, compilations and transformations change no value."""

from collections.abc import Callable, Iterator

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tsplinejax import Frame, InputError, TSpline
from tsplinejax.mesh import AbstractRefinement, Dyadic, TMesh, b_lattice, refine
from tsplinejax.space import spline_space
from tsplinejax.surface import _evaluate, make_surface

from ..blending import blending
from ..random_meshes import marks_at_points

COMPILED = "/jax/core/compile/backend_compile_duration"
FRAME = Frame((10.0, -3.0), (6.0, 2.0), "mm")
INSIDE = np.random.default_rng(1).uniform(0.01, 0.99, (400, 2))
MANY = np.random.default_rng(2).uniform(0.01, 0.99, (2 * _evaluate.CHUNK + 77, 2))


def refined(rule: AbstractRefinement | None = None, steps: int = 4, seed: int = 3) -> TMesh:
    """A 3 × 2 lattice after a few random refinements."""
    generator, tmesh = np.random.default_rng(seed), b_lattice(3, 2)
    for _ in range(steps):
        tmesh = refine(tmesh, generator.random(tmesh.n_elements) < 0.3, rule).mesh
    return tmesh


POLYNOMIAL = refined()
RATIONAL = refined(Dyadic())
BOTH = pytest.mark.parametrize("tmesh", [POLYNOMIAL, RATIONAL], ids=["polynomial", "rational"])


def random_surface(tmesh: TMesh, dimension: int = 1, dtype: str | np.dtype = "float64") -> TSpline:
    """A surface with normal control points."""
    shape = (tmesh.n_anchors,) if dimension == 1 else (tmesh.n_anchors, dimension)
    return make_surface(spline_space(tmesh, dtype=dtype), np.random.default_rng(0).normal(size=shape), FRAME)


@pytest.fixture
def compilations() -> Iterator[list[str]]:
    """A list that grows with every compilation of the backend."""
    events: list[str] = []

    def listen(event: str, duration: float, **details: object) -> None:
        if event == COMPILED:
            events.append(str(details.get("fun_name", event)))

    jax.monitoring.register_event_duration_secs_listener(listen)
    yield events
    jax.monitoring.unregister_event_duration_listener(listen)


@BOTH
@pytest.mark.parametrize("dimension", [1, 3])
def test_chunks(tmesh, dimension, dtype, tolerance_of):
    """More parameters than a chunk holds: each value is that of the definition, the padded tail included."""
    surface = random_surface(tmesh, dimension, dtype)
    values = np.asarray(surface(MANY))
    assert values.dtype == dtype
    assert values.shape == ((len(MANY),) if dimension == 1 else (len(MANY), 3))
    ends = np.r_[:50, _evaluate.CHUNK - 50 : _evaluate.CHUNK + 50, len(MANY) - 50 : len(MANY), 50 : len(MANY) : 999]
    basis = blending(tmesh, MANY[ends])
    expected = (basis / basis.sum(axis=1, keepdims=True)) @ np.asarray(surface.control_points, np.float64)
    np.testing.assert_allclose(values[ends], expected, atol=10 * tolerance_of(dtype))


@BOTH
@pytest.mark.parametrize("order", [(0, 0), (1, 0), (1, 2)])
def test_compiled_by_the_caller_or_by_us(tmesh, order):
    """One expression inside the caller's jit has the values of the padded kernels, for few and for many parameters."""
    surface = random_surface(tmesh, 3)
    whole = eqx.filter_jit(lambda surface, places: surface.derivative(places, order))
    for places in (INSIDE[:7], INSIDE):
        ours = np.asarray(surface.derivative(places, order))
        scale = 1e-12 * (1 + np.abs(ours).max())
        np.testing.assert_allclose(whole(surface, jnp.asarray(places)), ours, atol=scale)


def test_other_numbers_compile_nothing(compilations):
    """Other numbers of parameters and of control points, other lattices and depths: kernels are there already."""
    tmesh = b_lattice(4, 3)
    random_surface(tmesh)(INSIDE)
    random_surface(tmesh)(MANY)
    random_surface(tmesh).at(*INSIDE.T)
    deep = b_lattice(2, 2)
    for _ in range(9):
        deep = refine(deep, marks_at_points(deep, np.array([[0.3, 0.7]]))).mesh
    others = [random_surface(other) for other in (POLYNOMIAL, b_lattice(5, 5), deep)]
    assert len({surface.space.capacity for surface in others}) == 1
    compilations.clear()
    for surface in others:
        for places in (INSIDE, INSIDE[:300], MANY, MANY[: 2 * _evaluate.CHUNK + 300]):
            surface(places)
        surface.at(*INSIDE[:390].T)
        surface.at(*INSIDE[:300].T.reshape(2, 20, 15))
    assert not compilations


@BOTH
def test_gradients_at_many_parameters(tmesh):
    """Derivatives in control points are the blending functions, those in parameters the surface's own."""
    inside = INSIDE[:100]  # few enough for a quick Jacobian, enough for all Bézier points to be made first
    surface, places = random_surface(tmesh), jnp.asarray(inside)
    assert 4 * len(inside) >= surface.space.capacity

    def heights(points: jax.Array, places: jax.Array = places) -> jax.Array:
        return make_surface(surface.space, points)(places)

    basis = blending(tmesh, inside)
    basis = basis / basis.sum(axis=1, keepdims=True)
    for transform in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(transform(heights)(surface.control_points), basis, atol=1e-12)
    gradient = jax.grad(lambda places: jnp.sum(heights(surface.control_points, places)))(places)
    exact = np.stack([surface.derivative(inside, order) for order in ((1, 0), (0, 1))], axis=-1)
    np.testing.assert_allclose(gradient, exact, atol=1e-12 * np.abs(exact).max())
    batch = jax.vmap(heights)(jnp.stack([surface.control_points, -surface.control_points]))
    np.testing.assert_allclose(batch[1], -np.asarray(surface(inside)), atol=1e-13)


@pytest.mark.parametrize("transform", [jax.jit, jax.grad, jax.vmap])
def test_known_parameters_inside_a_transformation(transform):
    """A surface evaluated at known parameters within somebody's transformation is a constant there."""
    surface = random_surface(POLYNOMIAL)

    def scaled(factor: jax.Array) -> jax.Array:
        return factor * jnp.sum(surface(INSIDE))

    expected = np.asarray(surface(INSIDE)).sum() * (1 if transform is jax.grad else 2)
    factor = jnp.full((3,), 2.0) if transform is jax.vmap else jnp.asarray(2.0)
    np.testing.assert_allclose(transform(scaled)(factor), expected, rtol=1e-12)


def places_of(surface: TSpline, places: np.ndarray) -> list[np.ndarray]:
    """Places in the frame."""
    (x0, y0), (width, height) = surface.frame.origin, surface.frame.extent
    return [x0 + width * places[:, 0], y0 + height * places[:, 1]]


CALLS: list[Callable[[TSpline, np.ndarray], jax.Array]] = [
    lambda surface, places: surface(places),
    lambda surface, places: surface(jnp.asarray(places)),
    lambda surface, places: surface.at(*places_of(surface, places)),
    lambda surface, places: surface.at(*map(jnp.asarray, places_of(surface, places))),
]


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("places", [INSIDE[:7], INSIDE, MANY], ids=["few", "some", "many"])
def test_arrays_that_stay_on_an_accelerator(monkeypatch, call, places):
    """Where memory is not the host's, one pass without chunks gives the same values, and refuses the same."""
    surface = random_surface(POLYNOMIAL)
    expected = np.asarray(call(surface, places))
    for module in (_evaluate, pytest.importorskip("tsplinejax.surface._tspline")):
        monkeypatch.setattr(module, "on_host", lambda space: False)
    np.testing.assert_allclose(call(surface, places), expected, atol=1e-13)
    for bad, reason in ((np.nan, "NaN"), (1.5, r"received 1\.5")):
        wrong = np.append(places, [[0.5, bad]], axis=0)
        for array in (wrong, jnp.asarray(wrong)):
            with pytest.raises(InputError, match=reason):
                surface(array)


@pytest.mark.parametrize("where", [0, _evaluate.CHUNK, len(MANY) - 1])
def test_one_bad_parameter_among_many(where):
    """A single NaN or a parameter beyond the domain is found in any chunk, and the message says which it was."""
    surface = random_surface(POLYNOMIAL)
    for bad, reason in ((np.nan, "received NaN; leave missing places out"), (-0.25, r"received -0\.25; clip")):
        places = MANY.copy()
        places[where, 1] = bad
        with pytest.raises(InputError, match=reason):
            surface(places)


@pytest.mark.parametrize("bad", [[["a", "b"]], [[0.5, 0.5j]], [[0.1, 0.2], [0.3]], None])
def test_what_is_no_number(bad):
    """Parameters and places are real numbers in rows of one length."""
    surface = random_surface(POLYNOMIAL)
    with pytest.raises(InputError, match="real numbers"):
        surface(bad)
    with pytest.raises(InputError, match="real numbers"):
        surface.at(bad, 0.0)


@pytest.mark.parametrize("numbers", [np.asarray, jnp.asarray])
def test_places_that_do_not_broadcast(numbers):
    """Unequal shapes of x and y are misuse of ours, with the remedy, eagerly and inside jit."""
    surface = random_surface(POLYNOMIAL)
    x, y = numbers(np.full(3, 12.0)), numbers(np.full(4, -2.0))
    for at in (surface.at, jax.jit(lambda x, y: surface.at(x, y))):
        with pytest.raises(InputError, match=r"\(3,\) and \(4,\); for all pairs"):
            at(x, y)
    assert surface.at(x[None, :], y[:, None]).shape == (4, 3)


def test_places_under_transformations():
    """`at` passes through jit, and its derivative in x is the slope in the frame's unit."""
    surface = random_surface(POLYNOMIAL)
    x, y = map(jnp.asarray, places_of(surface, INSIDE))
    np.testing.assert_allclose(jax.jit(lambda x, y: surface.at(x, y))(x, y), surface(INSIDE), atol=1e-12)
    slope = jax.grad(lambda x: jnp.sum(surface.at(x, y)))(x)
    exact = np.asarray(surface.derivative(INSIDE, (1, 0))) / FRAME.extent[0]
    np.testing.assert_allclose(slope, exact, atol=1e-11 * np.abs(exact).max())
    raster = surface.at(np.linspace(10, 16, 600), np.linspace(-3, -1, 500)[:, None])
    assert raster.shape == (500, 600)
    s, t = np.meshgrid(np.linspace(0, 1, 600), np.linspace(0, 1, 500))
    expected = surface(np.stack([s, t], axis=-1).reshape(-1, 2))
    np.testing.assert_allclose(raster.reshape(-1), expected, atol=1e-11)


@pytest.mark.parametrize("dimension", [1, 3])
def test_no_parameters(dimension):
    """No parameters, no values."""
    surface = random_surface(POLYNOMIAL, dimension)
    assert surface(np.zeros((0, 2))).shape == ((0,) if dimension == 1 else (0, 3))
    if dimension == 1:
        assert surface.at([], []).shape == (0,)


def test_other_types_of_numbers():
    """Lists, whole numbers and single precision are parameters, too; single precision is not refused at the ends."""
    surface = random_surface(POLYNOMIAL)
    expected = np.asarray(surface(np.array([[0.0, 1.0], [1.0, 0.5]])))
    for places in ([[0, 1], [1, 0.5]], np.float32([[0, 1], [1, 0.5]]), jnp.float32([[0, 1], [1, 0.5]])):
        np.testing.assert_allclose(surface(places), expected, atol=1e-12)
    np.testing.assert_allclose(surface([0, 1]), expected[0], atol=1e-12)
