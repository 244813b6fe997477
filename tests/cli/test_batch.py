"""`tsplinejax batch fit`: a model for each file, whatever becomes of the others, and nothing written elsewhere."""

import json
from dataclasses import replace

import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax.cli import _batch
from tsplinejax.cli._main import make_parser
from tsplinejax.data import peaks
from tsplinejax.fitting import StopReason, _batch as _fitting_batch

FIT = ("--tolerance", "0.3")


@pytest.fixture
def maps(tmp_path):
    """A folder of three maps, of which the last is higher, and a file that no reader knows."""
    folder = tmp_path / "maps"
    folder.mkdir()
    for name, factor in (("a", 1), ("b.2", 1), ("c", 3)):
        heights = factor * peaks((30, 36)).heights
        tsj.write(folder / f"{name}.npz", tsj.HeightMap(heights, (0.5, 0.25), "µm"))
    (folder / "notes.md").write_text("notes")
    (folder / ".hidden.npy").touch()
    return folder


def _spoil(folder) -> None:
    """Add files that cannot be fitted."""
    np.save(folder / "all-missing.npy", np.full((9, 9), np.nan))
    (folder / "junk.x3p").write_bytes(b"junk")


def test_every_file_has_a_model_of_its_own(report, maps, tmp_path):
    """The folder is made, and each model and object is what `fit` gives for that file."""
    result = report("batch", "fit", "maps", "-o", "models", *FIT)
    assert sorted(path.name for path in (tmp_path / "models").iterdir()) == ["a.tspl", "b.2.tspl", "c.tspl"]
    assert [item["input"] for item in result["items"]] == ["maps/a.npz", "maps/b.2.npz", "maps/c.npz"]
    assert (result["converged"], result["fitted"], result["failed"]) == (True, 3, 0)
    assert result["skipped"] == ["notes.md"]
    for item in result["items"]:
        alone = report("fit", item["input"], "-o", "alone.tspl", *FIT)
        assert set(item) == set(alone) | {"input"}
        same = ("control_points", "max_error", "stop", "unit", "provenance")
        assert {key: item[key] for key in same} == {key: alone[key] for key in same}
        expected, found = tsj.load("alone.tspl"), tsj.load(item["model"])
        np.testing.assert_array_equal(found.control_points, expected.control_points)


def test_one_bad_file_does_not_stop_the_others(command, maps, tmp_path):
    """Each bad file is one line on standard error and an `error` in the JSON; the exit code is 1."""
    _spoil(maps)
    code, out, err = command("batch", "fit", "maps", "-o", "models", *FIT, "--json")
    result = json.loads(out)
    errors = {item["input"]: item["error"] for item in result["items"] if "error" in item}
    assert (code, result["fitted"], result["failed"], result["converged"]) == (1, 3, 2, False)
    assert set(errors) == {"maps/all-missing.npy", "maps/junk.x3p"}
    assert "is missing" in errors["maps/all-missing.npy"]
    lines = err.splitlines()
    assert len(lines) == 2
    assert lines[0].startswith("tsplinejax: error: all-missing.npy: ")
    assert lines[1].startswith("tsplinejax: error: junk.x3p cannot be read")
    assert len(list((tmp_path / "models").iterdir())) == 3


def test_summary_for_people(command, maps):
    """Without `--json` there is one line a file, and one for the whole."""
    _spoil(maps)
    code, out, _ = command("batch", "fit", "maps", "-o", "models", *FIT)
    lines = out.splitlines()
    assert code == 1
    assert [line.split()[:2] for line in lines[:2]] == [["a.npz", "met:"], ["all-missing.npy", "failed"]]
    assert "left out" in lines[-2]
    assert lines[-1] == "models in models: 3 of 5; criterion met: 3"


