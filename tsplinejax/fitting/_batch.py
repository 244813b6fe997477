"""Many maps, each with a mesh of its own, one after the other.

Kernels are compiled for padded sizes, so maps of about the same size run those that the first one compiled. A map that
cannot be read or fitted does not stop the others: its outcome carries the error.
"""

import inspect
import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .._errors import InputError
from ..data import HeightMap, PointCloud
from ..io import read
from ._fit import fit
from ._result import FitResult, StopReason

_OPTIONS = frozenset(inspect.signature(fit).parameters) - {"data", "progress", "checkpoint"}


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

    for index, item in enumerate(tqdm(items, disable=not progress, unit="map", leave=False)):
        outcome = _outcome(index, item, reader, options)
        yield outcome
        if outcome.result is not None and outcome.result.stop is StopReason.INTERRUPTED:
            return


def _outcome(
    index: int, item: Any, reader: Callable[[Path], HeightMap | PointCloud], options: dict[str, Any]
) -> BatchItem:
    """Read and fit one item; whatever goes wrong belongs to it alone."""
    path = Path(item) if isinstance(item, str | os.PathLike) else None
    try:
        return BatchItem(index, path, fit(item if path is None else reader(path), **options), None)
    except Exception as error:
        return BatchItem(index, path, None, error)
