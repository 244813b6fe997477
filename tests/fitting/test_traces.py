"""Compilations: at most one a kernel, precision, dimension and capacity, whatever the samples and the steps."""

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

import jax
import numpy as np

import tsplinejax as tsj
from tsplinejax.fitting import _adaptive, _criteria, _energy, _moments, _residuals, _solve, _system

from .surfaces import bump

LEAST_CAPACITY = 1024  # of a fit to few samples
COMPILED = "/jax/core/compile/backend_compile_duration"


def kernels() -> dict[str, int]:
    """Every jitted kernel of the fitting package, and how many versions of it are compiled."""
    modules = (_adaptive, _criteria, _energy, _moments, _residuals, _solve, _system)
    found = {f"{m.__name__}.{name}": f for m in modules for name, f in vars(m).items() if hasattr(f, "_cache_size")}
    return {name: f._cache_size() for name, f in found.items()}


@contextmanager
def counted_compilations() -> Iterator[list[str]]:
    """A list that grows with every compilation of the backend."""
    events: list[str] = []

    def listen(event: str, duration: float, **details: object) -> None:
        if event == COMPILED:
            events.append(str(details.get("fun_name", event)))

    jax.monitoring.register_event_duration_secs_listener(listen)
    try:
        yield events
    finally:
        jax.monitoring.unregister_event_duration_listener(listen)


def doublings(results: list[tsj.FitResult]) -> int:
    """One, and how often the padded length of a mesh was doubled from the least to the largest of these fits."""
    largest = max(result.surface.space.capacity for result in results)
    return 1 + int(np.log2(largest / LEAST_CAPACITY))


def test_growing_meshes():
    """Over one set of samples, ever finer meshes add at most one version of a kernel for each doubling."""
    jax.clear_caches()
    heights = bump(100, 110)
    results = [tsj.fit(heights, tolerance=tolerance) for tolerance in (1e-2, 1e-3, 1e-4, 1e-5)]
    assert all(result.converged for result in results)
    assert doublings(results) > 1
    sizes = kernels()
    assert len(sizes) > 8
    assert max(sizes.values()) <= doublings(results), Counter(sizes).most_common(8)


def test_growing_data():
    """Ever more samples on meshes of one capacity add at most one version of a kernel for each doubling."""
    jax.clear_caches()
    shapes = [(30, 34), (34, 37), (38, 45), (45, 50), (50, 58), (61, 63), (70, 75), (80, 90)]
    results = [tsj.fit(bump(*shape), tolerance=2e-2, lattice=(4, 4)) for shape in shapes]
    assert doublings(results) == 1
    sizes = len({int(np.ceil(np.log2(rows * columns))) for rows, columns in shapes})
    assert max(kernels().values()) <= sizes, Counter(kernels()).most_common(8)


def test_a_second_identical_fit_compiles_nothing():
    """Everything a fit needs is compiled after the first one."""
    heights = bump(50, 70)
    tsj.fit(heights, tolerance=2e-3)
    with counted_compilations() as events:
        tsj.fit(heights, tolerance=2e-3)
    assert not events


def test_other_data_of_the_same_size_compile_nothing():
    """Other heights over as many pixels run the same kernels: only the result's own size may differ."""
    first, second = bump(50, 70), bump(50, 70, 0.15)
    results = [tsj.fit(first, tolerance=2e-3)]
    with counted_compilations() as events:
        results.append(tsj.fit(second, tolerance=2e-3))
    capacity = [result.surface.space.capacity for result in results]
    assert capacity[0] == capacity[1]
    assert not events


def test_precision_and_dimension_have_their_own():
    """A float32 fit after a float64 one compiles each kernel once more, not more often."""
    heights = bump(50, 70)
    tsj.fit(heights, tolerance=5e-3)
    before = kernels()
    tsj.fit(heights.astype(np.float32), tolerance=5e-3)
    after = kernels()
    tsj.fit(heights.astype(np.float32), tolerance=5e-3)
    assert kernels() == after
    added = {name: after[name] - before.get(name, 0) for name in after}
    assert max(added.values()) <= 2, Counter(added).most_common(8)
