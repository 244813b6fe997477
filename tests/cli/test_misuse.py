"""Bad use and bad input: exit code 2, one line on standard error, nothing on standard output, nothing written."""

import numpy as np
import pytest
from skimage.io import imsave

from tsplinejax.cli import _fit, _outcome


@pytest.fixture(autouse=True)
def _inputs(height_map, cloud, tmp_path):
    """Files that are wrong in one way each."""
    for name, heights in {
        "inf.npy": np.array([[1.0, np.inf], [2.0, 3.0]]),
        "nan.npy": np.full((20, 30), np.nan),
        "constant.npy": np.ones((20, 30)),
        "one.npy": np.ones((1, 1)),
        "row.npy": np.arange(50.0)[None],
        "line.npy": np.outer(np.arange(5.0), np.ones(3)),
        "wide.npy": np.random.default_rng(0).uniform(size=(9, 2)) * 3,
    }.items():
        np.save(tmp_path / name, heights)
    (tmp_path / "empty.npy").touch()
    (tmp_path / "junk.x3p").write_bytes(b"junk")
    (tmp_path / "junk.tspl").write_bytes(b"PK junk")
    (tmp_path / "ragged.csv").write_text("1,2\n3\n")
    (tmp_path / "words.csv").write_text("Instrument: ACME\nheights in nm\n1,2\n3,4\n")
    (tmp_path / "title.csv").write_text("x,y,z\n")
    (tmp_path / "folder").mkdir()
    imsave(tmp_path / "heights.png", np.arange(600, dtype=np.uint16).reshape(20, 30), check_contrast=False)


