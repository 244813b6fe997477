"""Damaged and hostile compressed files: each is refused with a clear error or decodes, in little time and memory.

    python bench/bench_hostile.py [FILES] [SEED] [SECONDS]

Mutants are those of `tests/codec/mutants.py`: flipped bits, truncation, splices, and, with a right checksum around
them, other headers and other coded numbers. To them come the bombs of `tests/codec/bombs.py`, small files that ask for
much memory. Memory is judged file by file: the largest that the process takes while it reads one, less what it held
before and less the heights that come back. The file's own need is counted only where it decodes.
"""

import importlib.util
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import jax
import numpy as np
from reporting import keep

jax.config.update("jax_enable_x64", True)

import tsplinejax as tsj  # noqa: E402
from tsplinejax.data import peaks  # noqa: E402

HOSTILE = Path(__file__).parents[1] / "tests" / "codec"


@dataclass
class Tally:
    """What became of the files of one kind."""

    refused: int = 0
    decoded: int = 0
    other: int = 0
    slowest: float = 0.0
    beyond: list[float] = field(default_factory=list)

    def add(self, content: bytes, peak: ModuleType) -> None:
        """Read one file."""
        started = time.process_time()
        (what, need), taken = peak.with_peak(lambda: _outcome(content))
        setattr(self, what, getattr(self, what) + 1)
        self.slowest = max(self.slowest, time.process_time() - started)
        self.beyond.append(taken - need)

    def row(self, name: str, size: int) -> dict[str, Any]:
        """The figures."""
        return {
            "mode": name,
            "bytes": size,
            "refused": self.refused,
            "decoded": self.decoded,
            "other": self.other,
            "slowest s": self.slowest,
            "99.9 % below MB": float(np.quantile(self.beyond, 0.999)),
            "largest MB": max(self.beyond),
        }


def main(files: str = "100000", seed: str = "0", seconds: str = "inf") -> None:
    """Decode mutants of five small files, as many as time allows, and the bombs."""
    mutants, bombs, peak = (_module(name) for name in ("mutants", "bombs", "peak"))
    rng, originals = np.random.default_rng(int(seed)), list(_originals().items())
    for _, content in originals:
        tsj.decompress(content)
    tallies = {name: Tally() for name, _ in originals}
    started, done = time.monotonic(), 0
    while done < int(files) and time.monotonic() - started < float(seconds):
        name, content = originals[done % len(originals)]
        tallies[name].add(mutants.mutant(content, rng), peak)
        done += 1
        if done % 1000 == 0:
            print(done, {name: max(tally.beyond) for name, tally in tallies.items()}, file=sys.stderr)
    rows = [tallies[name].row(name, len(content)) for name, content in originals]
    entries = [mutants.parts(dict(originals)[name])[0] for name in ("grid", "model")]
    for name, content in bombs.bombs(*entries).items():
        tally = Tally()
        tally.add(content, peak)
        rows.append(tally.row(name, len(content)))
    keep("hostile", rows, files=done, seed=int(seed))


def _module(name: str) -> ModuleType:
    """A module beside the tests of the codec."""
    spec = importlib.util.spec_from_file_location(name, HOSTILE / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


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


def _outcome(content: bytes) -> tuple[str, float]:
    """What happens to a file, and the MB of the heights that come back."""
    try:
        data = tsj.decompress(content)
    except tsj.InputError:
        return "refused", 0.0
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        return "other", 0.0
    return "decoded", data.heights.nbytes / 1e6


if __name__ == "__main__":
    main(*sys.argv[1:])
