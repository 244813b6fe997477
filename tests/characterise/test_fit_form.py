"""Simple forms: exact recovery in any pose, agreement with odrpack, robustness, minimum zones, and bad input."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tsplinejax import Cylinder, HeightMap, InputError, Plane, PointCloud, Polynomial, Sphere, fit_form
from tsplinejax.characterise._shapes import PolynomialShape

TURN = Rotation.from_rotvec([0.7, -1.1, 0.4]).as_matrix()
SHIFT = np.array([5.0, -60.0, 700.0])
EXACT = 1e-10


def square(count: int = 1500, seed: int = 0) -> np.ndarray:
    """Places in [-1, 1]²."""
    return np.random.default_rng(seed).uniform(-1, 1, (count, 2))


def cap(radius: float) -> np.ndarray:
    """Points of a sphere around the origin, above [-1, 1]²."""
    plane = square()
    return np.column_stack([plane, np.sqrt(radius**2 - (plane**2).sum(axis=1))])


def pipe(radius: float, span: float) -> np.ndarray:
    """Points of a cylinder about z, over an angle."""
    angle, along = (square() * (span / 2, 1.5)).T
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), along])


@pytest.mark.parametrize("radius", [1.5, 10.0, 300.0])
def test_spheres_are_recovered(radius):
    """Centre and radius of exact points, from half a sphere to a cap of 0.4 % sagitta."""
    fitted = fit_form(cap(radius) @ TURN.T + SHIFT, Sphere())
    assert fitted.converged
    assert fitted.values["radius"] == pytest.approx(radius, rel=EXACT)
    np.testing.assert_allclose(fitted.values["centre"], SHIFT, atol=EXACT * 700)
    assert np.abs(fitted.residuals).max() < EXACT


def test_a_whole_sphere_is_recovered():
    """Points all around: there is no upper side."""
    points = np.random.default_rng(1).normal(size=(500, 3))
    fitted = fit_form(3 * points / np.linalg.norm(points, axis=1, keepdims=True) + SHIFT, "sphere")
    assert fitted.values["radius"] == pytest.approx(3, rel=EXACT)


@pytest.mark.parametrize("span", [0.3, 1.0, 3.0, 2 * np.pi])
def test_cylinders_are_recovered(span):
    """Axis and radius, from a narrow strip to the whole pipe."""
    fitted = fit_form(pipe(2.0, span) @ TURN.T + SHIFT, Cylinder())
    assert fitted.values["radius"] == pytest.approx(2, rel=EXACT)
    assert abs(fitted.values["axis"] @ TURN[:, 2]) == pytest.approx(1, abs=EXACT)
    off = fitted.values["point"] - SHIFT
    assert np.linalg.norm(np.cross(off, TURN[:, 2])) < EXACT * 700


def test_planes_are_recovered():
    """Normal and place, in any pose."""
    plane = np.column_stack([square(), np.zeros(1500)])
    fitted = fit_form(plane @ TURN.T + SHIFT, Plane())
    assert abs(fitted.values["normal"] @ TURN[:, 2]) == pytest.approx(1, abs=EXACT)
    assert np.abs(fitted.residuals).max() < EXACT


@pytest.mark.parametrize("distance", ["orthogonal", "vertical"])
@pytest.mark.parametrize("form", ["sphere", "cylinder", "poly2", "poly5"])
def test_height_maps(form, distance):
    """Maps with missing pixels and unequal spacing: along z and along the normal the exact form is found."""
    x, y = np.meshgrid(np.arange(30) * 0.1, np.arange(25) * 0.08)
    polynomial = 0.3 * x**2 - 0.2 * x * y + 0.1 * y - 1 + (0.05 * x**3 * y**2 if form == "poly5" else 0)
    exact = {
        "sphere": np.sqrt(64 - (x - 1) ** 2 - (y - 2) ** 2),
        "cylinder": np.sqrt(25 - (0.6 * x - 0.8 * y) ** 2),
        "poly2": polynomial,
        "poly5": polynomial,
    }[form]
    heights = exact.copy()
    heights[5:9, 3:8] = np.nan
    fitted = fit_form(HeightMap(heights, (0.1, 0.08), "mm"), form, distance=distance)
    assert len(fitted.residuals) == np.isfinite(heights).sum()
    assert np.abs(fitted.residuals).max() < EXACT
    if form.startswith("poly"):
        values = fitted.values
        dx, dy = x - values["point"][0], y - values["point"][1]
        terms = zip(values["coefficients"], values["exponents"], strict=True)
        np.testing.assert_allclose(sum(c * dx**i * dy**j for c, (i, j) in terms), exact, atol=1e-9)


def test_project_gives_feet():
    """Feet lie on the form, and points stand over them along the normal; beyond the fitted points, too."""
    for points, form in ((cap(3.0), "sphere"), (pipe(2.0, 2.0), "cylinder"), (cap(9.0), "poly4")):
        fitted = fit_form(points, form)
        others = points[:50] * 1.05
        foot = fitted.project(others)
        np.testing.assert_allclose(foot.points + foot.distances[:, None] * foot.normals, others, atol=1e-9)
        np.testing.assert_allclose(fitted.project(foot.points).distances, 0, atol=1e-9)
        np.testing.assert_allclose(np.linalg.norm(foot.normals, axis=1), 1, atol=1e-12)


def _sphere_through(x, beta):
    """Distance to a sphere of centre and radius."""
    return np.sqrt(((x - beta[:3, None]) ** 2).sum(axis=0)) - beta[3]


def _cylinder_through(x, beta):
    """Distance to a cylinder about the line (a + c z, b + d z, z)."""
    axis = np.array([beta[2], beta[3], 1.0]) / np.sqrt(beta[2] ** 2 + beta[3] ** 2 + 1)
    off = x - np.array([[beta[0]], [beta[1]], [0.0]])
    across = off - axis[:, None] * (axis @ off)
    return np.sqrt((across**2).sum(axis=0)) - beta[4]


AGAINST = {
    "sphere": (lambda: cap(3.0)[:400], _sphere_through, [0.1, -0.1, 0.2, 2.5]),
    "cylinder": (lambda: pipe(2.0, 3.0)[:400], _cylinder_through, [0.1, -0.1, 0.05, 0.02, 1.8]),
}


@pytest.mark.parametrize("form", AGAINST)
def test_against_odrpack(form):
    """With noise in all coordinates the sum of squared distances is that of odrpack's implicit fit, or below."""
    odrpack = pytest.importorskip("odrpack", reason="odrpack, a peer in the extra bench, is not installed")
    exact, model, start = AGAINST[form]
    points = exact() + 0.01 * np.random.default_rng(4).normal(size=(400, 3))
    found = odrpack.odr_fit(
        model, points.T, np.zeros(400), np.array(start), task="implicit-ODR", sstol=1e-15, partol=1e-13, maxit=500
    )
    ours = fit_form(points, form)
    assert ours.values["radius"] == pytest.approx(found.beta[-1], rel=1e-5)
    squares, theirs = np.sum(ours.residuals**2), np.sum(model(points.T, found.beta) ** 2)
    assert squares <= theirs * (1 + 1e-12)
    assert squares == pytest.approx(theirs, rel=1e-6)


