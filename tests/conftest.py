"""Fixtures for all tests: the two precision lanes, their tolerances, and the measured surfaces."""

from collections.abc import Callable
from pathlib import Path

import hypothesis
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]

# Examples are drawn from a fixed seed, and a first example that compiles a kernel is not a slow example.
hypothesis.settings.register_profile("tsplinejax", deadline=None, derandomize=True, print_blob=True)
hypothesis.settings.load_profile("tsplinejax")


@pytest.fixture(params=["float64", "float32"])
def dtype(request: pytest.FixtureRequest) -> np.dtype:
    """Both precisions: a test that takes this fixture runs once in each lane."""
    return np.dtype(request.param)


@pytest.fixture(scope="session")
def tolerance_of() -> Callable[..., float]:
    """Map a dtype to the relative tolerance that its rounding allows, times `factor` for ill-conditioned quantities."""

    def tolerance(dtype: np.typing.DTypeLike, factor: float = 1.0) -> float:
        # About 5000 roundings: 1e-12 in float64, 6e-4 in float32.
        return factor * 5000 * float(np.finfo(dtype).eps)

    return tolerance


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of measured surfaces beside the repository; tests that need it are skipped where it is absent."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("no measured surfaces: the folder shared/data is not beside the repository")
    return folder
