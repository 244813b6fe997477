"""Mesh formats that others write: vertices in their order, STL corners merged, PCD in its three encodings."""

import struct

import numpy as np
import pytest

from tsplinejax.io import read

SQUARE = np.array([[0, 0, 0], [1, 0, 0.5], [1, 1, 1], [0, 1, 0.25]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def test_obj(tmp_path):
    """Vertices stay in the file's order."""
    lines = [f"v {x} {y} {z}" for x, y, z in SQUARE] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in FACES]
    (tmp_path / "mesh.obj").write_text("mtllib absent.mtl\n" + "\n".join(lines))
    cloud = read(tmp_path / "mesh.obj")
    np.testing.assert_array_equal(cloud.points, SQUARE)
    np.testing.assert_array_equal(cloud.triangles, FACES)


def test_stl(tmp_path):
    """The corners that triangles share are one vertex each."""
    body = b"".join(struct.pack("<12fH", 0, 0, 1, *SQUARE[face].ravel(), 0) for face in FACES)
    (tmp_path / "mesh.stl").write_bytes(b"\0" * 80 + struct.pack("<I", 2) + body)
    cloud = read(tmp_path / "mesh.stl")
    assert (len(cloud), len(cloud.triangles)) == (4, 2)
    assert {tuple(point) for point in cloud.points} == {tuple(point) for point in SQUARE}


def _pcd(data, fields="x y z i", kinds="F F F U", sizes="4 8 4 1"):
    return (
        f"# .PCD v0.7\nVERSION 0.7\nFIELDS {fields}\nSIZE {sizes}\nTYPE {kinds}\nCOUNT 1 1 1 1\nWIDTH 4\nHEIGHT 1\n"
        f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 4\nDATA {data}\n"
    ).encode()


def _compressed():
    columns = [SQUARE[:, 0].astype("<f4"), SQUARE[:, 1].astype("<f8"), SQUARE[:, 2].astype("<f4"), np.zeros(4, "u1")]
    plain = b"".join(column.tobytes() for column in columns)
    packed = b"".join(bytes([len(part) - 1]) + part for part in (plain[k : k + 32] for k in range(0, len(plain), 32)))
    return struct.pack("<II", len(packed), len(plain)) + packed


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
def test_pcd(tmp_path, encoding):
    """All three encodings give the points; a further field is left, and said."""
    record = np.zeros(4, [("x", "<f4"), ("y", "<f8"), ("z", "<f4"), ("i", "u1")])
    record["x"], record["y"], record["z"] = SQUARE.T
    text = "".join(f"{x} {y} {z} 0\n" for x, y, z in SQUARE).encode()
    body = {"ascii": text, "binary": record.tobytes(), "binary_compressed": _compressed()}[encoding]
    (tmp_path / "cloud.pcd").write_bytes(_pcd(encoding) + body)
    cloud = read(tmp_path / "cloud.pcd")
    np.testing.assert_array_equal(cloud.points, SQUARE)
    assert cloud.provenance["notes"] == ["fields not read: i"]