MISUSE = [
    ("", "required: COMMAND"),
    ("fitt map.npz", "invalid choice: 'fitt'"),
    ("fit", "required: INPUT, -o/--output"),
    ("fit map.npz", "required: -o/--output"),
    ("fit none.npz -o m.tspl", "does not exist"),
    ("fit . -o m.tspl", "is a folder"),
    ("fit map.npz -o m.npy", "use one of the suffixes .tspl"),
    ("fit map.npz -o m.tspl --plot m.jpg", "use one of the suffixes .png"),
    ("fit map.npz -o m.tspl --tolerence 1", "unrecognized arguments: --tolerence"),
    ("fit map.npz -o m.tspl --tol 1", "unrecognized arguments: --tol"),
    ("fit map.npz -o m.tspl --tolerance 1 --noise auto", "not allowed with argument --tolerance"),
    ("fit map.npz -o m.tspl --tolerance abc", "got 'abc'"),
    ("fit map.npz -o m.tspl --tolerance 5volt", "not a unit of length"),
    ("fit map.npz -o m.tspl --tolerance -5nm", "above zero"),
    ("fit map.npz -o m.tspl --tolerance 0", "above zero"),
    ("fit map.npz -o m.tspl --tolerance nan", "got 'nan'"),
    ("fit map.npz -o m.tspl --relative-tolerance nan", "finite number above zero"),
    ("fit map.npz -o m.tspl --relative-tolerance 5nm", "0.01 or 1%"),
    ("fit map.npz -o m.tspl --noise -1", "above zero"),
    ("fit map.npz -o m.tspl --lattice 8", "two counts such as 12x8"),
    ("fit map.npz -o m.tspl --lattice 0x8", "1 to 16384"),
    ("fit map.npz -o m.tspl --smoothing -1", "at least zero"),
    ("fit map.npz -o m.tspl --smoothing much", "'auto' or a number"),
    ("fit map.npz -o m.tspl --max-steps two", "invalid int value"),
    ("fit map.npz -o m.tspl --max-seconds -1", "positive"),
    ("fit map.npz -o m.tspl --as-surface", "point clouds"),
    ("fit map.npz -o m.tspl --mask nan.npy", "shape of the heights"),
    ("fit map.npz -o m.tspl --crop 1,2,3", "X0,Y0,X1,Y1"),
    ("fit map.npz -o m.tspl --crop -9,-9,-8,-8", "holds no pixel"),
    ("fit map.npz -o m.tspl --height-unit nm", "states its unit"),
    ("fit constant.npy -o m.tspl --tolerance 5nm", "data have none"),
    ("fit constant.npy -o m.tspl --relative-tolerance 1%", "constant"),
    ("fit constant.npy -o m.tspl --spacing 0", "must be positive"),
    ("fit constant.npy -o m.tspl --height-unit nm", "give unit="),
    ("fit inf.npy -o m.tspl", "infinite"),
    ("fit nan.npy -o m.tspl", "missing"),
    ("fit one.npy -o m.tspl", "positive extent"),
    ("fit row.npy -o m.tspl", "positive extent"),
    ("fit line.npy -o m.tspl", "one line"),
    ("fit empty.npy -o m.tspl", "empty"),
    ("fit junk.x3p -o m.tspl", "cannot be read as .x3p"),
    ("fit ragged.csv -o m.tspl", "rows of one length"),
    ("fit words.csv -o m.tspl", "mark them with #"),
    ("fit title.csv -o m.tspl", "holds no numbers; export it again"),
    ("fit heights.png -o m.tspl --spacing 0.5um", "state the data's unit (unit=..., --unit)"),
    ("fit heights.png -o m.tspl --tolerance 5nm", "state the data's unit (unit=..., --unit)"),
    ("fit map.npz -o m.tspl --tolerance 1%", "--relative-tolerance 1%"),
    ("fit map.npz -o m.tspl --tolerance 5 nm", "without a space, as in 5nm"),
    ("fit map.npz -o m.tspl --relative-tolerance 5", "below 1, but got '5'; write 1% or 0.01"),
    ("fit map.npz -o m.tspl --relative-tolerance 1,5%", "0.01 or 1% is needed"),
    ("fit map.npz -o m.tspl --crop 3,-2,3,-2", "keep at least two rows and columns"),
    ("fit folder -o m.tspl", "is a folder; name a file in it"),
    ("fit map.npz -o folder/none/m.tspl", "does not exist; create it first"),
    ("batch fit nowhere -o models", "no folder that exists"),
    ("batch fit folder -o models", "holds no data file"),
    ("areal cloud.npy", "read it with --as map"),
    ("filter cloud.npy -o f.npz --cutoff 1", "read it with --as map"),
    ("filter map.npz -o f.npz --cutoff 1%", "--relative-tolerance 1%"),
    ("mra cloud.npy -o b.npz", "read it with --as map"),
    ("fill cloud.npy -o f.npz", "read it with --as map"),
    ("fill map.npz -o f.npz --tolerance 1", "--smooth-all"),
    ("sample map.npz -o s.npz --strategy grevil", "greville-centres"),
    ("sample map.npz -o s.npz --model map.npz", "ends in .tspl"),
    ("reconstruct constant.npy --model junk.tspl -o r.npz", "cannot be read as .tspl"),
    ("compress cloud.npy -o c.tspl --tolerance 1", "read it with --as map"),
    ("compress map.npz -o c.tspl", "is required"),
    ("compress map.npz -o c.tspl --tolerance 1%", "--relative-tolerance 1%"),
    ("decompress constant.npy -o d.npz", "make one with compress"),
    ("decompress empty.npy -o d.npz", "empty"),
    ("fit junk.tspl -o m.tspl", "is a model"),
    ("info junk.tspl", "cannot be read as .tspl"),
    ("info junk.tspl --plot m.png", "a model is drawn by"),
    ("evaluate junk.tspl --shape 3x3 -o m.npy", "cannot be read as .tspl"),
    ("evaluate junk.tspl -o m.npy", "--like --shape --parameters is required"),
    ("evaluate junk.tspl --shape 3 -o m.npy", "two counts such as"),
    ("evaluate junk.tspl --shape 3x3 --unit nm -o m.npy", "--unit describes the data of --like"),
    ("evaluate map.npz --shape 3x3 -o m.npy", "ends in .tspl"),
    ("convert map.npz map.npz", "is the input, too"),
    ("convert map.npz m.doc", "use one of the suffixes"),
    ("convert constant.npy m.x3p", "metres"),
    ("convert cloud.npy m.x3p", "height map"),
    ("plot map.npz -o none/m.png", "does not exist; create it first"),
    ("plot map.npz --data map.npz -o m.png", "--data goes with a model"),
    ("demo -o map.npz", "cannot be made"),
]


@pytest.mark.parametrize(("line", "message"), MISUSE, ids=[line or "nothing" for line, _ in MISUSE])
def test_misuse_is_one_clear_line(command, tmp_path, line, message):
    """No traceback, no partial file."""
    before = _contents(tmp_path)
    code, out, err = command(*line.split())
    assert (code, out) == (2, "")
    assert err.startswith("tsplinejax: error: ")
    assert err.count("\n") == 1
    assert message in err
    assert _contents(tmp_path) == before


def _contents(folder):
    return {path.relative_to(folder): path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


def test_unexpected_errors_are_one_line_too(command, monkeypatch):
    """A defect of the program's own is said in one line, and a variable shows where it is."""
    monkeypatch.setattr(_fit, "fit", lambda *_, **__: 1 / 0)
    code, out, err = command("fit", "map.npz", "-o", "m.tspl")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "unexpected ZeroDivisionError" in err
    monkeypatch.setenv(_outcome.TRACEBACK_VARIABLE, "1")
    assert "Traceback" in command("fit", "map.npz", "-o", "m.tspl")[2]


def test_interrupting_before_a_result_writes_nothing(command, monkeypatch, tmp_path):
    """Ctrl-C while the input is read, for instance."""

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(_fit, "read_data", interrupted)
    code, out, err = command("fit", "map.npz", "-o", "m.tspl")
    assert (code, out) == (2, "")
    assert "interrupted" in err
    assert not (tmp_path / "m.tspl").exists()
