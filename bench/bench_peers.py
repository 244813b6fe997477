"""Other ways to a surface on the same samples: numbers each needs, errors it leaves, seconds it takes.

T1, T2, T4 and T6 to 1 % of the range, T3 to its noise, the elevation model of `make demo` to its 5 %, and the largest
measured map to 1 %. Uniform lattices are the smallest that meet the tolerance (or the largest tried). Interpolation has
every other pixel in each direction as its nodes, and is judged at all samples like the rest; errors on T3 are those to
the clean surface. T4 is fitted by ours a second time with smoothing, which its holes want and its edges do not, and
incomplete maps by the uniform lattice a second time, with a penalty. SNR to truth is that of Eq. 7 to the clean surface
(T3) and on the hidden samples (T4). Rows marked `quoted` were measured once and are not run here. Ours is the faster of
two runs after one that compiles.
"""

import multiprocessing
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from multiprocessing.connection import Connection
from typing import Any

import jax
import numpy as np
import peers
from quoted import quoted
from reporting import keep
from surfaces import case_study, jacksboro, measured

jax.config.update("jax_enable_x64", True)

import tsplinejax as tsj  # noqa: E402
from tsplinejax.data import scattered_peaks  # noqa: E402

LARGEST = "mnt-2.mnt"
SOME = 20_000  # places at which slow surfaces are judged
NODES = 100_000  # at most, of slow surfaces
LATTICES = [round(8 * 2 ** (k / 2)) for k in range(11)]  # elements along the shorter side, 8 to 256
FINER = [round(8 * 1.1**k) for k in range(42)]  # the same for the separable solve, which is quick
FILL, PENALTY = 1e-9, 0.1  # the penalty is what suits the hidden samples of T4 best
# G+Smo: elements along the shorter side at the start and cells refined around each (the best of several), and when to
# give it up.
STARTS, START, EXTENSION, MOST_SECONDS = {"T1": 42}, 16, 1, 300.0


