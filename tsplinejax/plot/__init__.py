"""Pictures for print: height maps, T-meshes, errors, convergence, studies, samples and 3-D views, by matplotlib.

Every function takes the axes to draw on as `ax` and returns them; without `ax` it makes a figure of its own, in a
style for print. Coordinates on the axes are those of the data: only the labels of ticks are written in a handier unit
where the data's own would take many zeros (0.000126 m reads 126 µm). Missing data are grey, errors are data minus
surface on a diverging map symmetric about 0.

**The direction of y.** `heights[i, j]` lies at y = i · dy, and row 0 is drawn at the top, as in any image: lettering on
a measured surface reads right, and the y axis points down. The 3-D view of a height surface shows the same side in the
same sense, with row 0 at the back; models in space are drawn right-handed.

matplotlib comes with the extra `plot` and is imported by the first picture.
"""

from ._bands import plot_bands as plot_bands
from ._convergence import plot_convergence as plot_convergence
from ._error import plot_error as plot_error
from ._filling import plot_filling as plot_filling
from ._filtration import plot_filtered as plot_filtered, plot_transmission as plot_transmission
from ._height_map import plot_height_map as plot_height_map
from ._mesh import plot_mesh as plot_mesh
from ._overview import plot_overview as plot_overview
from ._sampling import plot_samples as plot_samples, plot_sampling_study as plot_sampling_study
from ._surface_3d import plot_surface_3d as plot_surface_3d
from ._texture import plot_form_removal as plot_form_removal, plot_texture as plot_texture
from ._tolerance_study import plot_tolerance_study as plot_tolerance_study
