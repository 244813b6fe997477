"""Damaged and hostile compressed files: each is refused with a clear error or decodes, in little time and memory.

    python bench/bench_hostile.py [FILES] [SEED]

Mutants are those of `tests/codec/mutants.py`: flipped bits, truncation, splices, and, with a right checksum around
them, other headers and other coded numbers.
"""

import importlib.util
import resource
import sys
import time
from collections import Counter
from pathlib import Path

import jax
import numpy as np
from reporting import keep

jax.config.update("jax_enable_x64", True)

import tsplinejax as tsj  # noqa: E402
from tsplinejax.data import peaks  # noqa: E402

MUTANTS = Path(__file__).parents[1] / "tests" / "codec" / "mutants.py"


def main(files: str = "100000", seed: str = "0") -> None:
    """Decode mutants of five small files."""
    spec = importlib.util.spec_from_file_location("mutants", MUTANTS)
    assert spec is not None
    assert spec.loader is not None
    mutants = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(mutants)
    rng, originals = np.random.default_rng(int(seed)), list(_originals().items())
    outcomes: Counter[tuple[str, str]] = Counter()
    slowest = dict.fromkeys((name for name, _ in originals), 0.0)
    for _, content in originals:
        tsj.decompress(content)
    before = _memory()
    for k in range(int(files)):
        name, content = originals[k % len(originals)]
        started = time.process_time()
        outcomes[name, _outcome(mutants.mutant(content, rng))] += 1
        slowest[name] = max(slowest[name], time.process_time() - started)
        if k % 1000 == 999:
            print(k + 1, sum(n for (_, what), n in outcomes.items() if what == "other"), _memory(), file=sys.stderr)
    rows = [
        {
            "mode": name,
            "bytes": len(content),
            "refused": outcomes[name, "refused"],
            "decoded": outcomes[name, "decoded"],
            "other": outcomes[name, "other"],
            "slowest s": slowest[name],
        }
        for name, content in originals
    ]
    keep("hostile", rows, files=int(files), seed=int(seed), memory_growth_MB=_memory() - before)


def _originals() -> dict[str, bytes]:
    """One file of each kind."""
    heights = peaks((40, 50)).heights.copy()
    holed = heights.copy()
    holed[10:14, 20:23] = np.nan
    data = tsj.HeightMap(holed, (0.5, 0.25), "µm", origin=(3.0, -2.0), provenance={"name": "peaks.npz"})
    wide = tsj.HeightMap(peaks((120, 160)).heights)
    return {
        "grid": tsj.compress(data, max_error=0.01, mode="grid"),
        "grid, float32": tsj.compress(data, max_error=0.001, mode="grid", dtype="float32"),
        "lossless": tsj.compress(data, max_error=0.0),
        "model": tsj.compress(data, max_error=0.05, mode="model"),
        "model, corrected": tsj.compress(wide, relative_max_error=0.001),
    }


def _outcome(content: bytes) -> str:
    """What happens to a file."""
    try:
        tsj.decompress(content)
    except tsj.InputError:
        return "refused"
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        return "other"
    return "decoded"


def _memory() -> float:
    """Largest memory of the process so far, in MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


if __name__ == "__main__":
    main(*sys.argv[1:])