def test_planes_against_odrpack():
    """With noise in all coordinates the plane is that of odrpack's explicit orthogonal fit of z = a x + b y + c."""
    odrpack = pytest.importorskip("odrpack", reason="odrpack, a peer in the extra bench, is not installed")
    x, y = square(400).T
    points = np.column_stack([x, y, 0.7 * x - 0.4 * y + 2]) + 0.02 * np.random.default_rng(4).normal(size=(400, 3))
    found = odrpack.odr_fit(
        lambda places, beta: beta[0] * places[0] + beta[1] * places[1] + beta[2],
        points[:, :2].T,
        points[:, 2],
        np.zeros(3),
        sstol=1e-15,
        partol=1e-13,
        maxit=500,
    )
    a, b, c = found.beta
    length = np.sqrt(a**2 + b**2 + 1)
    ours = fit_form(points, "plane")
    np.testing.assert_allclose(ours.values["normal"], np.array([-a, -b, 1]) / length, atol=1e-7)
    theirs = np.sum((points @ [-a, -b, 1] - c) ** 2) / length**2
    assert np.sum(ours.residuals**2) <= theirs * (1 + 1e-12)


def test_feet_that_rest_take_no_more_steps(monkeypatch):
    """The feet on a polynomial need about five of Newton's steps each, wherever the slowest of them is."""
    x, y = np.meshgrid(np.linspace(-1, 1, 60), np.linspace(-1, 1, 60))
    heights = np.cos(2 * x) * np.sin(1.5 * y + 0.3) + 0.01 * np.random.default_rng(0).normal(size=x.shape)
    fitted = fit_form(HeightMap(heights, 2 / 59, "mm"), Polynomial(8))
    taken, step = [], PolynomialShape._newton

    def counted(shape, points, feet):
        taken.append(len(points))
        return step(shape, points, feet)

    monkeypatch.setattr(PolynomialShape, "_newton", counted)
    points = np.column_stack([x.ravel() + 1, y.ravel() + 1, heights.ravel()])
    assert np.abs(fitted.project(points).distances).max() < 0.1
    assert sum(taken) < 8 * len(points)


