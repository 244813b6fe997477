"""How noisy is a measured surface? An estimate from the data alone, without a fit.

**Grids.** Differences of orders 3, 4 and 6 at lags of 1 to 8 pixels, along x and along y (see `_differences`), have one
level on white noise, whatever the order and lag. What the level does as the lag grows tells what is there:

- it is flat from lag 1: white noise, and the level is σ;
- it rises and then stays: noise correlated over a few pixels (a smoothing filter, an instrument's resolution); the
  plateau is σ, and the way up gives the correlation;
- it rises as a high power of the lag, and the sixth difference is far below the third: a smooth surface without noise;
- it keeps rising slowly, all orders alike: roughness of all sizes down to the pixel. Nothing in the data then
  tells texture from noise (`texture_limited`), and σ is a convention: the level at two pixels, that is, whatever is finer
  than some four pixels counts as noise.

**Scattered points.** Residuals of local polynomials of degree 1, 2 and 3 through the nearest points: where the
degrees agree, they are noise.

**What it cannot know.** Texture that is white at the pixel is taken for noise, and so is a repeated error of the
instrument. Noise that is correlated over more than about three pixels is taken for texture. Line noise (every row with an
offset of its own) shows along y only: σ is the larger of both directions. Rounding to counts of q is white with
σ = q / √12 only where the surface crosses several counts between neighbours; on terraces it is not noise at all, but
q / √12 is reported. A share of outliers does no harm; find them with `find_outliers`.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ._as_data import as_data
from ._differences import LAGS, block_medians, correlation_of, dense_level, difference, levels, windows
from ._height_map import HeightMap
from ._local_fits import scattered_noise
from ._rounding import height_step
from ._samples import Samples

_SPARSE = 0.25
_FLAT = 0.15
_LAST_RISE = 0.38
_SMOOTH = 0.1


@dataclass(frozen=True, repr=False)
class NoiseEstimate:
    """Measurement noise, in the data's unit.

    **Attributes:**

    - `sigma`: standard deviation of the noise at a sample; its root mean square where it varies.
    - `correlation`: the noise's own correlation between neighbours along x and along y; 0 for white noise.
    - `correlation_length`: pixels along a side over which noise is one (the mean over both directions of the sum of
      the correlation over all lags); 1 for white noise.
    - `quantisation`: the step of rounded heights, 0 if they are not rounded.
    - `floor`, `slope_coefficient`: noise where the surface has the slope g is `floor + slope_coefficient · g`.
    - `texture_limited`: roughness reaches down to the pixel, so that texture and noise cannot be told apart.
    - `note`: one line for the reader, empty if there is nothing to say.

    >>> NoiseEstimate(0.25)
    NoiseEstimate(sigma=0.25, white)
    """

    sigma: float
    correlation: tuple[float, float] = (0.0, 0.0)
    correlation_length: float = 1.0
    quantisation: float = 0.0
    slope_coefficient: float = 0.0
    texture_limited: bool = False
    note: str = ""

    @property
    def signal_dependent(self) -> bool:
        """Whether noise grows with the slope."""
        return self.slope_coefficient > 0

    @property
    def correlated_samples(self) -> float:
        """How many samples of a grid share one independent value of the noise; 1 for white noise."""
        return self.correlation_length**2

    def __repr__(self) -> str:
        """Say how much noise there is and of what kind."""
        kind = "white" if self.correlation_length <= 1 else f"correlated over {self.correlation_length:.2g} pixels"
        more = f", rounded to {self.quantisation:.3g}" if self.quantisation else ""
        more += f", growing with slope by {self.slope_coefficient:.3g}" if self.signal_dependent else ""
        more += ", texture_limited" if self.texture_limited else ""
        return f"NoiseEstimate(sigma={self.sigma:.4g}, {kind}{more})"
