"""The pictures of the documentation, of synthetic surfaces: `python docs/make_pictures.py` writes docs/images."""

from collections.abc import Callable
from pathlib import Path

import jax
import matplotlib
import numpy as np

jax.config.update("jax_enable_x64", True)
matplotlib.use("agg")

import matplotlib.pyplot as plt  # noqa: E402
from matplotlib.axes import Axes  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402
from matplotlib.patches import Rectangle  # noqa: E402

import tsplinejax as tsj  # noqa: E402
from tsplinejax.data import (  # noqa: E402
    freeform_artefact,
    laser_textured_disk,
    peaks,
    plate_with_particles,
    scattered_peaks,
    structured_with_missing,
)
from tsplinejax.plot import (  # noqa: E402
    plot_bands,
    plot_error,
    plot_filling,
    plot_form_removal,
    plot_height_map,
    plot_mesh,
    plot_overview,
    plot_samples,
    plot_sampling_study,
    plot_texture,
    plot_tolerance_study,
    plot_transmission,
)
from tsplinejax.space import bezier_elements  # noqa: E402

IMAGES = Path(__file__).parent / "images"
STYLE = {"font.family": "STIXGeneral", "mathtext.fontset": "stix", "font.size": 10, "axes.linewidth": 0.6}
DOTS_PER_INCH = 125
BLUE, ORANGE = "#17375e", "#c44e1c"


def plate() -> tsj.HeightMap:
    """The plate of the README and the quick start."""
    heights = plate_with_particles((256, 320), particles=30, seed=3).heights
    return tsj.HeightMap(heights, spacing=0.5, unit="µm")


def first_screen() -> Figure:
    """A fitted map with its T-mesh, and the errors."""
    result = tsj.fit(plate(), tolerance="40nm")
    figure, axes = plt.subplots(1, 2, figsize=(9.0, 3.3), layout="constrained")
    plot_mesh(result, axes[0])
    plot_error(result, axes[1])
    axes[0].set_title(f"{len(result.samples)} pixels, {result.control_points} control points")
    axes[1].set_title("data minus surface, tolerance 40 nm")
    return figure


def overview() -> Figure:
    """One page about a fit."""
    return plot_overview(tsj.fit(plate(), tolerance="40nm"))


def tolerance_study() -> Figure:
    """What tolerances cost."""
    study = tsj.tolerance_study(plate(), ["0.8um", "0.4um", "0.2um", "0.1um", "50nm"])
    figure, ax = plt.subplots(figsize=(4.8, 3.2), layout="constrained")
    plot_tolerance_study(study, ax)
    return figure


def noise() -> Figure:
    """Scattered, noisy points, and the surface of a fit that stops at the noise."""
    cloud = scattered_peaks(4000, sigma=0.5)
    result = tsj.fit(cloud, noise=0.5)
    figure, axes = plt.subplots(1, 2, figsize=(8.4, 3.6), layout="constrained")
    x, y, z = cloud.points.T
    points = axes[0].scatter(x, y, c=z, s=2.5, linewidths=0, rasterized=True)
    figure.colorbar(points, ax=axes[0], label="z")
    axes[0].set(xlabel="x", ylabel="y", aspect="equal", xlim=(-3, 3), ylim=(3, -3))
    axes[0].set_title(f"{len(x)} points with noise of standard deviation 0.5")
    plot_mesh(result, axes[1])
    axes[1].set_title(f"stopped at the noise: {result.control_points} control points")
    return figure


def form() -> Figure:
    """A freeform scanned with holes and faults, and its tool marks."""
    return plot_form_removal(tsj.remove_form(freeform_artefact(9_000), method="normal", robust=True))


def sampling() -> Figure:
    """Greville samples on the T-mesh of a laser bump, and what a number of samples is worth."""
    model = tsj.fit(laser_textured_disk((128, 128), bumps=1, scale=3.0), relative_tolerance=0.02).surface
    n = int(model.space.n_functions)
    strategies = ["greville", "t-patch", "element-area", "curvature", "halton", "uniform"]
    study = tsj.sampling_study(model, strategies, [round(share * n) for share in (1, 1.2, 2, 4)])
    figure, axes = plt.subplots(1, 2, figsize=(9.6, 3.8), layout="constrained")
    plot_samples(tsj.sample(model).parameters, model, axes[0])
    axes[0].set_title(f"{n} samples for {n} control points")
    plot_sampling_study(study, axes[1])
    return figure


def filling() -> Figure:
    """Pillars of which a fifth is missing, and how they are filled."""
    pillars = structured_with_missing((112, 112), noise=0.002)
    figure = plot_filling(pillars, tsj.fill_missing(pillars, border=True))
    figure.set_size_inches(12.0, 3.5)
    return figure


def t_mesh() -> Figure:
    """A small T-mesh: T-junctions, a local knot vector, Bézier elements."""
    tmesh = tsj.b_lattice(4, 3)
    for centre in ((0.37, 0.5), (0.4, 0.45), (0.4, 0.45)):
        boxes = tmesh.element_boxes
        tmesh = tsj.refine(tmesh, ((boxes[:, :2] <= centre) & (centre < boxes[:, 2:])).all(axis=1)).mesh
    figure, axes = plt.subplots(1, 2, figsize=(8.6, 3.9), layout="constrained")
    _local_knots(axes[0], tmesh)
    _bezier(axes[1], tmesh)
    return figure


