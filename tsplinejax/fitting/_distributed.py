"""Passes over the samples, wherever they are worked on.

Moments and residuals of a page concern only the Bézier elements with a pixel in it. Whoever works on a page receives
those elements' index boxes (and Bézier points), numbers them 0, 1, ..., and returns a row for each; rows of several
pages are brought together by addition and maximum.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import jax
import numpy as np
from jaxtyping import Array, Float, Int

from ..data import Statistics, StoredMap, Window, statistics_of
from ..space import capacity_for, pad, to_device
from ._discretisation import Discretisation
from ._engines import AbstractEngine, Result, Work
from ._moments import Counts, Moments, add_blocks, add_samples, empty_moments
from ._pages import Page, PagedSamples
from ._residuals import Residuals, measure_blocks, residuals
from ._samples import AbstractSamples


@dataclass(frozen=True, eq=False)
class PageTask:
    """What a worker must know of a page.

    **Attributes:**

    - `page`: which pixels, and how they become samples.
    - `boxes`: index boxes of the Bézier elements with a pixel there.
    - `lattice`: squares of the start lattice (M, N).
    - `points`: those elements' Bézier points, or for moments those of Σb where the surface is rational.
    """

    page: Page
    boxes: Int[np.ndarray, "k 4"]
    lattice: Int[np.ndarray, " 2"]
    points: Float[np.ndarray, "k 4 4 c"] | None

    @property
    def window(self) -> Window:
        """The page's."""
        return self.page.window

    @property
    def capacity(self) -> int:
        """Padded number of elements: kernels rarely see a new one."""
        return capacity_for(len(self.boxes))

    def on_device(self) -> tuple[Array, Array, Array | None]:
        """Padded boxes, the lattice, and padded points."""
        boxes = to_device(pad(self.boxes.astype(np.int32), self.capacity, 0))
        points = None if self.points is None else to_device(pad(self.points, self.capacity, 0))
        return boxes, to_device(self.lattice), points


@dataclass(frozen=True)
class Survey:
    """A window whose statistics are wanted."""

    window: Window


def surveyed(stored: StoredMap, engine: AbstractEngine) -> StoredMap:
    """The map with its statistics, found by an engine."""
    tasks = [Survey(window) for window in stored.windows()]
    return stored.with_statistics(sum(engine.run(_statistics, stored, tasks), Statistics()))


def sum_samples(
    moments: Moments,
    samples: AbstractSamples,
    mesh: Discretisation,
    chosen: Int[np.ndarray, " chosen"],
    boxes: Array,
    lattice: Array,
    sums: Float[Array, "capacity 4 4 1"] | None = None,
) -> tuple[Moments, Counts]:
    """Add the samples of the chosen Bézier elements to the moments, whose arrays are used up; see `add_samples`."""
    if not isinstance(samples, PagedSamples) or samples.engine is None:
        return add_samples(moments, samples, mesh, chosen, boxes, lattice, sums)
    counts, slots = Counts(np.zeros(len(chosen)), np.zeros(len(chosen))), mesh.slots[chosen]
    for inside, (mass, load, number, variance) in _run(page_moments, samples, mesh, chosen, lattice, sums):
        capacity = capacity_for(len(inside))
        rows = to_device(pad(slots[inside].astype(np.int32), capacity, len(moments.mass)))
        moments = _add_rows(moments, rows, Moments(*(to_device(pad(part, capacity, 0)) for part in (mass, load))))
        counts.samples[inside] += number
        counts.variance[inside] += variance
    return moments, counts


def measure_samples(
    samples: AbstractSamples,
    mesh: Discretisation,
    chosen: Int[np.ndarray, " chosen"],
    points: Float[Array, "capacity 4 4 c"],
    boxes: Array,
    lattice: Array,
) -> Residuals:
    """Residuals of the samples in the chosen Bézier elements, whose Bézier points lie in `points`; see `residuals`."""
    if not isinstance(samples, PagedSamples) or samples.engine is None:
        return residuals(samples, mesh, chosen, points, boxes, lattice)
    found = Residuals(*(np.zeros(len(chosen)) for _ in range(3)))
    for inside, part in _run(page_residuals, samples, mesh, chosen, lattice, points):
        found.largest[inside] = np.maximum(found.largest[inside], part.largest)
        found.weighted[inside] += part.weighted
        found.plain[inside] += part.plain
    return found


def _run(
    work: Work[Result],
    samples: PagedSamples,
    mesh: Discretisation,
    chosen: np.ndarray,
    lattice: Array,
    points: Array | None,
) -> Iterator[tuple[np.ndarray, Result]]:
    """Which chosen elements lie in a page, and what the engine found there, page by page."""
    assert samples.engine is not None
    boxes, squares = mesh.elements.boxes[chosen], np.asarray(lattice)
    rows = None if points is None else np.asarray(points)[mesh.slots[chosen]]
    pages = list(samples.pages(boxes))
    tasks = [PageTask(page, boxes[inside], squares, None if rows is None else rows[inside]) for page, inside in pages]
    results = samples.engine.run(work, samples.source, tasks)
    return zip((inside for _, inside in pages), results, strict=True)


def page_moments(task: PageTask, heights: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Rows of a page's elements: moments (mass and load), number of samples, sum of their variances."""
    form, k = task.page.form, len(task.boxes)
    boxes, lattice, sums = task.on_device()
    counts, moments = Counts(np.zeros(k), np.zeros(k)), empty_moments(task.capacity, 1, form.dtype)
    blocks, pixels = task.page.blocks(task.boxes, np.arange(k)), task.page.on_device(heights)
    moments = add_blocks(moments, counts, pixels, blocks, form.tile, boxes, lattice, sums)
    return np.asarray(moments.mass)[:k], np.asarray(moments.load)[:k], counts.samples, counts.variance


def page_residuals(task: PageTask, heights: np.ndarray) -> Residuals:
    """Residuals of a page's elements."""
    k = len(task.boxes)
    boxes, lattice, points = task.on_device()
    assert points is not None
    found = Residuals(*(np.zeros(k) for _ in range(3)))
    blocks, pixels = task.page.blocks(task.boxes, np.arange(k)), task.page.on_device(heights)
    measure_blocks(found, pixels, blocks, task.page.form.tile, points, boxes, lattice)
    return found


def _statistics(_: Survey, heights: np.ndarray) -> Statistics:
    """Work of a survey."""
    return statistics_of(heights)


@partial(jax.jit, donate_argnums=0)
def _add_rows(moments: Moments, rows: Int[Array, " padded"], parts: Moments) -> Moments:
    """Moments with those of some rows added; padded entries point beyond the last row."""
    return jax.tree.map(lambda whole, part: whole.at[rows].add(part, mode="drop"), moments, parts)