def test_stopping_earlier_is_exit_code_1(command, maps):
    """Every model is written, and each file's warnings stand under its name."""
    code, out, err = command("batch", "fit", "maps", "-o", "models", "--tolerance", "1e-6", "--max-steps", 0, "--json")
    result = json.loads(out)
    assert (code, result["fitted"], result["converged"]) == (1, 3, False)
    assert {item["stop"] for item in result["items"]} == {"max_steps"}
    assert all(warning.startswith(("a.npz: ", "b.2.npz: ", "c.npz: ")) for warning in result["warnings"])
    assert err.count("\n") == len(result["warnings"]) >= 3


def test_patterns_choose(report, maps, tmp_path):
    """Only files whose name matches are read."""
    result = report("batch", "fit", "maps", "-o", "models", "--pattern", "[ab]*.npz", *FIT)
    assert [item["input"] for item in result["items"]] == ["maps/a.npz", "maps/b.2.npz"]
    assert result["skipped"] == []


def test_options_of_fit_reach_every_file(report, maps, tmp_path):
    """Data options, method and pictures are those of `fit`; a mask in the folder is not taken for a map."""
    np.save(maps / "mask.npy", np.eye(30, 36))
    options = ("--mask", "maps/mask.npy", "--lattice", "5x4", "--dtype", "float32", "--level", "plane")
    result = report("batch", "fit", "maps", "-o", "models", *FIT, *options, "--plots")
    assert len(result["items"]) == 3
    for item in result["items"]:
        assert item["samples"] == 30 * 36 - 30
        assert item["provenance"]["options"]["lattice"] == [5, 4]
        assert item["provenance"]["options"]["dtype"] == "float32"
        assert any(operation.startswith("level plane") for operation in item["provenance"]["input"]["operations"])
        assert (tmp_path / item["plot"]).read_bytes().startswith(b"\x89PNG")


def test_a_model_may_stand_beside_its_data(report, maps):
    """The folder of the data will do for the models: they are not data, so a second run fits the same files."""
    for _ in range(2):
        assert len(report("batch", "fit", "maps", "-o", "maps", *FIT)["items"]) == 3


MISUSE = [
    ("batch", "required: COMMAND"),
    ("batch fitt", "invalid choice: 'fitt'"),
    ("batch fit", "required: FOLDER, -o/--output"),
    ("batch fit none -o models", "is no folder"),
    ("batch fit maps/a.npz -o models", "for a single file use: tsplinejax fit"),
    ("batch fit empty -o models", "holds no data file"),
    ("batch fit maps -o models --pattern *.x3p", "holds no data file named '*.x3p' among its 4 files"),
    ("batch fit maps -o none/models", "cannot be made"),
    ("batch fit maps -o maps/a.npz", "cannot be made"),
    ("batch fit maps -o maps --plots", "would be read as maps"),
    ("batch fit twice -o models", "a.csv and a.npy would both be written to a.tspl"),
    ("batch fit case -o models", "would both be written to"),
    ("batch fit maps -o models --tolerance 1 --noise auto", "not allowed with argument"),
    ("batch fit bad -o models", "none of the 2 files in bad could be fitted; nothing was written"),
    ("batch fit maps -o models --tolerance -1", "none of the 3 files in maps could be fitted"),
]


@pytest.mark.parametrize(("line", "message"), MISUSE, ids=[line for line, _ in MISUSE])
def test_nothing_to_be_done_is_exit_code_2(command, maps, tmp_path, line, message):
    """Nothing on standard output, no folder left behind, and the last line on standard error says why."""
    for folder, names in {"twice": ("a.csv", "a.npy"), "case": ("A.npy", "a.csv"), "bad": (), "empty": ()}.items():
        (tmp_path / folder).mkdir()
        for name in names:
            (tmp_path / folder / name).touch()
    _spoil(tmp_path / "bad")
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    code, out, err = command(*line.split())
    assert (code, out) == (2, "")
    assert message in err.splitlines()[-1]
    assert all(text.startswith("tsplinejax: error: ") for text in err.splitlines())
    assert {path for path in tmp_path.rglob("*")} == set(before)
    assert all(path.stat().st_mtime_ns == before[path] for path in before if path.is_file())


