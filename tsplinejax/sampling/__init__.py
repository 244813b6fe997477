"""Smart sampling: where to measure a surface whose T-spline space is known, and the surface again from few samples."""

from ._adaptive import Adaptive as Adaptive
from ._greville import Greville as Greville
from ._names import STRATEGIES as STRATEGIES
from ._reconstruct import Reconstruction as Reconstruction, reconstruct as reconstruct
from ._refined import RefinedGreville as RefinedGreville
from ._sample import SampleSet as SampleSet, sample as sample
from ._strategies import (
    AbstractStrategy as AbstractStrategy,
    Curvature as Curvature,
    ElementArea as ElementArea,
    ElementCurvature as ElementCurvature,
    Grid as Grid,
    Halton as Halton,
    LatinHypercube as LatinHypercube,
    Random as Random,
    TPatch as TPatch,
)
from ._study import SamplingStudy as SamplingStudy, sampling_study as sampling_study
