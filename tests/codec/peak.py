"""Peak memory of one call, as the system counts it: resident pages, those of compiled code included."""

import ctypes
import os
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

_PEAK, _STATUS = Path("/proc/self/clear_refs"), Path("/proc/self/status")
Result = TypeVar("Result")


def is_known() -> bool:
    """Whether the system tells: Linux with the GNU C library."""
    return os.access(_PEAK, os.W_OK) and hasattr(ctypes.CDLL(None), "malloc_trim")


def with_peak(call: Callable[[], Result]) -> tuple[Result, float]:
    """What a call returns, and by how many MB memory grew at its largest."""
    # Pages that were freed but kept would hide what the call takes.
    ctypes.CDLL(None).malloc_trim(0)
    before = _resident("VmRSS")
    _PEAK.write_text("5")
    result = call()
    return result, _resident("VmHWM") - before


def _resident(name: str) -> float:
    """An entry of the process's status, in MB."""
    line = next(line for line in _STATUS.read_text().splitlines() if line.startswith(name))
    return int(line.split()[1]) * 1024 / 1e6
