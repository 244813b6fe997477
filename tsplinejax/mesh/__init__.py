"""T-meshes on the host: topology, refinement, local knot vectors. numpy only."""

from ._check import Verdict as Verdict, is_analysis_suitable as is_analysis_suitable
from ._codes import (
    DEPTH as DEPTH,
    MAX_LEVEL as MAX_LEVEL,
    Border as Border,
    Direction as Direction,
    cell_boxes as cell_boxes,
)
from ._knots import anchor_codes as anchor_codes
from ._refine import (
    AbstractRefinement as AbstractRefinement,
    AnalysisSuitable as AnalysisSuitable,
    Dyadic as Dyadic,
    Refinement as Refinement,
    bisect as bisect,
    bisect_cells as bisect_cells,
    refine as refine,
    require_forest as require_forest,
)
from ._tmesh import (
    TMesh as TMesh,
    b_lattice as b_lattice,
    forest_from_boxes as forest_from_boxes,
    from_rectangles as from_rectangles,
)
