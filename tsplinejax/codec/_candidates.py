"""The files among which `compress` chooses: each one way to code a map, decoded again and measured."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from .._version import __version__
from ..data import HeightMap, quick_noise
from ..fitting import fit
from ..mesh import require_forest
from ..surface import TSpline, heights_on_grid, make_surface
from ._compressed import Mode, ModelPart, most_control_points, most_pixels
from ._decompress import decode
from ._entropy import Encoder
from ._grid import MOST_UNITS, UNITS, HeightCoder
from ._lossless import encode_exactly
from ._mask import code_mask
from ._model import RoundedModel, code_model, require_x64
from ._plain import plain
from ._sections import sealed

# Fit and step in bounds, where corrections of single pixels keep the bound. Measured on five surfaces at 1 % and 0.1 %:
# the corrections that a coarse model leaves over cost less than the digits of its control points.
_LOOSE_FIT, _LOOSE_STEPS = 1.25, (1.4, 2.0, 2.8)
# The same where the T-spline alone keeps it: the steps are tried from the coarsest on.
_TIGHT_FIT, _TIGHT_STEPS = 0.75, (2.8, 2.0, 1.4, 1.0, 0.7, 0.5, 0.3)
#: A control point hardly takes fewer bits than these; a mesh that would exceed the other way's bytes is given up.
_LEAST_BITS = 3.5
#: Where a control point serves fewer pixels, a T-spline has never been the smaller way.
_PIXELS_PER_POINT = 10
#: Above so many bits a pixel the map is rough, and a T-spline has never been the smaller way.
_ROUGH_BITS = 0.75
#: The fit is left out where the bound is below so many standard deviations of the noise: it would follow the noise.
_NOISE = 2.0


@dataclass(frozen=True, eq=False)
class Task:
    """What is compressed.

    **Attributes:**

    - `data`: the map; `dtype`: what its heights are written in; `missing`: where they are NaN.
    - `bound`: largest error of a valid pixel, in the map's unit.
    - `inner`: the bound less what rounding to the dtype and different machines may add; not above zero where these
      leave nothing.
    """

    data: HeightMap
    dtype: np.dtype
    missing: Bool[np.ndarray, "rows columns"]
    bound: float
    inner: float

    @property
    def lossy(self) -> bool:
        """Whether the bound leaves room for whole steps, in numbers of 64 bits."""
        return self.inner > 0 and self.data.range / self.inner * UNITS < MOST_UNITS

    @property
    def smooth(self) -> bool:
        """Whether the map is large enough, and its noise small enough, for a fit within the bound."""
        return min(self.data.shape) > 1 and self.data.valid.sum() >= 16 and quick_noise(self.data) * _NOISE < self.inner


def grid_file(task: Task) -> bytes | None:
    """Predicted pixels."""
    filled = _filled_in(task)
    offset, step = _middle(task), 2 * task.inner
    coder = _with_mask(task)
    HeightCoder(coder, task.missing, (filled - offset) / (step / UNITS)).run()
    return _measured(task, "grid", list(coder.finish()), offset=offset, step=step)


def lossless_file(task: Task) -> bytes | None:
    """Every bit."""
    coder = _with_mask(task)
    exact = encode_exactly(task.data.heights.astype(task.dtype), task.missing)
    return _measured(task, "lossless", [*coder.finish(), exact])


def pays(task: Task, other: bytes) -> bool:
    """Whether a T-spline may need fewer bytes than another file."""
    return 8 * len(other) < _ROUGH_BITS * task.missing.size


def corrected_models(task: Task, other: bytes) -> Iterator[bytes | None]:
    """T-splines, and corrections of the pixels where they are not within the bound."""
    most = max(64, min(int(8 * len(other) / _LEAST_BITS), int(task.data.valid.sum()) // _PIXELS_PER_POINT))
    surface, filled = _fitted(task, _LOOSE_FIT, most), _filled_in(task)
    for share in _LOOSE_STEPS:
        yield _model_file(task, surface, share * task.inner, filled, correct=True)


def pure_models(task: Task) -> Iterator[bytes | None]:
    """T-splines that keep the bound alone, the smallest first."""
    surface, filled = _fitted(task, _TIGHT_FIT, max(64, int(task.data.valid.sum()))), _filled_in(task)
    for share in _TIGHT_STEPS:
        yield _model_file(task, surface, share * task.inner, filled, correct=False)


def _fitted(task: Task, share: float, most: int) -> TSpline:
    """A T-spline with errors of so many bounds, or as good as the number of control points allows."""
    require_x64()
    return fit(task.data, tolerance=share * task.inner, max_control_points=most, dtype="float64").surface


def _model_file(
    task: Task, surface: TSpline, step: float, filled: Float[np.ndarray, "rows columns"], *, correct: bool
) -> bytes | None:
    """A T-spline of control points rounded to a step; where pixels are not within the bound, they are corrected."""
    offset, tmesh = _middle(task), surface.space.mesh
    steps = np.rint((np.asarray(surface.control_points) - offset) / step)
    if np.abs(steps).max() >= MOST_UNITS:
        return None
    model = RoundedModel(tmesh, steps.astype(np.int64))
    rounded = make_surface(surface.space, offset + model.steps * step, surface.frame)
    # What evaluation may differ by from machine to machine.
    inner = task.inner - 64 * float(np.spacing(np.abs(rounded.control_points).max()))
    # Missing pixels need no correction, however far a surface strays in a hole.
    errors = np.where(task.missing, 0.0, filled - heights_on_grid(rounded, task.data.shape))
    within = bool((np.abs(errors) <= inner).all())
    if inner <= 0 or not (within or correct):
        return None
    forest = require_forest(tmesh)
    part = ModelPart(forest.lattice, forest.first_cut, step, tmesh.n_anchors, tmesh.n_elements, not within)
    coder = _with_mask(task)
    code_model(coder, part, model)
    correction = 0.0 if within else 2 * inner
    if not within:
        HeightCoder(coder, task.missing, errors / (correction / UNITS)).run()
    return _measured(task, "model", list(coder.finish()), offset=offset, step=correction, model=part)


def _with_mask(task: Task) -> Encoder:
    """A coder that has written where pixels are missing."""
    coder = Encoder()
    if task.missing.any():
        code_mask(coder, task.missing.shape, task.missing)
    return coder


def _middle(task: Task) -> float:
    """A height that differences are small to."""
    heights = task.data.heights[~task.missing].astype(np.float64)
    return float(heights.min()) / 2 + float(heights.max()) / 2


def _filled_in(task: Task) -> Float[np.ndarray, "rows columns"]:
    """The heights in float64, each missing one replaced by that of the nearest valid pixel."""
    heights = task.data.heights.astype(np.float64)
    if not task.missing.any():
        return heights
    from scipy.ndimage import distance_transform_edt

    nearest: Any = distance_transform_edt(task.missing, return_distances=False, return_indices=True)
    return heights[tuple(nearest)]


def _measured(
    task: Task,
    mode: Mode,
    sections: list[bytes],
    *,
    offset: float = 0.0,
    step: float = 0.0,
    model: ModelPart | None = None,
) -> bytes | None:
    """The whole file with the largest error of what it decodes to; `None` where that is above the bound."""
    data = task.data
    header = {
        "software": f"tsplinejax {__version__}",
        "provenance": plain(data.provenance),
        "unit": data.unit,
        "origin": list(data.origin),
        "spacing": list(data.spacing),
        "missing": int(np.count_nonzero(task.missing)),
        "dtype": str(task.dtype),
        "shape": list(data.shape),
        "tolerance": task.bound,
        "max_error": 0.0,
        "offset": offset,
        "step": step,
        "mode": mode,
        "model": None if model is None else plain(asdict(model)),
    }
    draft = sealed(header, sections)
    points = 0 if model is None else model.control_points
    if data.heights.size > most_pixels(len(draft)) or points > most_control_points(len(draft)):
        return None
    heights = decode(draft).heights
    error = largest_error(heights, data.heights)
    if error > task.bound or not np.array_equal(np.isnan(heights), task.missing):
        return None
    return sealed({**header, "max_error": error}, sections)


def largest_error(heights: np.ndarray, given: np.ndarray) -> float:
    """Largest difference of the valid pixels."""
    return float(np.nanmax(np.abs(heights.astype(np.float64) - given.astype(np.float64))))
