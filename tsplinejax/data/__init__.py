"""Measured data: height maps, point clouds, the samples a fit receives, units, and synthetic surfaces."""

from ._as_data import as_data as as_data
from ._cautions import (
    is_spiked as is_spiked,
    robust_span as robust_span,
    tolerance_cautions as tolerance_cautions,
)
from ._frame import Frame as Frame
from ._height_map import HeightMap as HeightMap
from ._noise import (
    NoiseEstimate as NoiseEstimate,
    estimate_noise as estimate_noise,
    noise_deviation as noise_deviation,
    quick_noise as quick_noise,
)
from ._outliers import find_outliers as find_outliers
from ._point_cloud import PointCloud as PointCloud
from ._precision import checked_precision as checked_precision
from ._samples import Samples as Samples
from ._stored_map import (
    Statistics as Statistics,
    StoredMap as StoredMap,
    Window as Window,
    checked_heights as checked_heights,
    is_stored as is_stored,
    statistics_of as statistics_of,
)
from ._synthetic import (
    laser_textured_disk as laser_textured_disk,
    peaks as peaks,
    plate_with_particles as plate_with_particles,
    sparse_bumps as sparse_bumps,
    step as step,
    structured_with_missing as structured_with_missing,
)
from ._synthetic_clouds import (
    freeform_artefact as freeform_artefact,
    saddle_with_texture as saddle_with_texture,
    scattered_peaks as scattered_peaks,
)
from ._units import (
    LENGTH_UNITS as LENGTH_UNITS,
    canonical_unit as canonical_unit,
    parse_length as parse_length,
    unit_factor as unit_factor,
)
