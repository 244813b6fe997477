"""The program as a process: help, exit codes, streams, and the cache of compiled kernels."""

import os
import subprocess
import sys
from pathlib import Path

import jax
import pytest

from tsplinejax.cli import _environment
from tsplinejax.cli._arguments import joined_negatives
from tsplinejax.cli._main import make_parser

ROOT = Path(__file__).resolve().parents[2]
COMMANDS = ("fit", "evaluate", "info", "convert", "plot", "demo")


def _process(*words, **environment):
    return subprocess.run(
        [sys.executable, "-m", "tsplinejax", *words],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
    )


def test_process_fits_in_double_precision_and_keeps_kernels(height_map, tmp_path):
    """x64 mode is on without being asked for, the exit code is the process's, and the cache is where it was named."""
    environment = {"TSPLINEJAX_CACHE": str(tmp_path / "cache"), "JAX_COMPILATION_CACHE_DIR": ""}
    run = _process("fit", "map.npz", "-o", "m.tspl", "--tolerance", "0.3", **environment)
    assert (run.returncode, run.stderr) == (0, "")
    assert "m.tspl" in run.stdout
    assert any((tmp_path / "cache").iterdir())


def test_process_refuses_in_one_line_whatever_the_terminal(tmp_path):
    """Letters that the terminal has not are replaced, not stumbled over."""
    run = _process("info", "µ.npy", PYTHONIOENCODING="ascii")
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr.startswith("tsplinejax: error: ")
    assert run.stderr.count("\n") == 1


@pytest.mark.parametrize("name", COMMANDS)
def test_help_ends_with_an_example(command, name):
    """Every command's help shows a line to type, whose words the parser knows."""
    code, out, err = command(name, "--help")
    assert (code, err) == (0, "")
    example = out.rstrip().splitlines()[-1].split()
    assert example[:2] == ["tsplinejax", name]
    assert make_parser().parse_args(example[1:]).command == name


def test_version_and_help(command):
    """Both end well, on standard output."""
    assert command("--version")[:2] == (0, "tsplinejax 0.1.0\n")
    assert "exit codes" in command("--help")[1]


def test_negative_numbers_are_values():
    """A leading minus after an option is its value, not another option."""
    assert joined_negatives(["--crop", "-1,-2,3,4"]) == ["--crop=-1,-2,3,4"]
    assert joined_negatives(["--json", "-o", "a", "--x=1", "-2"]) == ["--json", "-o", "a", "--x=1", "-2"]


def test_cache_folder(monkeypatch, tmp_path):
    """The user's own cache folder by default; the variable names another or turns it off."""
    monkeypatch.delenv("TSPLINEJAX_CACHE")
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert _environment.cache_folder() == tmp_path / "tsplinejax" / "jax"
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    assert _environment.cache_folder() == Path.home() / ".cache" / "tsplinejax" / "jax"
    monkeypatch.setenv("TSPLINEJAX_CACHE", str(tmp_path / "here"))
    assert _environment.cache_folder() == tmp_path / "here"
    monkeypatch.setenv("TSPLINEJAX_CACHE", "off")
    assert _environment.cache_folder() is None


def test_unusable_cache_folder_is_tolerated(monkeypatch, tmp_path):
    """Where the folder cannot be made, kernels are compiled each time and nothing else changes."""
    (tmp_path / "file").touch()
    monkeypatch.setenv("TSPLINEJAX_CACHE", str(tmp_path / "file" / "cache"))
    before = jax.config.jax_compilation_cache_dir
    _environment.prepare_jax()
    assert jax.config.jax_compilation_cache_dir == before
