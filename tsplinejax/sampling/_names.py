"""Strategies by name, as the command line has them."""

from .._errors import InputError
from ._adaptive import Adaptive
from ._greville import Greville
from ._refined import RefinedGreville
from ._strategies import (
    AbstractStrategy,
    Curvature,
    ElementArea,
    ElementCurvature,
    Grid,
    Halton,
    LatinHypercube,
    Random,
    TPatch,
)

#: Each strategy as it is where nothing else is said. The first six know the T-mesh.
STRATEGIES: dict[str, AbstractStrategy] = {
    "greville": Greville(),
    "greville-centres": Greville(centres=True),
    "greville-refined": RefinedGreville(),
    "t-patch": TPatch(),
    "t-patch-random": TPatch(random=True),
    "adaptive": Adaptive(),
    "element-area": ElementArea(),
    "element-curvature": ElementCurvature(),
    "curvature": Curvature(),
    "uniform": Grid(),
    "random": Random(),
    "halton": Halton(),
    "latin-hypercube": LatinHypercube(),
}
_ALSO = {
    "greville+centres": "greville-centres",
    "t-patch-uniform": "t-patch",
    "grid": "uniform",
    "uniform-grid": "uniform",
    "curvature-weighted": "curvature",
}


def strategy_of(strategy: AbstractStrategy | str) -> AbstractStrategy:
    """A strategy from its name, or as it is.

    **Raises:** `InputError` for another name.

    >>> strategy_of("T-patch random")
    TPatch(random=True, per_element=4)
    """
    if isinstance(strategy, AbstractStrategy):
        return strategy
    word = str(strategy).strip().lower().replace(" ", "-").replace("_", "-").replace("-+-", "+")
    found = STRATEGIES.get(_ALSO.get(word, word))
    if found is None:
        raise InputError(
            f"a sampling strategy is one of {', '.join(STRATEGIES)}, or an object such as Greville(); "
            f"received {strategy!r}"
        )
    return found