def test_links_are_replaced_not_followed(report, maps, tmp_path):
    """A link in the output folder that leads out of it does not make the command write there."""
    outside = tmp_path / "outside.tspl"
    outside.write_bytes(b"kept")
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "a.tspl").symlink_to(outside)
    report("batch", "fit", "maps", "-o", "models", *FIT)
    assert outside.read_bytes() == b"kept"
    assert tsj.load(tmp_path / "models" / "a.tspl").is_height_map


def test_a_model_that_cannot_be_written_is_its_files_own_error(command, maps, tmp_path):
    """A folder where a model should go spoils that file alone."""
    (tmp_path / "models" / "b.2.tspl").mkdir(parents=True)
    code, out, err = command("batch", "fit", "maps", "-o", "models", *FIT, "--json")
    result = json.loads(out)
    assert (code, result["fitted"], result["failed"]) == (1, 2, 1)
    assert "is a folder" in result["items"][1]["error"]
    assert err.count("\n") == 1


def test_unexpected_errors_are_one_line_too(command, maps, monkeypatch):
    """A defect of the program's own spoils one file, and says that it is one."""

    def read(path, arguments, _read=_batch.prepared_data):
        return 1 / 0 if path.endswith("a.npz") else _read(path, arguments)

    monkeypatch.setattr(_batch, "prepared_data", read)
    code, _, err = command("batch", "fit", "maps", "-o", "models", *FIT)
    assert (code, err.count("\n")) == (1, 1)
    assert err.startswith("tsplinejax: error: a.npz: unexpected ZeroDivisionError")


def test_interrupting_keeps_what_there_is(command, maps, monkeypatch, tmp_path):
    """After Ctrl-C in the second fit two models are written, and the third file is told to be left."""
    stops = iter([None, StopReason.INTERRUPTED])

    def finished(*arguments, _finished=_fitting_batch.finished, **options):
        result, stop = _finished(*arguments, **options), next(stops)
        return result if stop is None else replace(result, stop=stop, converged=False)

    monkeypatch.setattr(_fitting_batch, "finished", finished)
    code, out, err = command("batch", "fit", "maps", "-o", "models", *FIT, "--json")
    result = json.loads(out)
    assert code == 1
    assert [item.get("stop") for item in result["items"]] == ["tolerance", "interrupted", None]
    assert "interrupted before its turn" in result["items"][2]["error"]
    assert "files that were not fitted: 1" in err
    assert sorted(path.name for path in (tmp_path / "models").iterdir()) == ["a.tspl", "b.2.tspl"]


def test_interrupting_before_a_result_writes_nothing(command, maps, monkeypatch, tmp_path):
    """Ctrl-C while the first file is read leaves no folder behind."""

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(_batch, "prepared_data", interrupted)
    code, out, err = command("batch", "fit", "maps", "-o", "models")
    assert (code, out) == (2, "")
    assert "interrupted" in err
    assert not (tmp_path / "models").exists()


def test_help_ends_with_an_example(command):
    """The help of the group and of its command show a line to type, whose words the parser knows."""
    for words in (("batch",), ("batch", "fit")):
        code, out, err = command(*words, "--help")
        example = " ".join(out.split()).rpartition("tsplinejax ")[2].split()
        assert (code, err) == (0, "")
        assert make_parser().parse_args(example).command == "batch"


def test_batch_takes_every_option_of_fit(command):
    """Whatever option `fit` has, `batch fit` has, but for those of one fit alone: its files, and a map left on disk."""
    options = [{word for word in command(*words, "--help")[1].split() if word.startswith("--")} for words in HELPS]
    assert options[0] - options[1] == {"--plot", "--checkpoint", "--max-memory"}
    assert options[1] - options[0] == {"--plots", "--pattern"}


HELPS = (("fit",), ("batch", "fit"))