def _local_knots(ax: Axes, tmesh: tsj.TMesh) -> None:
    """The mesh, and rule one at an anchor that sits on a T-junction."""
    _boxes(ax, tmesh.element_boxes, edgecolor=BLUE)
    anchors = np.stack([tmesh.parameters(k, tmesh.anchors[:, k]) for k in (0, 1)], axis=1)
    k = int(np.argmin(np.hypot(*(anchors - (0.5, 0.5)).T)))
    knots = [tmesh.parameters(axis, tmesh.local_knots[k, axis]) for axis in (0, 1)]
    (s0, s1), (t0, t1) = ((line[0], line[-1]) for line in knots)
    ax.add_patch(Rectangle((s0, t0), s1 - s0, t1 - t0, facecolor=ORANGE, alpha=0.15))
    ax.plot(knots[0], np.full(5, anchors[k, 1]), "o-", color=ORANGE, markersize=5)
    ax.plot(np.full(5, anchors[k, 0]), knots[1], "o-", color=ORANGE, markersize=5)
    ax.plot(*anchors[k], "s", color=ORANGE, markersize=8)
    ax.set_title("an anchor, its local knots and its support")


def _bezier(ax: Axes, tmesh: tsj.TMesh) -> None:
    """Where every blending function is one polynomial."""
    index_boxes = bezier_elements(tmesh).boxes
    boxes = np.stack([tmesh.parameters(k % 2, index_boxes[:, k]) for k in range(4)], axis=1)
    _boxes(ax, boxes, edgecolor=ORANGE, linestyle=(0, (3, 2)), linewidth=0.8)
    _boxes(ax, tmesh.element_boxes, edgecolor=BLUE)
    ax.set_title(f"{tmesh.n_elements} elements, {len(boxes)} Bézier elements (dashed)")


def _boxes(ax: Axes, boxes: np.ndarray, **style) -> None:
    for s0, t0, s1, t1 in boxes:
        ax.add_patch(Rectangle((s0, t0), s1 - s0, t1 - t0, facecolor="none", **{"linewidth": 1.0, **style}))
    ax.set(xlim=(-0.02, 1.02), ylim=(1.02, -0.02), aspect=0.75, xlabel="s", ylabel="t")


def filtration() -> Figure:
    """A noisy step, blurred by a Gaussian and with its edge kept, and what both take off."""
    y, x = np.mgrid[0:96, 0:96] * 0.5
    noise = 0.01 * np.random.default_rng(0).normal(size=x.shape)
    data = tsj.HeightMap(np.where(x + 0.3 * y > 31, 1.0, 0.0) + 0.02 * np.sin(y / 8) + noise, 0.5, "µm")
    kept = tsj.filter(data, tolerance="100nm")
    gaussian = tsj.s_filter(data, "6um")
    figure, axes = plt.subplots(2, 3, figsize=(8.4, 4.8), layout="constrained")
    for ax, title, heights in zip(
        axes[0], ("measured", "Gaussian, 6 µm", "edges kept, 0.1 µm"), (data, gaussian, kept.filtered), strict=True
    ):
        plot_height_map(heights, ax)
        ax.set_title(title)
    _profiles(axes[1, 0], (data, gaussian, kept.filtered))
    plot_texture(data.with_heights(data.heights - gaussian.heights), axes[1, 1])
    plot_texture(kept.residual, axes[1, 2])
    return figure


def _profiles(ax: Axes, maps: tuple[tsj.HeightMap, ...]) -> None:
    """The middle row of three maps."""
    styles = (("0.75", "measured", 0.8), (ORANGE, "Gaussian", 1.2), (BLUE, "edges kept", 1.4))
    for height_map, (colour, label, width) in zip(maps, styles, strict=True):
        row = height_map.heights[len(height_map.heights) // 2]
        ax.plot(np.arange(len(row)) * height_map.spacing[0], row, color=colour, label=label, linewidth=width)
    ax.set(xlabel="x (µm)", ylabel="height (µm)", xlim=(14, 40))
    ax.legend(frameon=False, fontsize=8, loc="center right", handlelength=1.2)
    ax.spines[["top", "right"]].set_visible(False)


def transmission() -> Figure:
    """The linear filter on its definition, and the tolerance filter for two amplitudes."""
    lengths, options = 16.0 * np.geomspace(0.25, 4, 9), {"spacing": 1.0, "unit": "µm", "margin": 32.0}
    linear = tsj.transmission(lambda data: tsj.filter(data, cutoff=16.0), lengths, 0.1, phases=4, **options)
    both = tsj.transmission(
        lambda data: tsj.filter(data, cutoff=16.0, tolerance=0.2),
        lengths[:6],
        [0.1, 1.0],
        phases=1,
        directions=[0],
        **options,
    )
    figure, axes = plt.subplots(1, 2, figsize=(9.0, 3.4), layout="constrained", sharey=True)
    plot_transmission(linear, axes[0], cutoff=16.0)
    plot_transmission(both, axes[1], cutoff=16.0)
    return figure


def multiresolution() -> Figure:
    """All bands of the Peaks surface with noise."""
    noisy = peaks((128, 128), noise=0.02)
    figure = plot_bands(tsj.mra(tsj.HeightMap(noisy.heights, 0.5, "µm")))
    figure.set_size_inches(7.0, 4.4)
    return figure


PICTURES: dict[str, Callable[[], Figure]] = {
    "plate": first_screen,
    "overview": overview,
    "tolerance": tolerance_study,
    "noise": noise,
    "t_mesh": t_mesh,
    "form": form,
    "sampling": sampling,
    "filling": filling,
    "filtration": filtration,
    "transmission": transmission,
    "multiresolution": multiresolution,
}


def main() -> None:
    """Draw and write every picture."""
    IMAGES.mkdir(exist_ok=True)
    for name, draw in PICTURES.items():
        with plt.rc_context(STYLE):
            draw().savefig(IMAGES / f"{name}.png", dpi=DOTS_PER_INCH)
        plt.close("all")


if __name__ == "__main__":
    main()
