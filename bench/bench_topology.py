"""Host topology: one refinement step against everything found anew, and peak memory of shallow and deep meshes."""

import time
import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np
from reporting import keep

from tsplinejax.mesh import MAX_LEVEL, AnalysisSuitable, TMesh, b_lattice, bisect, forest_from_boxes, refine
from tsplinejax.space import bezier_elements
from tsplinejax.space._update import refine_elements

REPEATS = 5
SHARE = 0.1
LIMIT = 0.5  # seconds for a step that marks 10 000 of 100 000 elements


def seconds(work: Callable[[], Any]) -> float:
    """Shortest of several runs."""
    times = []
    for _ in range(REPEATS):
        started = time.perf_counter()
        work()
        times.append(time.perf_counter() - started)
    return min(times)


def ring_first(tmesh: TMesh, count: int) -> np.ndarray:
    """Marks on the elements nearest to a circle, larger ones first: what a crease in a surface asks for."""
    s0, t0, s1, t1 = tmesh.element_boxes.T
    distance = abs(np.hypot((s0 + s1) / 2 - 0.45, (t0 + t1) / 2 - 0.45) - 0.3)
    nearest = np.argsort(distance * 2.0 ** (tmesh.levels / 4), kind="stable")[:count]
    return np.isin(np.arange(tmesh.n_elements), nearest)


def scattered(tmesh: TMesh, count: int) -> np.ndarray:
    """Marks on elements here and there, which alters functions everywhere."""
    return np.isin(np.arange(tmesh.n_elements), np.random.default_rng(0).permutation(tmesh.n_elements)[:count])


def ring_mesh(elements: int) -> TMesh:
    """A mesh of about so many elements, fine along a circle."""
    tmesh = b_lattice(16, 16)
    while tmesh.n_elements < elements:
        wanted = min(tmesh.n_elements // 8, max(8, (elements - tmesh.n_elements) // 2))
        tmesh = refine(tmesh, ring_first(tmesh, wanted)).mesh
    return tmesh


def deep_mesh(points: int) -> TMesh:
    """A mesh that reaches the deepest level at some points, and stays coarse elsewhere."""
    tmesh = b_lattice(8, 8)
    places = (np.random.default_rng(0).random((points, 2)) * tmesh.extent).astype(np.int64)
    places[0] = 0
    for _ in range(MAX_LEVEL):
        marked = np.zeros(tmesh.n_elements, bool)
        marked[tmesh.locate(*places.T)] = True
        tmesh = refine(tmesh, marked & (tmesh.levels < MAX_LEVEL)).mesh
    return tmesh


def seen_first(tmesh: TMesh) -> TMesh:
    """The same mesh without a memory of the one before."""
    assert tmesh.forest is not None
    return forest_from_boxes(tmesh.boxes, tmesh.forest.lattice, first_cut=tmesh.forest.first_cut, border=tmesh.border)


def step_row(tmesh: TMesh, label: str, marked: np.ndarray) -> dict[str, Any]:
    """Seconds for one refinement step, part by part, and for the refined mesh found anew."""
    tmesh = seen_first(tmesh)
    elements = bezier_elements(tmesh)
    rule = AnalysisSuitable()
    chosen = rule.complete(tmesh, marked)
    step = bisect(tmesh, chosen)
    whole = seconds(lambda: refine_elements(elements, tmesh, refine(tmesh, marked)))
    anew = seen_first(step.mesh)
    return {
        "marked where": label,
        "elements": tmesh.n_elements,
        "anchors": tmesh.n_anchors,
        "bezier": len(elements),
        "level": int(tmesh.levels.max()),
        "marked": int(marked.sum()),
        "bisected": int(chosen.sum()),
        "closure_s": seconds(lambda: rule.complete(tmesh, marked)),
        "bisect_s": seconds(lambda: bisect(tmesh, chosen)),
        "update_s": seconds(lambda: refine_elements(elements, tmesh, step)),
        "step_s": whole,
        "anew_s": seconds(lambda: bezier_elements(seen_first(anew))),
        "bezier_anew_s": seconds(lambda: bezier_elements(anew)),
    }


def memory_row(tmesh: TMesh) -> dict[str, Any]:
    """Peak traced memory for a mesh found anew, and for a step that bisects a tenth of it."""
    tracemalloc.start()
    tmesh = seen_first(tmesh)
    elements = bezier_elements(tmesh)
    anew = tracemalloc.get_traced_memory()[1]
    tracemalloc.reset_peak()
    splittable = np.flatnonzero(tmesh.levels < MAX_LEVEL)
    marked = np.zeros(tmesh.n_elements, bool)
    marked[splittable[: int(SHARE * tmesh.n_elements)]] = True
    refine_elements(elements, tmesh, refine(tmesh, marked))
    step = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return {
        "elements": tmesh.n_elements,
        "level": int(tmesh.levels.max()),
        "anew_mib": anew / 2**20,
        "step_mib": step / 2**20,
        "anew_bytes_per_element": anew / tmesh.n_elements,
        "step_bytes_per_element": step / tmesh.n_elements,
    }


def main() -> None:
    """Steps on growing meshes, then memory against elements at two depths."""
    rows = []
    for size in (1_000, 10_000, 30_000, 100_000):
        tmesh = ring_mesh(size)
        for label, marks in (("ring", ring_first), ("scattered", scattered)):
            rows.append(step_row(tmesh, label, marks(tmesh, int(SHARE * size))))
        rows.append(step_row(tmesh, "one", ring_first(tmesh, 1)))
    largest = [row for row in rows if row["elements"] >= 100_000 and row["marked"] >= 10_000]
    line = "; ".join(f"{row['marked where']} {row['step_s']:.3f} s" for row in largest)
    keep("topology", rows, ten_thousand_of_a_hundred_thousand=f"{line} (limit {LIMIT} s)")
    meshes = [b_lattice(size, size) for size in (32, 100, 316)] + [deep_mesh(points) for points in (1, 8, 70)]
    keep("topology_memory", [memory_row(tmesh) for tmesh in meshes])


if __name__ == "__main__":
    main()
