"""T-splines for surface metrology: locally refined, differentiable models of measured surfaces, on JAX.

Packages that a fit does not need are loaded when one of their names is first asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ._errors import InputError as InputError, MissingExtraError as MissingExtraError
from ._version import __version__ as __version__
from .codec import compress as compress, decompress as decompress, load as load, save as save
from .data import (
    Frame as Frame,
    HeightMap as HeightMap,
    NoiseEstimate as NoiseEstimate,
    PointCloud as PointCloud,
    Samples as Samples,
    StoredMap as StoredMap,
    estimate_noise as estimate_noise,
    find_outliers as find_outliers,
)
from .fitting import (
    BatchItem as BatchItem,
    DaskEngine as DaskEngine,
    DevicesEngine as DevicesEngine,
    FitResult as FitResult,
    GlobalSolver as GlobalSolver,
    LocalSolver as LocalSolver,
    SharedFit as SharedFit,
    Step as Step,
    StopReason as StopReason,
    ToleranceStudy as ToleranceStudy,
    fit as fit,
    fit_batch as fit_batch,
    fit_shared as fit_shared,
    lstsq as lstsq,
    tolerance_study as tolerance_study,
)
from .io import open_stored as open_stored, read as read, write as write
from .mesh import (
    AnalysisSuitable as AnalysisSuitable,
    Dyadic as Dyadic,
    TMesh as TMesh,
    b_lattice as b_lattice,
    from_rectangles as from_rectangles,
    is_analysis_suitable as is_analysis_suitable,
    refine as refine,
)
from .space import SplineSpace as SplineSpace, spline_space as spline_space
from .surface import (
    Projection as Projection,
    TSpline as TSpline,
    curvatures as curvatures,
    make_surface as make_surface,
    normals as normals,
    project as project,
    transfer as transfer,
)

if TYPE_CHECKING:
    from .areal import ArealParameters as ArealParameters, areal_parameters as areal_parameters
    from .characterise import (
        Cylinder as Cylinder,
        FittedForm as FittedForm,
        FormRemoval as FormRemoval,
        Plane as Plane,
        Polynomial as Polynomial,
        Sphere as Sphere,
        fit_form as fit_form,
        l_filter as l_filter,
        level as level,
        remove_form as remove_form,
        s_filter as s_filter,
    )
    from .filling import Filled as Filled, fill_missing as fill_missing
    from .filtration import (
        Filtered as Filtered,
        Transmission as Transmission,
        filter as filter,
        transmission as transmission,
    )
    from .multiresolution import Band as Band, Multiresolution as Multiresolution, mra as mra
    from .orthogonal import (
        Huber as Huber,
        Joint as Joint,
        Normal as Normal,
        OrthogonalFit as OrthogonalFit,
        Parametric as Parametric,
        Tukey as Tukey,
        fit_orthogonal as fit_orthogonal,
    )
    from .parameterisation import Parameterisation as Parameterisation, conformal as conformal, planar as planar
    from .sampling import (
        Greville as Greville,
        Reconstruction as Reconstruction,
        SampleSet as SampleSet,
        SamplingStudy as SamplingStudy,
        TPatch as TPatch,
        reconstruct as reconstruct,
        sample as sample,
        sampling_study as sampling_study,
    )

_ON_DEMAND = {
    "areal": ("ArealParameters", "areal_parameters"),
    "characterise": (
        "Cylinder",
        "FittedForm",
        "FormRemoval",
        "Plane",
        "Polynomial",
        "Sphere",
        "fit_form",
        "l_filter",
        "level",
        "remove_form",
        "s_filter",
    ),
    "filling": ("Filled", "fill_missing"),
    "filtration": ("Filtered", "Transmission", "filter", "transmission"),
    "multiresolution": ("Band", "Multiresolution", "mra"),
    "orthogonal": ("Huber", "Joint", "Normal", "OrthogonalFit", "Parametric", "Tukey", "fit_orthogonal"),
    "parameterisation": ("Parameterisation", "conformal", "planar"),
    "sampling": (
        "Greville",
        "Reconstruction",
        "SampleSet",
        "SamplingStudy",
        "TPatch",
        "reconstruct",
        "sample",
        "sampling_study",
    ),
}


def __getattr__(name: str) -> Any:
    """Load a package, or the package that a name is from."""
    for package, names in _ON_DEMAND.items():
        if name == package:
            return import_module(f".{package}", __name__)
        if name in names:
            return getattr(import_module(f".{package}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_ON_DEMAND, *(name for names in _ON_DEMAND.values() for name in names)})
