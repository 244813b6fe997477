"""Running the loop to its end: the best step, a progress bar, and trials of start lattices.

Dyadic refinement reaches only spacings that are the start lattice's over powers of two. Where a surface's features want a
spacing between two of them, a lattice with another number of elements to the octave saves up to a quarter of the control
points; which one cannot be told without trying.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from ..mesh import Direction
from ._adaptive import State, advance, begin, polish, terminate
from ._problem import Problem, restart, scaled_lattice
from ._result import StopReason

# Elements along the shorter side, one for each part of an octave; eight is also the default lattice's.
TRIALS = (8, 5, 11, 6, 7)


def run(problem: Problem, *, progress: bool = False) -> tuple[State, StopReason]:
    """Advance until a reason to stop; the best state by the user's criterion."""
    best = state = begin(problem)
    stop = terminate(problem, state)
    try:
        with _progress_bar(progress) as report:
            while stop is None:
                report(state)
                state = advance(problem, state)
                best = state if state.worst <= best.worst else replace(best, history=state.history)
                stop = terminate(problem, state)
            if state.worst > 1 and not state.polished and stop is not StopReason.MAX_SECONDS:
                state = polish(problem, state)
                best = state if state.worst <= best.worst else replace(best, history=state.history)
                if state.worst <= 1:
                    stop = problem.criterion.met
    except KeyboardInterrupt:
        stop = StopReason.INTERRUPTED
    return best, stop


@contextmanager
def _progress_bar(shown: bool) -> Iterator[Callable[[State], None]]:
    """A bar that counts down the decades from the first excess to one, on standard error."""
    if not shown:
        yield lambda state: None
        return
    from tqdm import tqdm

    with tqdm(total=1.0, bar_format="{l_bar}{bar}| {elapsed}{postfix}", leave=False) as bar:
        first: list[float] = []

        def report(state: State) -> None:
            first.append(max(state.worst, 1.0 + 1e-9))
            done = 1 - np.log(max(state.worst, 1.0)) / np.log(first[0])
            last = state.history[-1]
            bar.set_postfix_str(f"{last.control_points} control points, max error {last.max_error:.4g}")
            bar.update(max(0.0, float(done) - bar.n))

        yield report


def run_best_lattice(problem: Problem, *, progress: bool = False) -> tuple[Problem, State, StopReason]:
    """The run over the start lattice, and with the first cut, that needs the fewest control points.

    A trial is given up once it has more control points than the best one so far.
    """
    best: tuple[Problem, State, StopReason] | None = None
    for elements in TRIALS:
        lattice = scaled_lattice(problem.data.frame, elements)
        best = _better(best, restart(problem, lattice, "s"), progress)
    assert best is not None
    forest = best[0].start.forest
    assert forest is not None
    return _better(best, restart(problem, forest.lattice, "t"), progress)


def _better(
    best: tuple[Problem, State, StopReason] | None, trial: Problem, progress: bool
) -> tuple[Problem, State, StopReason]:
    """The better of the best run so far and one more trial."""
    allowed = trial
    if best is not None and best[1].worst <= 1:
        fewest = best[1].history[-1].control_points - 1
        if trial.start.n_anchors > fewest:
            return best
        limit = trial.budget.max_control_points
        budget = replace(trial.budget, max_control_points=fewest if limit is None else min(limit, fewest))
        allowed = replace(trial, budget=budget)
    state, stop = run(allowed, progress=progress)
    if best is None or state.worst < min(best[1].worst, 1.0) or (state.worst <= 1 < best[1].worst):
        return trial, state, stop
    met = state.worst <= 1 and best[1].worst <= 1
    fewer = state.history[-1].control_points < best[1].history[-1].control_points
    return (trial, state, stop) if met and fewer else best
