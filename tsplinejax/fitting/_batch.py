"""Many maps, each with a mesh of its own, one after the other.

Kernels are compiled for padded sizes, so maps of about the same size run those that the first one compiled; where its
mesh nearly fills its padded size, those of the next size are made ready with it. A map that cannot be read or fitted
does not stop the others: its outcome carries the error.
"""

import inspect
import os
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from .._errors import InputError
from ..data import HeightMap, PointCloud
from ..io import read
from ..space import capacity_for
from ._finish import finished
from ._fit import fit, pose_fit
from ._result import FitResult, StopReason

_OPTIONS = frozenset(inspect.signature(fit).parameters) - {"data", "progress", "checkpoint"}
ROOM = 2  # a mesh may have so many times the elements of the first one before a kernel is compiled for it,
MOST_ROOM = 1 << 16  # but no fit begins with more elements to fill than these, which take 200 MB


@dataclass(frozen=True, eq=False, repr=False)
class BatchItem:
    """What became of one item of a batch.

    **Attributes:**

    - `index`: its place among the items.
    - `path`: the file it was read from, if it was.
    - `result`: the fit, or `None` where there is none.
    - `error`: why there is none, or `None`.
    """

    index: int
    path: Path | None
    result: FitResult | None
    error: Exception | None

    def __repr__(self) -> str:
        name = f", {self.path}" if self.path else ""
        outcome = repr(self.result) if self.error is None else f"{type(self.error).__name__}: {self.error}"
        return f"BatchItem({self.index}{name}, {outcome})"


def fit_batch(
    items: Iterable[Any],
    *,
    read: Callable[[Path], HeightMap | PointCloud] = read,
    progress: bool = False,
    **options: Any,
) -> Iterator[BatchItem]:
    """Fit many maps, each with a mesh of its own, without compiling anew for each.

    **Arguments:**

    - `items`: whatever [`fit`][tsplinejax.fit] accepts, or paths of files.
    - `read`: reads a path; by default [`read`][tsplinejax.read] without options.
    - `progress`: show a progress bar over the items on standard error.
    - `options`: those of [`fit`][tsplinejax.fit], the same for all.

    **Returns:** an iterator over one [`BatchItem`][tsplinejax.BatchItem] an item, in order. An item is read and fitted
    when its turn comes, so memory holds one at a time. It ends after a fit that was interrupted (Ctrl-C).

    **Raises:** `InputError` for an option that `fit` has not, for a checkpoint, which is of one fit, and for items that
    are not several. What goes wrong with one item is in its `error`.

    >>> from tsplinejax.data import peaks
    >>> outcomes = list(fit_batch([peaks((30, 40)), "none.npy", peaks((40, 30))], tolerance=0.1))
    >>> tuple(None if item.error is None else str(item.error) for item in outcomes)
    (None, 'none.npy does not exist; check the path', None)
    """
    if "checkpoint" in options:
        raise InputError("a checkpoint is of one fit, but fit_batch makes many; leave it out, or call fit for each")
    unknown = sorted(set(options) - _OPTIONS)
    if unknown:
        raise InputError(f"fit_batch takes the options of fit; received {unknown[0]!r}; see help(tsplinejax.fit)")
    one = isinstance(items, str | os.PathLike | HeightMap) or getattr(items, "ndim", 3) == 2
    if one or not isinstance(items, Iterable):
        raise InputError(f"fit_batch takes several items; received {type(items).__name__}; put it in a list")
    return _outcomes(items, read, progress, options)


def _outcomes(
    items: Iterable[Any], reader: Callable[[Path], HeightMap | PointCloud], progress: bool, options: dict[str, Any]
) -> Iterator[BatchItem]:
    """Each item's outcome when its turn comes."""
    from tqdm import tqdm

    rooms: dict[int, int] = {}
    for index, item in enumerate(tqdm(items, disable=not progress, unit="map", leave=False)):
        outcome = _outcome(index, item, reader, options, rooms)
        yield outcome
        if outcome.result is not None and outcome.result.stop is StopReason.INTERRUPTED:
            return


def _outcome(
    index: int,
    item: Any,
    reader: Callable[[Path], HeightMap | PointCloud],
    options: dict[str, Any],
    rooms: dict[int, int],
) -> BatchItem:
    """Read and fit one item; whatever goes wrong belongs to it alone."""
    path = Path(item) if isinstance(item, str | os.PathLike) else None
    try:
        return BatchItem(index, path, _fitted(item if path is None else reader(path), options, rooms), None)
    except Exception as error:
        return BatchItem(index, path, None, error)


def _fitted(data: Any, options: dict[str, Any], rooms: dict[int, int]) -> FitResult:
    """The fit of one item, with the room that the first of its size was found to want, by that one's padded length."""
    started = time.perf_counter()
    problem = pose_fit(data, **options)
    chosen = {name: options[name] for name in ("lattice", "smoothing") if name in options}
    least = problem.least_capacity
    if least in rooms:
        return finished(replace(problem, room=rooms[least]), data, started, **chosen)
    result = finished(problem, data, started, **chosen)
    rooms[least], space = 0, result.surface.space
    wanted = capacity_for(ROOM * max(int(space.n_elements), int(space.n_functions)), least)
    if wanted > MOST_ROOM or result.stop is StopReason.INTERRUPTED:
        return result
    with suppress(Exception):  # the result is there; what fails now, for want of memory say, only saves time
        if wanted > space.capacity:  # a step of a fit with that room compiles what the others will run
            hurried = replace(problem, room=wanted, budget=replace(problem.budget, max_steps=1))
            if finished(hurried, data, time.perf_counter(), **chosen).stop is StopReason.INTERRUPTED:
                return replace(result, stop=StopReason.INTERRUPTED)
        rooms[least] = wanted
    return result