@pytest.mark.parametrize("form", ["plane", "sphere", "cylinder", "poly3"])
@pytest.mark.parametrize("distance", ["orthogonal", "vertical"])
def test_least_squares_is_a_minimum(form, distance):
    """No small step in any of the numbers lowers the sum of squares."""
    points = np.column_stack([square(), 0.2 * np.sin(3 * square()[:, 0]) + 0.1 * square()[:, 1] ** 2])
    points += 0.02 * np.random.default_rng(2).normal(size=points.shape)
    fitted = fit_form(points, form, distance=distance)
    scaled = (points - fitted._centre) / fitted._scale
    for step in np.concatenate([np.eye(fitted.form.size), -np.eye(fitted.form.size)]):
        moved = fitted._shape.moved(1e-4 * step)
        left = moved.contact(scaled).distances if distance == "orthogonal" else (scaled - moved.above(scaled))[:, 2]
        assert np.sum(left**2) * fitted._scale**2 > np.sum(fitted.residuals**2)


def test_robust_resists_outliers():
    """With 5 % of the points off by up to the size of the cap, the robust radius stays; the plain one does not."""
    points = cap(3.0) + 0.002 * np.random.default_rng(5).normal(size=(1500, 3))
    points[::20] += np.random.default_rng(6).uniform(0, 1, size=(75, 3))
    plain, robust = (fit_form(points, "sphere", robust=choice).values["radius"] for choice in (False, True))
    assert abs(plain - 3) > 0.02
    assert abs(robust - 3) < 0.004


@pytest.mark.parametrize("form", ["plane", "sphere", "cylinder", "poly2"])
def test_minimum_zone(form):
    """The zone is no wider than that of least squares, and within a millionth of a bound that none can be below."""
    x, y = square(3000).T
    z = np.sqrt(9 - x**2 - y**2) if form == "sphere" else np.sqrt(9 - x**2) if form == "cylinder" else 0.2 * x**2
    points = np.column_stack([x, y, z + np.random.default_rng(7).uniform(-0.01, 0.01, 3000)])
    least, zone = (fit_form(points, form, criterion=name) for name in ("least squares", "minimum zone"))
    assert zone.zone < least.zone
    assert zone.converged
    assert zone.lower_bound <= zone.zone <= zone.lower_bound * (1 + 1e-6)


def test_minimum_zone_of_a_known_plane():
    """Points 0.1 above and 0.1 below a plane all over it: the zone is 0.2, though least squares tilts to one side."""
    plane = square(400)
    generator = np.random.default_rng(8)
    sides = np.where(generator.random(400) < 0.5 + 0.3 * plane[:, 0], 1.0, -1.0)
    points = np.column_stack([plane, 0.1 * sides]) @ TURN.T + SHIFT
    least, zone = (fit_form(points, "plane", criterion=name) for name in ("least squares", "minimum zone"))
    assert abs(least.values["normal"] @ TURN[:, 2]) < 0.9999
    assert abs(zone.values["normal"] @ TURN[:, 2]) == pytest.approx(1, abs=1e-9)
    assert zone.zone == pytest.approx(0.2, abs=1e-9)


def test_the_side_that_is_outside():
    """Residuals are positive outside: up by default, towards `outward`, or where a mesh's winding looks."""
    points = np.vstack([cap(3.0), [[0, 0, 3.5]]])
    assert fit_form(points, "sphere").residuals[-1] > 0
    assert fit_form(points, "sphere", outward=(0, 0, -1)).residuals[-1] < 0
    triangles = [[0, 1, 2]] if np.cross(points[1] - points[0], points[2] - points[0])[2] < 0 else [[0, 2, 1]]
    assert fit_form(PointCloud(points, triangles=triangles), "sphere").residuals[-1] < 0


BAD = {
    "too few": (np.eye(3), "sphere", {}, "at least 4 points"),
    "on a line": (np.outer(np.arange(9.0), [1, 2, 3]), "plane", {}, "not all on one line"),
    "in one place": (np.ones((9, 3)), "plane", {}, "not all on one line"),
    "another form": (cap(3.0), "cone", {}, "plane, polyN"),
    "order": (cap(3.0), "poly99", {}, "from 0 to 20"),
    "distance": (cap(3.0), "plane", {"distance": "horizontal"}, "'orthogonal' or 'vertical'"),
    "criterion": (cap(3.0), "plane", {"criterion": "best"}, "'least squares' or 'minimum zone'"),
    "zone and robust": (cap(3.0), "plane", {"criterion": "minimum zone", "robust": True}, "neither weights nor robust"),
    "weights": (cap(3.0), "plane", {"weights": [1.0, 2.0]}, "weights are 1500 numbers"),
    "outward": (cap(3.0), "plane", {"outward": (0, 0, 0)}, "outward is a direction"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input(case):
    """Each error gives the rule and what was received."""
    points, form, options, message = BAD[case]
    with pytest.raises(InputError, match=message):
        fit_form(points, form, **options)


def test_polynomial_order_is_whole():
    """Half an order is refused."""
    with pytest.raises(InputError, match="whole number"):
        Polynomial(2.5)  # pyright: ignore[reportArgumentType]
