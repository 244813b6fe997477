"""What tests and docstrings' examples need before anything else: double precision, and pictures drawn off screen."""

import os
from pathlib import Path

import jax
import pytest

os.environ.setdefault("MPLBACKEND", "Agg")
jax.config.update("jax_enable_x64", True)

_MAPS = Path("/proc/self/maps")
# Linux ends a process that asks for more than 65 530 memory maps, and every compiled kernel takes some.
_MOST_MAPS = 30_000


@pytest.fixture(autouse=True, scope="module")
def _compiled_kernels_are_let_go():
    """A process that runs most of the tests compiles thousands of kernels: after a module it lets go of them."""
    yield
    if _MAPS.exists() and _MAPS.read_bytes().count(b"\n") > _MOST_MAPS:
        jax.clear_caches()
