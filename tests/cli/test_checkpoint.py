"""`tsplinejax fit --checkpoint`: the same command goes on where it was stopped, and writes the same model."""

import json
import os
import signal

import pytest

from tsplinejax.cli import _fit
from tsplinejax.fitting import _run

WORDS = ("fit", "map.npz", "--tolerance", "0.03")


def test_the_same_command_goes_on(command, report, height_map, tmp_path, monkeypatch):
    """Stopped by a budget, then run without: the model's bytes are those of a single run, and the file is gone."""
    report(*WORDS, "-o", "whole.tspl")
    words = (*WORDS, "-o", "m.tspl", "--checkpoint", "fit.ckpt")
    code, out, _ = command(*words, "--max-steps", "3")
    assert code == 1
    assert "fit.ckpt: the next fit goes on from it" in out
    assert (tmp_path / "fit.ckpt").exists()
    assert (tmp_path / "m.tspl").exists()
    monkeypatch.setattr(_run, "begin", lambda _: pytest.fail("began anew"))
    assert report(*words)["checkpoint"] is None
    assert (tmp_path / "m.tspl").read_bytes() == (tmp_path / "whole.tspl").read_bytes()
    assert not (tmp_path / "fit.ckpt").exists()


def test_a_model_that_cannot_be_written_costs_no_checkpoint(command, height_map, tmp_path, monkeypatch):
    """Where saving fails, the checkpoint of the finished fit is still there."""

    def failing(*_):
        raise OSError("no space left on device")

    monkeypatch.setattr(_fit, "save", failing)
    code, _, err = command(*WORDS, "-o", "m.tspl", "--checkpoint", "fit.ckpt")
    assert code == 2
    assert "no space left" in err
    assert (tmp_path / "fit.ckpt").exists()


@pytest.mark.usefixtures("interruptible")
def test_interrupting_leaves_model_and_checkpoint(command, report, height_map, tmp_path, monkeypatch):
    """After Ctrl-C the best model is written, and the next run goes on from the last step."""

    def interrupting(problem, state, _advance=_run.advance):
        if state.history[-1].step == 2:
            os.kill(os.getpid(), signal.SIGINT)
        return _advance(problem, state)

    words = (*WORDS, "-o", "m.tspl", "--checkpoint", "fit.ckpt")
    with monkeypatch.context() as patched:
        patched.setattr(_run, "advance", interrupting)
        code, out, _ = command(*words, "--json")
    stopped = json.loads(out)
    assert (code, stopped["stop"], stopped["checkpoint"]) == (1, "interrupted", "fit.ckpt")
    assert (tmp_path / "m.tspl").exists()
    went_on = report(*words)
    untimed = [[{**step, "seconds": 0, "stages": 0} for step in told["history"]] for told in (stopped, went_on)]
    assert untimed[1][:3] == untimed[0][:3]
    assert went_on["converged"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("-o m.tspl --checkpoint map.npz", "is the input or an output"),
        ("-o m.tspl --checkpoint m.tspl", "is the input or an output"),
        ("-o m.tspl --checkpoint none/fit.ckpt", "in a folder that exists"),
        ("-o m.tspl --checkpoint cloud.npy", "another file"),
        ("-o m.tspl --checkpoint fit.ckpt --lattice auto", "makes several"),
    ],
)
def test_misuse(command, height_map, cloud, tmp_path, words, message):
    """One line says what is wrong, and no file is touched."""
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    code, out, err = command("fit", "map.npz", *words.split())
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert message in err
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
