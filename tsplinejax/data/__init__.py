"""Measured data: height maps, point clouds, the samples a fit receives, units, and synthetic surfaces."""

from ._as_data import as_data as as_data
from ._frame import Frame as Frame
from ._height_map import HeightMap as HeightMap
from ._noise import NoiseEstimate as NoiseEstimate, estimate_noise as estimate_noise, noise_deviation as noise_deviation
from ._outliers import find_outliers as find_outliers
from ._point_cloud import PointCloud as PointCloud
from ._samples import Samples as Samples
from ._synthetic import laser_textured_disk as laser_textured_disk
from ._synthetic import peaks as peaks
from ._synthetic import plate_with_particles as plate_with_particles
from ._synthetic import sparse_bumps as sparse_bumps
from ._synthetic import step as step
from ._synthetic import structured_with_missing as structured_with_missing
from ._synthetic_clouds import saddle_with_texture as saddle_with_texture
from ._synthetic_clouds import scattered_peaks as scattered_peaks
from ._units import LENGTH_UNITS as LENGTH_UNITS
from ._units import canonical_unit as canonical_unit
from ._units import parse_length as parse_length
from ._units import unit_factor as unit_factor