@dataclass(frozen=True, eq=False)
class Case:
    """A surface, how ours fits it, and where everyone is judged."""

    name: str
    data: Any
    options: dict[str, Any]
    places: np.ndarray  # (m, 2), values (m,): what is fitted
    values: np.ndarray
    truth: np.ndarray  # (k,) at the places, then at the hidden ones
    hidden: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    noisy: bool = False
    also: dict[str, dict[str, Any]] = field(default_factory=dict)  # other options for ours

    @property
    def judged(self) -> np.ndarray:
        """Every place with a truth."""
        return np.concatenate([self.places, self.hidden])

    @property
    def limit(self) -> float:
        """The largest error allowed."""
        return self.options.get("relative_tolerance", 0.01) * float(np.ptp(self.values))

    @property
    def grid(self) -> np.ndarray | None:
        """The heights of a map without missing pixels."""
        full = isinstance(self.data, tsj.HeightMap) and self.data.valid.all()
        return self.data.heights if full else None

    def lattice(self, elements: int) -> peers.Lattice:
        """Near-square elements, so many along the shorter side."""
        width, height = self.data.frame.extent
        shorter = min(width, height)
        return (max(elements, round(elements * width / shorter)), max(elements, round(elements * height / shorter)))

    def some(self, indices: np.ndarray, most: int) -> np.ndarray:
        """At most so many of the indices, drawn with a seed."""
        drawn = np.random.default_rng(0).choice(indices, most, replace=False) if len(indices) > most else indices
        return np.sort(drawn)

    @property
    def nodes(self) -> np.ndarray:
        """Every other pixel in each direction, the last ones included; of a cloud a quarter of the points."""
        if not isinstance(self.data, tsj.HeightMap):
            return self.some(np.arange(len(self.places)), len(self.places) // 4)
        rows, columns = (np.unique(np.linspace(0, n - 1, n // 2 + 1).round().astype(int)) for n in self.data.shape)
        taken = np.zeros(self.data.shape, bool)
        taken[np.ix_(rows, columns)] = True
        return np.flatnonzero(taken[self.data.valid])


def main(size: int = 0, *names: str) -> None:
    """Run every method on every surface, or on those named; `size` sets the pixels along a side (0: as they are)."""
    rows, seen = [], set()
    for case in cases(size or None):
        if not names or case.name in names:
            rows += compare(case)
            seen.add(case.name)
            # Case by case: what is done is kept, whatever comes after it.
            missing = [] if LARGEST in seen or names else [f"no rows of {LARGEST}: not beside this copy, or to come"]
            keep("peers", rows, peers=("verde", "pygismo"), **({"left_out": missing} if missing else {}))


def cases(size: int | None) -> Iterator[Case]:
    """The surfaces, each ready to be fitted."""
    for name in ("T1", "T2"):
        yield of_map(name, case_study(name, size), 0.01)
    cloud, clean = (
        scattered_peaks(size**2 if size else 200_000, **options).samples() for options in ({}, {"sigma": 0})
    )
    points = scattered_peaks(size**2 if size else 200_000)
    truth = clean.values[:, 0]
    yield Case("T3", points, {"noise": "auto"}, cloud.parameters, cloud.values[:, 0], truth, noisy=True)
    partial = case_study("T4", size)
    complete = tsj.data.structured_with_missing(partial.shape, missing=0).samples()
    hidden = ~partial.valid.ravel()
    holes = of_map("T4", partial, 0.01, complete.parameters[hidden], complete.values[hidden, 0])
    yield replace(holes, also={"smoothing 1e-6": {"smoothing": 1e-6}})
    yield of_map("T6", case_study("T6", size), 0.01)
    yield of_map("jacksboro", cut(jacksboro(), size), 0.05)
    for name, data in measured((LARGEST,)):
        yield of_map(name, cut(data, size), 0.01)


def cut(data: tsj.HeightMap, size: int | None) -> tsj.HeightMap:
    """A corner of a map, or all of it."""
    return data if size is None else tsj.HeightMap(data.heights[-size:, :size].copy(), data.spacing)


def of_map(name: str, data: tsj.HeightMap, tolerance: float, hidden=np.zeros((0, 2)), more=np.zeros(0)) -> Case:
    """A height map to a relative tolerance, and what is hidden of it."""
    samples = data.samples()
    values = samples.values[:, 0]
    options = {"relative_tolerance": tolerance}
    return Case(name, data, options, samples.parameters, values, np.concatenate([values, more]), hidden)


def compare(case: Case) -> list[dict]:
    """All methods on one surface."""
    print(f"-- {case.name}", file=sys.stderr, flush=True)
    rows = [ours(case, "tsplinejax", {})]
    rows += [ours(case, f"tsplinejax, {label}", options) for label, options in case.also.items()]
    for label, method in METHODS.items():
        rows += method(case, label)
    for line in rows:
        line["ratio"] = line["seconds"] / rows[0]["seconds"] if line["seconds"] is not None else None
    rows += quoted(case.name)
    return rows


def ours(case: Case, label: str, options: dict[str, Any]) -> dict:
    """The faster of two fits, after one that compiles."""
    fits = [tsj.fit(case.data, **{**case.options, **options}) for _ in range(3)]
    result = min(fits[1:], key=lambda one: one.seconds)
    remark = "" if result.converged else f"stopped: {result.stop}"
    predicted = np.asarray(result.surface(case.judged))
    return row(case, label, result.control_points, result.seconds, predicted, remark=remark)


def row(
    case: Case,
    label: str,
    unknowns: int | None,
    seconds: float | None,
    predicted: np.ndarray | None = None,
    at: np.ndarray | None = None,
    remark: str = "",
) -> dict:
    """A line, judged at the places of the given indices."""
    line: dict[str, Any] = {"surface": case.name, "method": label, "control points": unknowns}
    line |= dict.fromkeys(("max error %", "rms error %", "SNR to truth dB"))
    if predicted is not None:
        at = np.arange(len(case.truth)) if at is None else at
        truth, hidden = case.truth[at], at >= len(case.places)
        errors = np.abs(predicted - truth)
        spread = np.ptp(case.truth[: len(case.places)]) / 100
        line["max error %"] = float(np.nanmax(errors[~hidden]) / spread)
        line["rms error %"] = float(np.sqrt(np.nanmean(errors[~hidden] ** 2)) / spread)
        if case.noisy or hidden.any():
            told = (hidden if hidden.any() else ~hidden) & np.isfinite(errors)
            line["SNR to truth dB"] = float(10 * np.log10(np.sum(truth[told] ** 2) / np.sum(errors[told] ** 2)))
    return {**line, "seconds": seconds, "ratio": None, "remark": remark}


def line_of(case: Case, label: str, fitted: peers.Fitted, at: np.ndarray | None = None, remark: str = "") -> dict:
    """The line of a peer's surface."""
    places = case.judged if at is None else case.judged[at]
    said = "; ".join(part for part in (fitted.remark, remark) if part)
    return row(case, label, fitted.unknowns, fitted.seconds, fitted.evaluate(places), at, said)


def sparse(case: Case, label: str) -> list[dict]:
    """Uniform lattice, any samples."""
    if case.noisy:
        return [line_of(case, label, peers.uniform_sparse(case.places, case.values, case.lattice(24)))]
    tries = [smallest_separable(case)[0]] if case.grid is not None else LATTICES
    fill = 0.0 if case.grid is not None else FILL
    fitted, met, elements = None, False, 0
    for elements in tries:
        fitted = peers.uniform_sparse(case.places, case.values, case.lattice(elements), fill)
        met = bool(np.abs(fitted.evaluate(case.places) - case.values).max() <= case.limit)
        if met:
            break
    assert fitted is not None
    lines = [line_of(case, label, fitted, remark="" if met else "tolerance not met")]
    if case.grid is None:
        penalised = peers.uniform_sparse(case.places, case.values, case.lattice(elements), PENALTY)
        lines.append(line_of(case, f"{label}, penalised", penalised))
    return lines


def separable(case: Case, label: str) -> list[dict]:
    """Uniform lattice, full grids only."""
    if case.grid is None:
        return [row(case, label, None, None, remark="needs a full grid")]
    elements, met = smallest_separable(case)
    fits = [peers.uniform_separable(case.grid, case.lattice(elements)) for _ in range(3)]
    fitted = min(fits, key=lambda one: one.seconds)
    return [line_of(case, label, fitted, remark="" if met else "tolerance not met")]


def smallest_separable(case: Case) -> tuple[int, bool]:
    """Elements along the shorter side of the first lattice that meets the tolerance, or of the largest one."""
    grid = case.grid
    assert grid is not None
    usable = [elements for elements in FINER if elements < 0.75 * min(grid.shape)]
    for elements in usable:
        fitted = peers.uniform_separable(grid, case.lattice(elements))
        if np.abs(fitted.evaluate(case.places) - case.values).max() <= case.limit:
            return elements, True
    return usable[-1], False


def triangulated(case: Case, label: str) -> list[dict]:
    """Cubic interpolation over triangles."""
    nodes = case.nodes
    fitted = peers.triangulated(case.places[nodes], case.values[nodes], case.judged)
    return [line_of(case, label, fitted)]


def slow(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Nodes, and indices of the places to judge at, for methods that cannot cope with all."""
    visible, hidden = np.arange(len(case.places)), np.arange(len(case.places), len(case.truth))
    return case.some(case.nodes, NODES), np.concatenate([case.some(visible, SOME), case.some(hidden, SOME)])


def radial(case: Case, label: str) -> list[dict]:
    """Thin plates among neighbours."""
    nodes, at = slow(case)
    fitted = peers.radial(case.places[nodes], case.values[nodes], case.judged[at])
    return [line_of(case, label, fitted, at)]


def green(case: Case, label: str) -> list[dict]:
    """verde's spline."""
    try:
        import verde  # noqa: F401
    except ImportError:
        return [row(case, label, None, None, remark="not installed: pip install verde")]
    nodes, at = slow(case)
    fitted = peers.green(case.places[nodes], case.values[nodes])
    return [line_of(case, label, fitted, at, f"fitted to {len(nodes)} samples, judged at {len(at)}")]


def hierarchical(case: Case, label: str) -> list[dict]:
    """G+Smo, in a process of its own, which it may take down."""
    try:
        import pygismo  # noqa: F401
    except ImportError:
        return [row(case, label, None, None, remark="not installed: pip install pygismo")]
    if case.noisy:
        return [row(case, label, None, None, remark="left out: it does not stop at the noise")]
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    lattice = case.lattice(STARTS.get(case.name, START))
    child = context.Process(target=in_child, args=(sender, case.places, case.values, case.limit, lattice, case.judged))
    child.start()
    sender.close()
    last, ended, finish = None, "", time.monotonic() + MOST_SECONDS
    try:
        while not ended:
            if receiver.poll(max(0.0, finish - time.monotonic())):
                last = receiver.recv()
            else:
                ended = f"stopped after {MOST_SECONDS:g} s"
    except EOFError:  # the child is done, one way or the other
        child.join()
        ended = f"crashed, exit code {child.exitcode}" if child.exitcode else ""
    child.kill()
    if last is None:
        return [row(case, label, None, None, remark=ended)]
    unknowns, seconds, predicted, remark = last
    return [row(case, label, unknowns, seconds, predicted, remark="; ".join(filter(None, (remark, ended))))]


def in_child(sender: Connection, places: np.ndarray, values: np.ndarray, limit: float, lattice, judged) -> None:
    """Send what G+Smo makes of the samples in each step, as numbers; seconds leave the judging out."""
    for fitted in peers.hierarchical(places, values, limit, lattice, EXTENSION):
        sender.send((fitted.unknowns, fitted.seconds, fitted.evaluate(judged), fitted.remark))
    sender.close()


METHODS: dict[str, Callable[[Case, str], list[dict]]] = {
    "scipy, uniform, sparse": sparse,
    "scipy, uniform, separable": separable,
    "scipy, griddata cubic": triangulated,
    "scipy, RBF": radial,
    "verde, Spline": green,
    "G+Smo, THB-splines (pygismo)": hierarchical,
}


if __name__ == "__main__":
    main(int((sys.argv[1:] or ["0"])[0]), *sys.argv[2:])
