"""Checkpoints: a run keeps its last step in a file, and another run goes on from there.

A step is its elements, the device rows of their Bézier elements, and the control points; moments, normal matrices and
residuals follow from these and the samples. Sums do not depend on the step in which they were taken, and rows are kept
in their order, so a resumed run takes the steps of an uninterrupted one, to the bit.

The file is numpy's `.npz`, not compressed: a header in JSON, and arrays. It names the problem by digests of the data
and by the options that steer the loop. Budgets are not among them. It is not trusted: nothing is unpickled, and sizes,
checksums and shapes are checked before a mesh is built.
"""

import hashlib
import io
import json
import os
import time
import warnings
import zipfile
from collections.abc import Iterable
from dataclasses import asdict, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy_format

from .._errors import InputError
from .._version import __version__
from ..data import Window
from ..io._files import written_whole
from ..mesh import TMesh, forest_from_boxes, require_forest
from ..space import pad, to_device
from ._adaptive import State, resumed
from ._discretisation import discretise
from ._problem import Problem
from ._result import Step
from ._source import AbstractSource, HeldSource, StoredSource
from ._store import empty_store
from ._tally import empty_tally

KIND = "tsplinejax checkpoint 1"
SHARE = 0.1  # of the time that writing may take
BAND = 1 << 22  # pixels of a stored map that are read at once
_DIGESTS = ("values", "parameters", "weights", "outliers")


class Checkpoint:
    """The file of one run, or none (`path` is `None`), which keeps nothing.

    In a `with` statement the last step that was handed to `keep` is in the file when the statement is left, however it
    is left. `seconds` is how long the run had taken when it was interrupted.
    """

    def __init__(self, path: Path | None, problem: Problem) -> None:
        self.path, self.problem, self.seconds = path, problem, 0.0
        self._unwritten: tuple[State, State] | None = None
        self._due = -np.inf

    def restored(self) -> tuple[State, State] | None:
        """The last step and the best one as the file has them, or `None` where there is no file.

        **Raises:** `InputError` for a file that is none of ours, damaged, or of another problem.
        """
        if self.path is None or not self.path.exists():
            return None
        try:
            header, arrays = _read(self.path)
            self._compare(header["problem"])
            last, best = _kept(self.problem, header, arrays)
        except _OtherProblemError:
            raise
        except (Exception, MemoryError) as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise InputError(
                f"{self.path} cannot be read as a checkpoint: {reason}; it is truncated, corrupted or another file: "
                "name another, or delete it to begin anew"
            ) from error
        self.seconds = float(header["seconds"])
        last = resumed(self.problem, last)
        return last, last if best is None else best

    def keep(self, state: State, best: State) -> None:
        """Hand over a step and the best one so far; they are written unless that would take too much of the time."""
        if self.path is None:
            return
        self._unwritten = (state, best)
        if time.perf_counter() >= self._due:
            self._write(self.path)

    def __enter__(self) -> "Checkpoint":
        return self

    def __exit__(self, *_: object) -> None:
        if self.path is not None:
            self._write(self.path)

    def _write(self, path: Path) -> None:
        """Put what is not yet written into the file; a failure is only warned of: it must not cost the fit."""
        if self._unwritten is None:
            return
        began = time.perf_counter()
        entries = _entries(self._problem_named, *self._unwritten)
        try:
            with written_whole(path) as stream:
                np.savez(stream, allow_pickle=False, **entries)
                stream.flush()
                os.fsync(stream.fileno())
            self._unwritten = None
        except InputError as error:
            warnings.warn(f"no checkpoint was written, the fit goes on: {error}", RuntimeWarning, stacklevel=2)
        ended = time.perf_counter()
        self._due = ended + (ended - began) * (1 / SHARE - 1)

    @cached_property
    def _problem_named(self) -> dict[str, str]:
        """What tells this problem from others, budgets left out: digests of the data, and options in words."""
        problem, request, forest = self.problem, self.problem.request, require_forest(self.problem.start)
        return {
            "version": __version__,
            **_digests(problem.source),
            "frame": repr(problem.source.frame),
            "tolerance": repr(request.tolerance),
            "noise": repr(request.noise),
            "smoothing": repr(problem.smoothing),
            "refinement": repr(problem.refinement),
            "solver": repr(problem.solver),
            "start lattice": " × ".join(map(str, forest.lattice)),
            "first cut": forest.first_cut,
            "border": problem.start.border,
            "dtype": str(problem.dtype),
            "marking": repr(problem.marking),
        }

    def _compare(self, found: dict[str, str]) -> None:
        """Raise unless the file is of this problem."""
        for name, ours in self._problem_named.items():
            theirs = found.get(name, "none")
            if theirs != ours:
                differs = f"its {name} are others" if name in _DIGESTS else f"its {name} is {theirs}, here {ours}"
                raise _OtherProblemError(
                    f"a checkpoint goes on with the fit that wrote it, but {self.path} is of another: {differs}; "
                    "give the same data and options (budgets may differ), name another file, or delete it"
                )


