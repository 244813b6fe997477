"""Many maps at once: over one shared space against one after the other, and with meshes of their own.

Shared: 256 maps of 256 × 256 over the adaptive mesh of a fit to the first. The peers run over the same space: `lstsq`
for each map alone, and the shared fit of one map at a time, which factorises anew for each. Own meshes: 64 maps of one
shape, and what is compiled after the first.
"""

import sys
import time

import jax
import numpy as np
from reporting import keep

jax.config.update("jax_enable_x64", True)

import tsplinejax as tsj  # noqa: E402
from tsplinejax.data import plate_with_particles  # noqa: E402

SHAPE = (256, 256)
TOLERANCE = 0.05
COMPILED = "/jax/core/compile/backend_compile_duration"


def main(shared: int = 256, own: int = 64, repeats: int = 3, alone: int = 8) -> None:
    """Time both kinds of batches; peers are timed on `alone` maps, and told by the map."""
    maps = plates(shared)
    first = tsj.fit(maps[0], relative_tolerance=TOLERANCE)
    rows, times = shared_rows(maps, first.surface.space, repeats, alone)
    row, compiled = own_row(own)
    keep(
        "batch",
        [*rows, row],
        shared_over_lstsq=round(times["lstsq"] / times["shared"], 1),
        shared_over_factorising_each=round(times["one at a time"] / times["shared"], 1),
        compilations_after_the_first_of_the_own_meshes=compiled,
    )


def plates(count: int) -> np.ndarray:
    """Measurements of one plate: its particles stay, waviness and noise change from map to map."""
    generator = np.random.default_rng(0)
    plate = plate_with_particles(SHAPE).heights
    t, s = np.meshgrid(*(np.linspace(0, 1, length) for length in SHAPE), indexing="ij")
    k, phase, height = (generator.uniform(0, high, (count, 1, 1)) for high in (6, 6, 0.3))
    noise = 0.002 * generator.normal(size=(count, *SHAPE))
    return plate + height * np.sin(k * s + (6 - k) * t + phase) + noise


def shared_rows(maps: np.ndarray, space: tsj.SplineSpace, repeats: int, alone: int) -> tuple[list[dict], dict]:
    """All maps together, and the peers; seconds a map are the fastest of a few times."""
    t, s = np.meshgrid(*(np.linspace(0, 1, length) for length in SHAPE), indexing="ij")
    places = np.stack([s.ravel(), t.ravel()], axis=1)

    def separately() -> np.ndarray:
        return np.stack([tsj.lstsq(space, places, heights.ravel()) for heights in maps[:alone]])

    def one_at_a_time() -> np.ndarray:
        fits = [tsj.fit_shared(heights[None], space, smoothing=0) for heights in maps[:alone]]
        return np.concatenate([one.control_points for one in fits])

    def together() -> np.ndarray:
        return tsj.fit_shared(maps, space, smoothing=0).control_points

    ways = {"shared": (together, len(maps)), "one at a time": (one_at_a_time, alone), "lstsq": (separately, alone)}
    results = {name: fastest(way, repeats) for name, (way, _) in ways.items()}
    times = {name: results[name][0] / count for name, (_, count) in ways.items()}
    exact = results["lstsq"][1]
    rows = [
        {
            "batch": {"shared": "shared space", "one at a time": "shared fit of one map", "lstsq": "lstsq"}[name],
            "maps": count,
            "control points": int(space.n_functions),
            "seconds": results[name][0],
            "milliseconds a map": 1e3 * times[name],
            "difference from lstsq": float(np.abs(results[name][1][:alone] - exact[: len(maps)]).max()),
        }
        for name, (_, count) in ways.items()
    ]
    return rows, times


def fastest(way, repeats: int) -> tuple[float, np.ndarray]:
    """Seconds of the fastest of a few runs, after one that compiles; and what it gives."""
    value, seconds = way(), []
    for _ in range(repeats):
        started = time.perf_counter()
        value = way()
        seconds.append(time.perf_counter() - started)
    return min(seconds), value


def own_row(count: int) -> tuple[dict, int]:
    """Maps with meshes of their own, and the number of compilations after the first map."""
    events: list[str] = []

    def listen(event: str, duration: float, **details: object) -> None:
        if event == COMPILED:
            events.append(event)

    generator = np.random.default_rng(1)
    maps = [plate_with_particles((128, 128), particles=int(generator.integers(2, 9)), seed=k) for k in range(count + 1)]
    outcomes = tsj.fit_batch(maps, relative_tolerance=TOLERANCE)
    next(outcomes)
    jax.monitoring.register_event_duration_secs_listener(listen)
    started = time.perf_counter()
    results = [item.result for item in outcomes if item.result is not None]
    seconds = time.perf_counter() - started
    jax.monitoring.unregister_event_duration_listener(listen)
    assert len(results) == count
    points = [result.control_points for result in results]
    return {
        "batch": "own meshes, 128 × 128",
        "maps": count,
        "control points": f"{min(points)} to {max(points)}",
        "seconds": seconds,
        "milliseconds a map": 1e3 * seconds / count,
        "difference from lstsq": None,
    }, len(events)


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
