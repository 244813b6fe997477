"""Where a step's time goes."""

import time
from typing import Any

import jax

from ._result import Step

STAGES = ("topology", "functions", "moments", "solve", "residuals")


class Stopwatch:
    """Seconds per stage of a step, the device's work included: a lap waits until its results are there.

    A watch that continues a step goes on from that step's seconds.
    """

    def __init__(self, step: Step | None = None) -> None:
        self.stages: dict[str, float] = dict.fromkeys(STAGES, 0.0)
        if step is not None:
            self.stages.update(step.stages)
        self._started = time.perf_counter() - (0.0 if step is None else step.seconds)
        self._last = time.perf_counter()

    @property
    def seconds(self) -> float:
        """Since the step began."""
        return time.perf_counter() - self._started

    def lap(self, stage: str, results: Any = None) -> None:
        """The stage ends once these results are ready."""
        jax.block_until_ready(results)
        now = time.perf_counter()
        self.stages[stage] += now - self._last
        self._last = now
