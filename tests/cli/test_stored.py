"""`tsplinejax fit --max-memory`: maps left on disk, the same model, and what does not go with it."""

import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax.cli import _fit

FIT = ("--tolerance", "50nm", "--spacing", "0.5,0.25", "--unit", "um")


@pytest.fixture
def bare(height_map, tmp_path) -> np.ndarray:
    """The map's heights alone, as `bare.npy`."""
    np.save(tmp_path / "bare.npy", height_map.heights)
    return height_map.heights


def _same_model(first: str, second: str, limit: float) -> None:
    points, others = (tsj.load(name) for name in (first, second))
    assert points.frame == others.frame
    np.testing.assert_allclose(points.control_points, others.control_points, rtol=0, atol=limit)


def test_a_mapped_file_gives_the_model_of_a_read_one(report, bare):
    """Figures, frame and control points do not depend on where the map lies; JSON has the same keys."""
    read = report("fit", "bare.npy", "-o", "read.tspl", *FIT)
    mapped = report("fit", "bare.npy", "-o", "mapped.tspl", *FIT, "--max-memory", "0.4GB")
    assert set(mapped) == set(read)
    for key in ("samples", "control_points", "elements", "unit", "tolerance", "stop", "steps", "range"):
        assert mapped[key] == read[key], key
    assert mapped["provenance"]["input"]["sha256"] == read["provenance"]["input"]["sha256"]
    _same_model("read.tspl", "mapped.tspl", 1e-10 * read["range"])


def test_a_zarr_folder_is_opened(report, bare, tmp_path):
    """A chunked array through the extra."""
    zarr = pytest.importorskip("zarr")
    array = zarr.create_array(tmp_path / "bare.zarr", shape=bare.shape, chunks=(16, 32), dtype=bare.dtype)
    array[:] = bare
    report("fit", "bare.zarr", "-o", "chunked.tspl", *FIT, "--max-memory", "1GB")
    result = report("fit", "bare.npy", "-o", "read.tspl", *FIT)
    _same_model("read.tspl", "chunked.tspl", 1e-10 * result["range"])


def test_summary_for_people(command, bare):
    """A few lines say that the map was left where it is."""
    code, out, _ = command("fit", "bare.npy", "-o", "m.tspl", *FIT, "--max-memory", "1GB")
    assert code == 0
    assert "40 rows × 50 columns, spacing 0.5 × 0.25 µm" in out
    assert "left on disk" in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("bare.npy --max-memory 4", "a size such as 500MB or 4GB"),
        ("bare.npy --max-memory -4GB", "a size such as 500MB or 4GB"),
        ("bare.npy --max-memory 10MB", "at least 2e8"),
        ("bare.npy --max-memory 4GB --plot m.png", "--plot would need the whole map in memory"),
        ("bare.npy --max-memory 4GB --robust --level plane", "--robust, --level would need"),
        ("bare.npy --max-memory 4GB --crop 0,0,1,1", "--crop would need"),
        ("bare.npy --max-memory 4GB --spacing 1,2,3", "DX or DX,DY"),
        ("bare.npy --max-memory 4GB --tolerance 5nm", "data have none"),
        ("map.npz --max-memory 4GB", "only .npy and .zarr are opened without reading"),
        ("none.npy --max-memory 4GB", "does not exist"),
        ("none.zarr --max-memory 4GB", "is no folder"),
        ("cloud.npy --max-memory 4GB", "three columns are points"),
        ("short.npy --max-memory 4GB", "truncated"),
        ("objects.npy --max-memory 4GB", "cannot be read as .npy"),
        ("cube.npy --max-memory 4GB", "2-D array of real heights"),
    ],
)
def test_misuse_is_one_clear_line(command, bare, cloud, monkeypatch, tmp_path, words, message):
    """Refused before anything is fitted, and nothing is written."""
    (tmp_path / "short.npy").write_bytes((tmp_path / "bare.npy").read_bytes()[:-9])
    np.save(tmp_path / "objects.npy", np.array([[{}, 1], [2, 3]], object), allow_pickle=True)
    np.save(tmp_path / "cube.npy", np.zeros((4, 5, 6)))
    monkeypatch.setattr("tsplinejax.fitting._finish.run", lambda *_, **__: pytest.fail("fitted all the same"))
    code, out, err = command("fit", *words.split(), "-o", "m.tspl")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert message in err
    assert not (tmp_path / "m.tspl").exists()


def test_without_the_option_nothing_is_mapped(report, bare, monkeypatch):
    """As before: the map is read."""
    monkeypatch.setattr(_fit, "stored_data", lambda *_: pytest.fail("left on disk"))
    report("fit", "bare.npy", "-o", "m.tspl", *FIT)
