"""Writing X3P, the container of ISO 25178-72 (formerly ISO 5436-2): a zip of one XML index and the binary heights.

Lengths are metres, matrix rows follow y, NaN marks missing points (data type F or D), and two MD5 sums guard data and
index. Times in the archive are fixed, so equal maps give equal bytes.
"""

import hashlib
import zipfile
from typing import BinaryIO

import numpy as np

from .._errors import InputError
from ..data import HeightMap, PointCloud

_INDEX = """<?xml version="1.0" encoding="UTF-8" standalone="no"?>
<p:ISO5436_2 xmlns:p="http://www.opengps.eu/2008/ISO5436_2">
  <Record1>
    <Revision>ISO5436 - 2000</Revision>
    <FeatureType>SUR</FeatureType>
    <Axes>
      <CX>
        <AxisType>I</AxisType>
        <DataType>D</DataType>
        <Increment>{dx!r}</Increment>
        <Offset>{x0!r}</Offset>
      </CX>
      <CY>
        <AxisType>I</AxisType>
        <DataType>D</DataType>
        <Increment>{dy!r}</Increment>
        <Offset>{y0!r}</Offset>
      </CY>
      <CZ>
        <AxisType>A</AxisType>
        <DataType>{data_type}</DataType>
        <Increment>1</Increment>
        <Offset>0</Offset>
      </CZ>
    </Axes>
  </Record1>
  <Record3>
    <MatrixDimension>
      <SizeX>{columns}</SizeX>
      <SizeY>{rows}</SizeY>
      <SizeZ>1</SizeZ>
    </MatrixDimension>
    <DataLink>
      <PointDataLink>bindata/data.bin</PointDataLink>
      <MD5ChecksumPointData>{checksum}</MD5ChecksumPointData>
    </DataLink>
  </Record3>
  <Record4>
    <ChecksumFile>md5checksum.hex</ChecksumFile>
  </Record4>
</p:ISO5436_2>
"""

_NO_DATE = (1980, 1, 1, 0, 0, 0)


def write_x3p(stream: BinaryIO, data: HeightMap | PointCloud) -> None:
    """Write a height map of known unit as X3P, in metres."""
    if not isinstance(data, HeightMap):
        raise InputError("an .x3p file holds a height map, not a point cloud; write the cloud as .ply")
    if data.unit is None:
        raise InputError("an .x3p file is in metres, but the map's unit is unknown; state it (unit=..., --unit)")
    metres = data.to_unit("m")
    single = metres.heights.dtype == np.float32
    points = metres.heights.astype("<f4" if single else "<f8").tobytes()
    rows, columns = metres.shape
    index = _INDEX.format(
        dx=metres.spacing[0],
        dy=metres.spacing[1],
        x0=metres.origin[0],
        y0=metres.origin[1],
        data_type="F" if single else "D",
        columns=columns,
        rows=rows,
        checksum=_md5(points).upper(),
    ).encode()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, content in (
            ("main.xml", index),
            ("bindata/data.bin", points),
            ("md5checksum.hex", f"{_md5(index)} *main.xml\n".encode()),
        ):
            archive.writestr(zipfile.ZipInfo(name, _NO_DATE), content, zipfile.ZIP_DEFLATED)


def _md5(content: bytes) -> str:
    return hashlib.md5(content, usedforsecurity=False).hexdigest()
