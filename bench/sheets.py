"""Freeform sheets for the benchmarks: those of the tests of parameterisation, and a patch of a measured blade."""

import sys
from pathlib import Path

from surfaces import SHARED

import tsplinejax as tsj

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.parameterisation.surfaces import (
    cylinder as cylinder,
    dome as dome,
    facing_patch,
    mercator as mercator,
    saddle as saddle,
    scattered as scattered,
    twist as twist,
    with_faults as with_faults,
    with_holes as with_holes,
)

BLADE = SHARED / "turbineblade.ply"
FACE = SHARED / "face_fran_cut.ply"


def blade_patch() -> tsj.PointCloud:
    """One side of the turbine blade over 20 mm of its height, as a mesh."""
    blade = tsj.read(BLADE, unit="mm")
    assert isinstance(blade, tsj.PointCloud)
    return facing_patch(blade)
