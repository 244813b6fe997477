"""Engines: who works on the pages of a stored map, workers of a Dask cluster or the devices of this machine.

An engine receives pages and a function of a page's heights, and hands back the results in the order of the pages. What
is computed, and how the results add up, is none of its business.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from itertools import cycle
from typing import Any, Protocol, TypeVar

import jax
import jax.experimental
import numpy as np

from .._errors import InputError, require
from ..data import StoredMap, Window, checked_heights


class Task(Protocol):
    """Work on a window of a map."""

    @property
    def window(self) -> Window:
        """Which pixels it is about."""
        ...


Result = TypeVar("Result")
Work = Callable[[Any, np.ndarray], Result]


class AbstractEngine(ABC):
    """Who works on the pages of a stored map."""

    @property
    @abstractmethod
    def pages_held(self) -> int:
        """How many pages are in this process's memory at once: they share the budget."""

    @abstractmethod
    def run(self, work: Work[Result], source: StoredMap, tasks: Sequence[Task]) -> Iterator[Result]:
        """`work(task, heights)` of every task, in their order; `heights` are those of the task's window."""


@dataclass(frozen=True)
class DaskEngine(AbstractEngine):
    """The workers of a Dask cluster, each of which reads the pages that it works on.

    Workers find the map as this process does: a memory map under the same file name, a zarr array in the same store, a
    dask array by its graph, whose chunks are computed where they are needed. Give each worker one thread for every page
    that its memory holds (`max_memory` is the budget of a thread).

    **Arguments:**

    - `client`: a `dask.distributed.Client`.

    **Raises:** `InputError` for anything else.

    >>> DaskEngine("localhost")
    Traceback (most recent call last):
    tsplinejax._errors.InputError: an engine of Dask works through a dask.distributed.Client, but got str; ...
    """

    client: Any

    def __post_init__(self) -> None:
        if not (hasattr(self.client, "scatter") and hasattr(self.client, "submit")):
            raise InputError(
                f"an engine of Dask works through a dask.distributed.Client, but got {type(self.client).__name__}; "
                "make one with: dask.distributed.Client()"
            )

    @property
    def pages_held(self) -> int:
        """None here; the driver's own share is that of one."""
        return 1

    def run(self, work: Work[Result], source: StoredMap, tasks: Sequence[Task]) -> Iterator[Result]:
        """Tasks and their results travel, pixels do not."""
        sent = self.client.scatter(list(tasks), hash=False)
        if hasattr(source.heights, "dask"):
            on_array = require("dask", "large").delayed(partial(_on_array, work, _x64()), pure=False)
            rest = [
                on_array(one, source.heights[task.window.rows, task.window.columns])
                for one, task in zip(sent, tasks, strict=True)
            ]
            futures = self.client.compute(rest)
        else:
            everywhere = self.client.scatter(source, hash=False, broadcast=True)
            on_map = partial(_on_map, work, _x64())
            futures = [self.client.submit(on_map, one, everywhere, pure=False) for one in sent]
        futures.reverse()
        while futures:
            yield futures.pop().result()  # the last reference: the worker may forget it


@dataclass(frozen=True)
class DevicesEngine(AbstractEngine):
    """Several devices of this machine: pages go to them in turn, each read by a thread of its own.

    **Arguments:**

    - `devices`: which of `jax.devices()`; by default all of them.

    >>> DevicesEngine().pages_held >= 1
    True
    """

    devices: tuple[Any, ...] = ()

    @property
    def chosen(self) -> tuple[Any, ...]:
        """The devices given, or all."""
        return tuple(self.devices) or tuple(jax.devices())

    @property
    def pages_held(self) -> int:
        """One for each device."""
        return len(self.chosen)

    def run(self, work: Work[Result], source: StoredMap, tasks: Sequence[Task]) -> Iterator[Result]:
        """A thread a device; partial results come back to the host."""
        on_device = partial(_on_device, work, _x64(), source)
        with ThreadPoolExecutor(len(self.chosen)) as pool:
            yield from pool.map(on_device, tasks, cycle(self.chosen))


def _on_array(work: Work[Result], x64: bool, task: Task, heights: np.ndarray) -> Result:
    """On a worker that was handed the heights."""
    with _precision(x64):
        return work(task, checked_heights(np.asarray(heights), task.window))


def _on_map(work: Work[Result], x64: bool, task: Task, source: StoredMap) -> Result:
    """On a worker that reads them."""
    with _precision(x64):
        return work(task, source.window(task.window))


def _on_device(work: Work[Result], x64: bool, source: StoredMap, task: Task, device: Any) -> Result:
    """In a thread of this process."""
    with _precision(x64), jax.default_device(device):
        return work(task, source.window(task.window))


def _x64() -> bool:
    """Whether double precision is on here."""
    return bool(jax.config.read("jax_enable_x64"))


def _precision(x64: bool) -> AbstractContextManager:
    """The driver's precision, in another process or thread, for one task only."""
    home = jax if hasattr(jax, "enable_x64") else jax.experimental  # where an older JAX has it
    return vars(home)["enable_x64"](x64)