class _OtherProblemError(InputError):
    """A sound checkpoint, of other data or options."""


def _digests(source: AbstractSource) -> dict[str, str]:
    """SHA-256 of what the samples are, part by part; a stored map is read once, in bands of rows."""
    if isinstance(source, StoredSource):
        rows, columns = source.stored.shape
        step = max(1, BAND // columns)
        bands = (slice(first, min(first + step, rows)) for first in range(0, rows, step))
        values = (source.stored.window(Window(band, slice(0, columns))) for band in bands)
        return {"values": _digest(values, (rows, columns))}
    assert isinstance(source, HeldSource)
    data = source.samples
    named = {"values": data.values, "parameters": data.parameters, "weights": data.weights, "outliers": source.outliers}
    digests = {name: "none" if part is None else _digest([part], part.shape) for name, part in named.items()}
    return {**digests, "grid": repr(data.grid_shape)}


def _digest(parts: Iterable[np.ndarray], shape: tuple[int, ...]) -> str:
    """SHA-256 of the shape, the type and the numbers of an array that comes in parts."""
    digest = hashlib.sha256(repr(shape).encode())
    for part in parts:
        digest.update(part.dtype.str.encode())
        digest.update(np.ascontiguousarray(part).data.cast("B"))
    return digest.hexdigest()


def _entries(problem: dict[str, str], state: State, best: State) -> dict[str, np.ndarray]:
    """The header, and the arrays of the last step and of the best one where that is another."""
    header = {
        "kind": KIND,
        "problem": problem,
        "seconds": time.perf_counter() - state.started,
        "history": [asdict(step) for step in state.history],
        "last": _figures(state),
        "best": None if best is state else _figures(best),
    }
    entries = {"header": np.frombuffer(json.dumps(header).encode(), np.uint8), **_arrays("last", state)}
    return entries if best is state else {**entries, **_arrays("best", best)}


def _figures(state: State) -> dict[str, Any]:
    """A state's numbers. Whether a budget is used up is left out: it may be another the next time."""
    entry = asdict(state.history[-1])
    return {"stage": state.stage, "polished": state.polished, "worst": state.worst, "entry": entry}


def _arrays(name: str, state: State) -> dict[str, np.ndarray]:
    """A state's elements, device rows and control points."""
    tmesh = state.mesh.tmesh
    return {
        f"{name}_boxes": tmesh.boxes.astype(np.int32),
        f"{name}_slots": state.mesh.slots.astype(np.int32),
        f"{name}_coefficients": np.asarray(state.coefficients)[: tmesh.n_anchors],
    }


def _read(path: Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The header and the arrays of a file."""
    with zipfile.ZipFile(path) as archive:
        size = path.stat().st_size
        arrays = {member.filename.removesuffix(".npy"): _array(archive, member, size) for member in archive.infolist()}
    if "header" not in arrays:
        raise InputError("it has no header")
    header = json.loads(arrays.pop("header").tobytes())
    if not isinstance(header, dict) or header.get("kind") != KIND:
        raise InputError(f"its header does not say {KIND!r}")
    return header, arrays


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo, size: int) -> np.ndarray:
    """One array; stored members hold no more bytes than the file, and an array no more than its member."""
    if member.compress_type != zipfile.ZIP_STORED or not 0 < member.file_size <= size:
        raise InputError(f"its part {member.filename!r} is compressed, or declares more bytes than there are")
    stream = io.BytesIO(archive.read(member))  # which compares checksums
    version = npy_format.read_magic(stream)
    header = npy_format.read_array_header_1_0 if version == (1, 0) else npy_format.read_array_header_2_0
    shape, _, dtype = header(stream)
    count = int(np.prod([int(length) for length in shape], dtype=object)) if shape else 1
    if dtype.hasobject or count * dtype.itemsize != member.file_size - stream.tell():
        raise InputError(f"its part {member.filename!r} does not hold the numbers that it declares")
    stream.seek(0)
    return npy_format.read_array(stream, allow_pickle=False)


def _kept(problem: Problem, header: dict[str, Any], arrays: dict[str, np.ndarray]) -> tuple[State, State | None]:
    """The last state and, where it is another, the best one."""
    started = time.perf_counter() - float(header["seconds"])
    history = tuple(Step(**step) for step in header["history"])
    last = _spent(problem, "last", header, arrays, history, started)
    return last, None if header["best"] is None else _spent(problem, "best", header, arrays, history, started)


def _spent(
    problem: Problem,
    name: str,
    header: dict[str, Any],
    arrays: dict[str, np.ndarray],
    history: tuple[Step, ...],
    started: float,
) -> State:
    """A state of a file, without device rows, as `advance` leaves its argument behind."""
    figures = header[name]
    entry, worst = Step(**figures["entry"]), float(figures["worst"])
    if not 0 <= entry.step < len(history):
        raise InputError(f"its {name} step is not among its {len(history)} steps")
    mesh = discretise(_mesh(problem, arrays[f"{name}_boxes"]), problem.least_capacity)
    slots, points = arrays[f"{name}_slots"], arrays[f"{name}_coefficients"]
    if not np.array_equal(np.sort(slots), mesh.slots):
        raise InputError(f"its {len(slots)} device rows are not those of {len(mesh.slots)} Bézier elements")
    if points.shape != (mesh.tmesh.n_anchors, problem.dimension) or points.dtype != problem.dtype:
        raise InputError(f"its control points are {points.dtype} {points.shape}, for {mesh.tmesh.n_anchors} anchors")
    if not np.isfinite(points).all():
        raise InputError("its control points are not all finite")
    store = empty_store(1, 1, problem.dimension, 1, problem.dtype)
    store.points.delete()
    return State(
        mesh=replace(mesh, slots=slots.astype(np.int64)),
        store=store,
        coefficients=to_device(pad(points, mesh.capacity, 0)),
        tally=empty_tally(len(slots)),
        excess=np.array([worst]),
        stage=float(figures["stage"]),
        polished=bool(figures["polished"]),
        history=(*history[: entry.step], entry),
        started=started,
    )


def _mesh(problem: Problem, boxes: np.ndarray) -> TMesh:
    """The T-mesh of element boxes over the problem's start lattice."""
    if boxes.dtype != np.int32 or boxes.ndim != 2 or boxes.shape[1] != 4:
        raise InputError(f"its elements are {boxes.dtype} {boxes.shape}, not rows of four")
    forest = require_forest(problem.start)
    boxes = boxes.astype(np.int64)
    tmesh = forest_from_boxes(boxes, forest.lattice, first_cut=forest.first_cut, border=problem.start.border)
    if not np.array_equal(tmesh.boxes, boxes):
        raise InputError("its elements are not in the order in which they are kept")
    return tmesh
