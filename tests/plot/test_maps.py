"""Height maps, T-meshes and error maps: place, direction, colours and units of what is drawn."""

import sys
import time
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pytest

from tsplinejax._errors import InputError, MissingExtraError
from tsplinejax.data import Frame, HeightMap, PointCloud, Samples
from tsplinejax.mesh import b_lattice
from tsplinejax.plot import plot_error, plot_filling, plot_height_map, plot_mesh
from tsplinejax.plot._error import signed_errors
from tsplinejax.plot._mesh import mesh_lines
from tsplinejax.space import spline_space
from tsplinejax.surface import make_surface, normals

WIDE_MAP = HeightMap(np.random.default_rng(0).random((40, 2000)), (1.0, 1.0), "µm")


def _image(ax):
    return ax.get_images()[0]


def _bar(ax):
    return ax.child_axes[0]


def test_row_zero_is_on_top(height_map):
    """The first row is drawn at the top and y points down, so that lettering reads right."""
    ax = plot_height_map(height_map)
    left, right, bottom, top = _image(ax).get_extent()
    assert left < right
    assert top < bottom
    assert ax.yaxis.get_inverted()
    assert not ax.xaxis.get_inverted()
    assert ax.get_aspect() == 1.0


def test_missing_is_grey(height_map):
    """Missing heights are drawn in a grey that no height has."""
    image = _image(plot_height_map(height_map))
    red, green, blue, opacity = image.get_cmap().get_bad()
    assert red == green == blue
    assert opacity == 1
    assert np.ma.getmaskarray(image.get_array()).sum() == (~height_map.valid).sum()


def test_heights_are_written_in_a_readable_unit(height_map):
    """A fifth of a micrometre on a map in millimetres reads in nanometres; x and y stay in millimetres."""
    ax = plot_height_map(height_map)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x (mm)", "y (mm)")
    assert _bar(ax).get_ylabel() == "height (nm)"
    assert ax.get_xlim()[1] == pytest.approx(2.0, abs=0.01)


def test_unknown_units_are_not_invented():
    """A bare array has axes without units."""
    ax = plot_height_map(np.eye(5))
    assert (ax.get_xlabel(), _bar(ax).get_ylabel()) == ("x", "height")


def test_spikes_do_not_take_all_colours():
    """With one wild pixel the colours still span the rest, and the colour bar points at what lies beyond."""
    heights = np.random.default_rng(0).random((100, 100))
    heights[50, 50] = 1000.0
    ax = plot_height_map(heights)
    assert _image(ax).get_clim()[1] < 1.1
    assert _image(ax).colorbar.extend == "max"


@pytest.mark.parametrize(
    "data",
    [np.full((4, 5), 2.0), np.zeros((1, 9)), WIDE_MAP, PointCloud(np.random.default_rng(0).random((50, 3)))],
    ids=["constant", "one row", "wide", "cloud"],
)
def test_unusual_data_are_drawn(data):
    """Constant maps, single rows, wide maps and clouds all give a picture."""
    plot_height_map(data).figure.canvas.draw()


def test_wide_map_carries_its_colour_bar_on_top():
    """Beside a map that is fifty times wider than high there is no room for a colour bar."""
    ax = plot_height_map(WIDE_MAP)
    ax.figure.canvas.draw()
    assert _bar(ax).get_window_extent().y0 > ax.get_window_extent().y1
    assert _bar(ax).get_xlabel() == "height (µm)"


def test_own_axes_keep_their_style(height_map):
    """Drawing on the caller's axes returns them and leaves matplotlib's settings alone."""
    before = dict(plt.rcParams)
    _, ax = plt.subplots()
    assert plot_height_map(height_map, ax) is ax
    assert ax.xaxis.label.get_fontfamily() == plt.rcParams["font.family"]
    assert dict(plt.rcParams) == before


def test_large_maps_are_quick(tmp_path):
    """Ten million pixels are drawn and saved in less than five seconds of processor time."""
    heights = np.random.default_rng(0).random((2500, 4000))
    start = time.process_time()
    plot_height_map(HeightMap(heights, (1.0, 1.0), "µm")).figure.savefig(tmp_path / "map.png")
    assert time.process_time() - start < 5


def test_missing_matplotlib_is_named(monkeypatch, height_map):
    """Without matplotlib the error says what to install."""
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtraError, match=r"tsplinejax\[plot\]"):
        plot_height_map(height_map)


def test_what_is_no_data_is_refused():
    """A string is no surface."""
    with pytest.raises(InputError):
        plot_height_map("coin.x3p")


def test_lattice_lines_run_through():
    """The skeleton of a lattice without T-junctions is one line for each knot."""
    lines = mesh_lines(b_lattice(5, 3).element_boxes)
    assert len(lines) == 6 + 4
    np.testing.assert_allclose(np.abs(np.diff(lines, axis=1)).sum(axis=(1, 2)), 1.0)


