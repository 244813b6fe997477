"""Form removal: texture recovered on maps and clouds, signs, poses, area weights, round apertures, and bad input."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tsplinejax as tsj
from tsplinejax import HeightMap, InputError, PointCloud, Sphere, remove_form
from tsplinejax.characterise._absorbed import absorbed_share
from tsplinejax.characterise._triangulation import triangulate
from tsplinejax.data import freeform_artefact, saddle_with_texture
from tsplinejax.orthogonal import Parametric

TURN = Rotation.from_rotvec([0.4, -0.9, 0.3]).as_matrix()
UP = TURN[:, 2]


def saddle(count: int = 60, **options) -> tuple[PointCloud, np.ndarray]:
    """A textured saddle and its true texture, along the normals."""
    cloud = saddle_with_texture((count, count), **options)
    form = saddle_with_texture((count, count), **{**options, "roughness": 0.0}).points
    normals = np.column_stack([-3 * form[:, 0], 3 * form[:, 1], np.ones(len(form))])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return cloud, np.einsum("mi,mi->m", cloud.points - form, normals)


def dome(method: str = "parametric", unit: str = "µm", factor: float = 1.0, **options) -> tsj.FormRemoval:
    """A round dome, rows and columns differently spaced, in any unit."""
    x, y = np.meshgrid((np.arange(60) - 30) * 0.1, (np.arange(50) - 25) * 0.12)
    heights = np.sqrt(64 - x**2 - y**2) + 0.01 * np.cos(9 * x)
    heights[np.hypot(x, y) > 2.9] = np.nan
    return remove_form(HeightMap(heights * factor, (0.1 * factor, 0.12 * factor), unit), method=method, **options)


def test_texture_of_the_saddle():
    """Along normals the texture comes back but for what looks like form; along z its steep flanks are wrong."""
    cloud, true = saddle(90)
    errors = {}
    for method in ("joint", "height"):
        removal = remove_form(cloud, method=method)
        errors[method] = float(np.sqrt(np.mean((removal.texture - true) ** 2)))
        assert removal.control_points == 36
    assert errors["joint"] < 0.0135
    assert errors["height"] > 3 * errors["joint"]


def test_the_absorbed_share_is_a_fair_estimate():
    """For texture of many correlation lengths an element: what the form took, within a third of the truth."""
    cloud, true = saddle(90)
    removal = remove_form(cloud, method=Parametric())
    lost = np.sqrt(np.mean((removal.texture - true) ** 2)) / true.std()
    assert np.sqrt(removal.absorbed_share) == pytest.approx(lost, rel=0.33)


def test_fine_marks_are_not_said_to_be_lost():
    """Waves much finer than the elements: no share, though the form has 36 degrees of freedom."""
    places = np.random.default_rng(0).random((20000, 2))
    texture = np.cos(2 * np.pi * 40 * places[:, 0])
    assert absorbed_share(texture, places, np.ones(20000), 36.0, 1.0) < 0.01


def test_pose_and_side():
    """A rotated cloud gives the same texture; with the other side outside its negative."""
    cloud, _ = saddle(40)
    plain = remove_form(cloud, method="parametric")
    turned = PointCloud(cloud.points @ TURN.T + (9.0, -4.0, 2.0))
    again = remove_form(turned, method="parametric", outward=UP)
    assert again.sq_texture == pytest.approx(plain.sq_texture, rel=1e-6)
    np.testing.assert_allclose(again.normal, UP, atol=0.05)
    other = remove_form(cloud, method="parametric", outward=(0, 0, -1))
    assert other.sq_texture == pytest.approx(plain.sq_texture, rel=1e-6)
    assert np.corrcoef(other.texture, plain.texture)[0, 1] < -0.99
    assert other.normal[2] < -0.9


def test_outward_is_heard_before_the_winding():
    """Of a mesh whose triangles are wound inwards the texture has the wrong sign, unless `outward` is stated."""
    x, y = np.meshgrid(np.linspace(-1, 1, 30), np.linspace(-1, 1, 30))
    points = np.column_stack([x.ravel(), y.ravel(), (0.3 * x * y + 0.01 * np.cos(20 * x)).ravel()])
    corner = (np.arange(29)[:, None] * 30 + np.arange(29)).ravel()
    lower = np.stack([corner, corner + 1, corner + 31], axis=1)
    upwards = np.concatenate([lower, np.stack([corner, corner + 31, corner + 30], axis=1)])
    inwards = PointCloud(points, triangles=upwards[:, ::-1])
    for parameters in ("planar", "conformal"):
        options = {"method": "parametric", "parameters": parameters}
        plain = remove_form(PointCloud(points, triangles=upwards), **options)
        assert np.corrcoef(plain.texture, np.cos(20 * points[:, 0]))[0, 1] > 0.9
        assert np.corrcoef(remove_form(inwards, **options).texture, plain.texture)[0, 1] < -0.99
        stated = remove_form(inwards, outward=(0, 0, 1), **options)
        np.testing.assert_allclose(stated.texture, plain.texture, atol=1e-9)
        assert stated.normal[2] > 0.9


def test_units():
    """The same dome in metres: every length is a millionth, nothing else changes."""
    micro, metre = dome(), dome(unit="m", factor=1e-6)
    assert metre.unit == "m"
    assert metre.sq_texture == pytest.approx(1e-6 * micro.sq_texture, rel=1e-6)
    assert metre.absorbed_share == pytest.approx(micro.absorbed_share, rel=1e-4)
    np.testing.assert_allclose(metre.texture * 1e6, micro.texture, atol=1e-8)


def test_a_round_aperture():
    """A map with missing corners: the waves come back on its own pixels, the corners stay missing."""
    removal = dome()
    assert removal.texture_map is not None
    assert removal.texture_map.shape == (50, 60)
    np.testing.assert_array_equal(np.isnan(removal.texture_map.heights), ~removal.data.valid)
    assert removal.sq_texture == pytest.approx(0.01 / np.sqrt(2), rel=0.05)
    assert removal.form_points.shape == removal.points.shape
    off = removal.points - removal.form_points
    np.testing.assert_allclose(np.sum(off * removal.normals, axis=1), removal.texture, atol=1e-9)


def round_cloud(count: int = 8000) -> PointCloud:
    """Scattered points of a round dome of radius 3 on a sphere of 8, waves of 0.01 on it."""
    angle, square = np.random.default_rng(9).random((2, count))
    x, y = 3 * np.sqrt(square) * np.stack([np.cos(2 * np.pi * angle), np.sin(2 * np.pi * angle)])
    direction = np.column_stack([x, y, np.sqrt(64 - x**2 - y**2)]) / 8
    return PointCloud((8 + 0.01 * np.cos(9 * x))[:, None] * direction, "mm")


@pytest.mark.parametrize("method", ["joint", "parametric"])
def test_a_round_cloud(method):
    """A cloud without corners: the waves come back all over it, up to its outline."""
    cloud = round_cloud()
    removal = remove_form(cloud, method=method)
    true = 0.01 * np.cos(9 * cloud.points[:, 0] * 8 / np.linalg.norm(cloud.points, axis=1))
    assert removal.sq_texture == pytest.approx(0.01 / np.sqrt(2), rel=0.06)
    assert np.corrcoef(removal.texture, true)[0, 1] > 0.98
    assert np.abs(removal.texture - true).max() < 0.01
    assert np.isfinite(removal.texture_map.heights).mean() > 0.7


def test_a_round_map_by_the_default_method():
    """A map with missing corners by the joint method: the waves on its own pixels."""
    removal = dome("joint")
    assert removal.sq_texture == pytest.approx(0.01 / np.sqrt(2), rel=0.06)
    assert removal.texture_map.shape == (50, 60)


def test_density_and_pose_change_nothing():
    """The scanned artefact, even or one half twice as dense, as it lies or turned: the same Sq within 1 %."""
    found = []
    for density, pose in ((1.0, None), (2.0, None), (2.0, TURN)):
        scan = freeform_artefact(16_000, density=density, rotation=pose)
        up = (0, 0, 1) if pose is None else UP
        found.append(remove_form(scan, method="parametric", robust=True, outward=up).sq_texture)
    assert max(found) < 1.01 * min(found)


def test_a_sphere_as_the_form():
    """Vertical and orthogonal; the report says which, and the waves are what is left."""
    for method, distance in (("joint", "orthogonal"), ("height", "vertical")):
        removal = dome(method, form=Sphere())
        assert removal.method == distance
        assert removal.form.values["radius"] == pytest.approx(8, rel=2e-3)
        assert removal.sq_texture == pytest.approx(0.01 / np.sqrt(2), rel=0.05)
        assert removal.edf == 4


def test_a_given_form():
    """A model that is known takes part as it is: no fit, no degree of freedom, no absorbed texture."""
    fitted = dome()
    again = remove_form(fitted.data, form=fitted.form)
    assert again.edf == 0
    assert again.absorbed_share == 0
    np.testing.assert_allclose(again.texture, fitted.texture, atol=2e-4)


def test_density_does_not_weigh():
    """Half of a waved strip three times as dense: weighted by area, Sq is that of the even one within 1 %."""
    generator = np.random.default_rng(3)

    def strip(counts: tuple[int, int]) -> PointCloud:
        x = np.concatenate([generator.uniform(-1, 0, counts[0]), generator.uniform(0, 1, counts[1])])
        y = generator.uniform(-1, 1, len(x))
        # Waves of twice the amplitude on the dense half: counting points instead of area is 20 % off.
        z = 0.4 * x * y + np.where(x > 0, 0.02, 0.01) * np.cos(40 * y)
        return PointCloud(np.column_stack([x, y, z]))

    even, dense = (remove_form(strip(counts), form="poly2") for counts in ((6000, 6000), (6000, 18000)))
    assert dense.sq_texture == pytest.approx(even.sq_texture, rel=0.01)
    assert abs(np.std(dense.texture) / even.sq_texture - 1) > 0.05


def test_areas_of_scattered_points():
    """Triangles that bridge a hole do not count: the areas sum to that of the square without the hole."""
    places = np.random.default_rng(1).random((20000, 2))
    places = places[np.hypot(*(places - 0.5).T) > 0.2]
    found = triangulate(places)
    assert found is not None
    areas = found.areas(np.column_stack([places, np.zeros(len(places))]))
    assert areas.sum() == pytest.approx(1 - np.pi * 0.04, rel=0.02)


def test_operations_are_listed_in_order():
    """S-filter, levelling, form, L-filter; the waves of 0.7 µm survive an L-filter of 3 µm."""
    removal = dome("height", s_filter=0.3, level="sphere", l_filter="3um")
    starts = [line.split()[0] for line in removal.operations]
    assert starts == ["S-filter", "F-operation", "F-operation", "L-filter"]
    assert removal.sq_texture == pytest.approx(0.01 / np.sqrt(2), rel=0.15)


def test_an_l_filter_acts_on_samples_and_map_alike():
    """What the filter takes off the resampled map of a cloud, it takes off the samples: the long of two waves goes."""
    x, y = np.random.default_rng(2).uniform(-1, 1, (2, 12000))
    cloud = PointCloud(np.column_stack([x, y, 0.3 * x * y + 0.02 * np.cos(9 * y) + 0.01 * np.cos(45 * x)]))
    whole, fine = (remove_form(cloud, form="poly2", l_filter=cutoff) for cutoff in (None, 0.3))
    assert whole.sq_texture > 0.014
    assert fine.sq_texture == pytest.approx(0.01 / np.sqrt(2), rel=0.1)
    assert float(np.nanstd(fine.texture_map.heights)) == pytest.approx(fine.sq_texture, rel=0.1)
    assert fine.operations[-1].startswith("L-filter")


def test_the_report_is_plain():
    """Every figure under its name, in the JSON types."""
    report = dome().report
    assert report["operations"][-1].startswith("F-operation T-spline, parametric, 36 control points")
    assert isinstance(report["normal"], list)
    assert repr(dome()).startswith("FormRemoval(")


BARE = np.random.default_rng(0).normal(size=(20, 30))
BAD = {
    "bare": (BARE, {}, "--spacing, --unit"),
    "method": (BARE, {"method": "best"}, "a method is one of joint, normal"),
    "tolerance": (BARE, {"method": "height", "tolerance": -1.0}, "above zero"),
    "lattice": (BARE, {"method": "height", "lattice": (0, 3)}, "two whole numbers"),
    "simple and lattice": (BARE, {"method": "height", "form": "plane", "lattice": (3, 3)}, "neither tolerance nor"),
    "parameters": (saddle(20)[0], {"parameters": "spherical"}, "'planar', 'conformal'"),
    "shape": (saddle(20)[0], {"parameters": np.zeros((3, 2))}, "one \\(s, t\\) a valid sample"),
    "outside": (saddle(20)[0], {"parameters": np.full((400, 2), 2.0)}, "lie in \\[0, 1\\]"),
    "outward": (saddle(20)[0], {"outward": (0, 1)}, "outward is a direction"),
    "line": (np.outer(np.arange(50.0), [1, 2, 3]), {}, "line"),
    "nan": (np.full((9, 3), np.nan), {}, "finite"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input(case):
    """Each error gives the rule and the remedy."""
    data, options, message = BAD[case]
    with pytest.raises(InputError, match=message):
        remove_form(data, **options)


@pytest.mark.slow
def test_the_scanned_artefact():
    """10⁵ points in any pose with holes, outliers and dust: Sq within 2 %, marks correlated by 0.98 with the truth."""
    count = 120_000
    clean = freeform_artefact(count, outliers=0)
    form = freeform_artefact(count, outliers=0, roughness=0).points
    removal = remove_form(freeform_artefact(count, rotation=TURN, shift=(100, -50, 20)), robust=True, outward=UP)
    assert len(removal.points) >= 100_000
    kept = ~removal.outliers
    offsets = clean.points - form
    true = np.linalg.norm(offsets, axis=1) * np.sign(offsets[:, 2])
    weights = removal.weights / removal.weights.sum()
    truth = np.sqrt(weights @ (true - weights @ true) ** 2)
    assert removal.sq_texture == pytest.approx(truth, rel=0.02)
    assert np.corrcoef(removal.texture[kept], true[kept])[0, 1] >= 0.98
    damaged = np.linalg.norm(freeform_artefact(count).points - clean.points, axis=1)
    assert removal.outliers[damaged == 0].mean() < 1e-3


@pytest.mark.slow
def test_a_measured_dome(shared_data):
    """A polished silicon dome with missing corners: 3.7 µm of form leave a few nanometres."""
    measured = tsj.read(shared_data / "mnt-2.mnt")
    dome = HeightMap(measured.heights[::4, ::4], tuple(4 * step for step in measured.spacing), measured.unit)
    removal = remove_form(dome, method="normal", robust=True)
    assert removal.sq_texture < 2e-3 * measured.range
    assert removal.texture_map.shape == dome.shape
    sphere = remove_form(dome, form="sphere", robust=True)
    assert sphere.sq_texture > 3 * removal.sq_texture


@pytest.mark.slow
def test_a_patch_of_the_turbine_blade(shared_data):
    """A curved patch of a mesh: the form follows within a thousandth of its size, on the side of the winding."""
    blade = tsj.read(shared_data / "turbineblade.ply", unit="mm")
    corners = blade.points[blade.triangles].astype(float)
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing /= np.maximum(np.linalg.norm(facing, axis=1, keepdims=True), 1e-300)
    middle = corners.mean(axis=1)
    seed = np.argmin(np.linalg.norm(middle - np.median(middle, axis=0), axis=1))
    near = np.linalg.norm(middle - middle[seed], axis=1) < 0.06 * blade.diagonal
    triangles = blade.triangles[near & (facing @ facing[seed] > 0.5)]
    used, renumbered = np.unique(triangles, return_inverse=True)
    patch = PointCloud(blade.points[used], "mm", triangles=renumbered.reshape(-1, 3))
    removal = remove_form(patch, method="normal")
    assert len(patch) > 500
    assert removal.sq_texture < 2e-3 * patch.diagonal
    assert removal.normal @ facing[seed] > 0.8
