"""Running the loop to its end: the best step, a progress bar, and trials of start lattices.

Dyadic refinement reaches only spacings that are the start lattice's over powers of two. Where a surface's features want
a spacing between two of them, a lattice with another number of elements to the octave saves up to a quarter of the
control points; which one cannot be told without trying.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from ._adaptive import State, advance, begin, polish, revived, taken_back, terminate
from ._checkpoint import Checkpoint
from ._problem import Problem, restart, scaled_lattice
from ._result import Step, StopReason

# Elements along the shorter side, one for each part of an octave; eight is also the default lattice's.
TRIALS = (8, 5, 11, 6, 7)


@dataclass(frozen=True, eq=False)
class Run:
    """How a run ended.

    **Attributes:**

    - `best`: the best state by the user's criterion; its own last history entry describes it.
    - `history`: all steps.
    - `stop`: why it ended.
    """

    best: State
    history: tuple[Step, ...]
    stop: StopReason

    @property
    def converged(self) -> bool:
        """Whether the criterion was met."""
        return self.best.worst <= 1


def run(problem: Problem, *, progress: bool = False, checkpoint: Checkpoint | None = None) -> Run:
    """Advance until there is a reason to stop.

    Steps solve loosely. On polynomial surfaces a long solve has its chance before the loop gives up for want of
    elements to split, and at the end; one that no longer meets the criterion (least squares does not minimise the
    largest error) is not kept. A checkpoint is of the step before that last solve, which a resumed run has no use for.
    """
    checkpoint = checkpoint or Checkpoint(None, problem)
    state, best = checkpoint.restored() or _begun(problem)
    try:
        with checkpoint, _progress_bar(progress) as report:
            while True:
                report(state)
                checkpoint.keep(state, best)
                stop = terminate(problem, state)
                if stop is StopReason.FINEST and not problem.rational and not state.polished:
                    state = _polished(problem, state)
                elif stop is None:
                    state = advance(problem, state)
                else:
                    break
                best = state if state.worst <= best.worst else best
        if state.worst <= 1:
            best = state
        if not (problem.rational or state.polished or stop is StopReason.MAX_SECONDS):
            state = _polished(problem, state, max(1.0, best.worst))
            best = state if state.worst <= max(1.0, best.worst) else best
            stop = problem.criterion.met if best.worst <= 1 else stop
    except KeyboardInterrupt:
        stop = StopReason.INTERRUPTED
    return Run(revived(problem, best), state.history, stop)


def _begun(problem: Problem) -> tuple[State, State]:
    """The start lattice, which is the best state so far."""
    state = begin(problem)
    return state, state


def _polished(problem: Problem, state: State, limit: float = np.inf) -> State:
    """The state after a long solve, or as it was where that exceeds the limit."""
    polished = polish(problem, state)
    return polished if polished.worst <= limit else taken_back(problem, polished, state)


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


def run_best_lattice(problem: Problem, *, progress: bool = False) -> tuple[Problem, Run]:
    """The run over the start lattice, and with the first cut, that needs the fewest control points.

    A trial is given up once it has more control points than the best one so far.
    """
    best: tuple[Problem, Run] | None = None
    for elements in TRIALS:
        lattice = scaled_lattice(problem.source.frame, elements)
        best = _better(best, restart(problem, lattice, "s"), progress)
    assert best is not None
    forest = best[0].start.forest
    assert forest is not None
    return _better(best, restart(problem, forest.lattice, "t"), progress)


def _better(best: tuple[Problem, Run] | None, trial: Problem, progress: bool) -> tuple[Problem, Run]:
    """The better of the best run so far and one more trial."""
    if best is None:
        return trial, run(trial, progress=progress)
    allowed = trial
    if best[1].converged:
        fewest = best[1].best.mesh.tmesh.n_anchors - 1
        if trial.start.n_anchors > fewest:
            return best
        limit = trial.budget.max_control_points
        budget = replace(trial.budget, max_control_points=fewest if limit is None else min(limit, fewest))
        allowed = replace(trial, budget=budget)
    outcome = run(allowed, progress=progress)
    if best[1].converged:
        return (trial, outcome) if outcome.converged else best
    return (trial, outcome) if outcome.best.worst < best[1].best.worst else best