def test_lines_end_at_t_junctions(surface):
    """Together the lines have the length of the T-mesh's skeleton, and none is drawn twice."""
    boxes = surface.space.mesh.element_boxes
    sides = boxes[:, 2:] - boxes[:, :2]
    # Every inner edge bounds two elements, every border edge one.
    skeleton = (2 * sides.sum() + 4) / 2
    lines = mesh_lines(boxes)
    assert np.abs(np.diff(lines, axis=1)).sum() == pytest.approx(skeleton, rel=1e-12)
    assert len(np.unique(lines.round(12), axis=0)) == len(lines)


def test_mesh_lies_over_the_data(result, height_map):
    """The T-mesh is drawn in the data's coordinates, over the samples that were fitted."""
    ax = plot_mesh(result)
    np.testing.assert_array_equal(np.ma.filled(_image(ax).get_array(), np.nan), height_map.heights)
    ends = np.concatenate(ax.collections[0].get_segments())
    np.testing.assert_allclose([ends.min(axis=0), ends.max(axis=0)], [[0, 0], [2.0, 1.2]], atol=1e-12)


def test_mesh_without_data_lies_over_the_surface(surface):
    """A surface alone is drawn with its own heights below the mesh; other data replace them."""
    assert _image(plot_mesh(surface)).get_array().shape == (240, 400)
    assert _image(plot_mesh(surface, data=np.eye(7))).get_array().shape == (7, 7)


def test_error_colours_are_symmetric(result):
    """The error's colours are symmetric about 0, reach beyond the tolerance, and no outlier stretches them."""
    ax = plot_error(result)
    low, high = _image(ax).get_clim()
    assert low == -high
    assert result.tolerance < high <= 4 * result.tolerance
    assert ax.get_legend().get_texts()[0].get_text() == "2 set aside"


def test_tolerance_is_marked_on_the_colour_bar(result):
    """The colour bar has lines and labelled ticks at ±ε, in the unit of its label."""
    bar = _bar(plot_error(result))
    assert [line.get_ydata()[0] for line in bar.lines] == [-result.tolerance, result.tolerance]
    assert r"$\varepsilon = 2$" in [label.get_text() for label in bar.get_yticklabels()]
    assert bar.get_ylabel() == "error (nm)"


def test_error_without_tolerance(result):
    """A fit to the noise has no tolerance to mark: the colours end at the largest error."""
    result.tolerance, result.outliers = None, None
    ax = plot_error(result)
    assert _image(ax).get_clim()[1] == np.abs(result.residuals).max()
    assert not _bar(ax).lines


def test_sign_in_space_is_the_side_of_the_surface():
    """For a model in space the error is positive on the side of the normal, with the Euclidean magnitude."""
    generator = np.random.default_rng(0)
    parameters = generator.random((40, 2))
    lattice = b_lattice(2, 2)
    place = lattice.anchors / lattice.extent[0]
    points = np.column_stack([place, 0.1 * generator.random(25)])
    surface_in_space = make_surface(spline_space(lattice), points, Frame((0, 0), (1, 1), "mm"))
    offset = np.where(np.arange(40) % 2, 0.1, -0.2)
    residuals = offset[:, np.newaxis] * np.asarray(normals(surface_in_space, parameters))
    samples = Samples(
        parameters, np.asarray(surface_in_space(parameters)) + residuals, frame=Frame((0, 0), (1, 1), "mm")
    )
    result = SimpleNamespace(
        surface=surface_in_space, samples=samples, residuals=residuals, outliers=None, tolerance=0.3
    )
    np.testing.assert_allclose(signed_errors(result), offset)
    plot_error(result).figure.canvas.draw()


def test_a_real_surface_is_drawn():
    """What the stand-ins promise, a `TSpline` has: its mesh is drawn over its own heights."""
    space = spline_space(b_lattice(4, 2))
    surface = make_surface(space, np.linspace(0, 1, 35), Frame((1.0, 2.0), (4.0, 2.0), "µm"))
    ax = plot_mesh(surface)
    assert len(ax.collections[0].get_segments()) == 5 + 3
    assert ax.get_xlim()[0] == pytest.approx(1.0, abs=0.01)


def test_filling_shows_both_maps_in_the_same_colours(height_map):
    """Before and after share their colours, and the uncertainty starts at zero where pixels were filled."""
    holed = height_map.with_mask(np.arange(height_map.heights.size).reshape(height_map.shape) % 97 == 5)
    uncertainty = np.where(holed.valid, np.nan, 0.25)
    figure = plot_filling(holed, SimpleNamespace(map=height_map, uncertainty=uncertainty))
    images = [_image(ax) for ax in figure.axes[:3]]
    assert images[0].get_clim() == images[1].get_clim()
    assert images[2].get_clim() == (0.0, 0.25)
    assert [ax.get_title() for ax in figure.axes[:3]] == ["measured", "filled", "standard uncertainty"]
