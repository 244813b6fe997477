"""What is not one disk, or does not fit it, is refused with the reason."""

import numpy as np
import pytest

from tsplinejax import InputError, PointCloud
from tsplinejax.parameterisation import conformal, find_boundary, find_corners

from .surfaces import grid, grid_triangles, scattered

GENERATOR = np.random.default_rng(0)
SHEET = np.column_stack([*grid(12, 9), np.zeros(108)])
TRIANGLES = grid_triangles(12, 9)
CLOUD = np.column_stack([*scattered(500, 0), np.zeros(500)])


def _sphere(count):
    directions = np.random.default_rng(1).normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def _tetrahedron():
    return PointCloud(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], triangles=[[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]
    )


def _branched():
    wing = SHEET[:, [0, 2, 1]] + [0, SHEET[48, 1], 0]
    points = np.concatenate([SHEET, wing[12:]])
    number = np.concatenate([np.arange(48, 60), np.arange(108, 108 + 96)])
    return PointCloud(points, triangles=np.concatenate([TRIANGLES, number[TRIANGLES]]))


def _moebius(count=60):
    angle = np.repeat(np.linspace(0, 2 * np.pi, count, endpoint=False), 2)
    across = np.tile([-0.3, 0.3], count)
    radius = 1 + across * np.cos(angle / 2)
    points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), across * np.sin(angle / 2)])
    left, right = np.arange(0, 2 * count, 2), np.arange(1, 2 * count, 2)
    next_left, next_right = np.append(left[1:], right[0]), np.append(right[1:], left[0])
    triangles = np.concatenate(
        [np.column_stack([left, right, next_right]), np.column_stack([left, next_right, next_left])]
    )
    return PointCloud(points, triangles=triangles)


def _mug():
    """A torus with a square cut out."""
    u, v = (angle.ravel() for angle in np.meshgrid(np.arange(24) * np.pi / 12, np.arange(12) * np.pi / 6))
    points = np.column_stack([(2 + np.cos(v)) * np.cos(u), (2 + np.cos(v)) * np.sin(u), np.sin(v)])
    i, j = (index.ravel() for index in np.meshgrid(np.arange(24), np.arange(12)))
    a, b, c, d = (((j + dj) % 12) * 24 + (i + di) % 24 for di, dj in ((0, 0), (1, 0), (1, 1), (0, 1)))
    triangles = np.concatenate([np.column_stack([a, b, c])[1:], np.column_stack([a, c, d])[1:]])
    return PointCloud(points, triangles=triangles)


def _wall_on_a_floor():
    floor = np.column_stack([2 * scattered(3000, 2)[0] - 1, 2 * scattered(3000, 2)[1] - 1, np.zeros(3000)])
    u, v = scattered(1500, 3)
    return np.concatenate([floor, np.column_stack([2 * u - 1, np.zeros(1500), 0.02 + v])])


NOT_A_DISK = {
    "closed mesh": (_tetrahedron(), "closed"),
    "closed cloud": (_sphere(2000), "closed"),
    "two pieces of a mesh": (
        PointCloud(np.concatenate([SHEET, SHEET + [3, 0, 0]]), triangles=np.concatenate([TRIANGLES, TRIANGLES + 108])),
        "2 pieces",
    ),
    "two clouds": (np.concatenate([CLOUD, CLOUD + [3, 0, 0]]), "2 pieces"),
    "branched mesh": (_branched(), "branches"),
    "branched cloud": (_wall_on_a_floor(), "branched"),
    "triangle given twice": (PointCloud(SHEET, triangles=[*TRIANGLES, TRIANGLES[3], TRIANGLES[3]]), "branches"),
    "one-sided": (_moebius(), "two sides"),
    "handle": (_mug(), "handles"),
    "line": (np.outer(np.arange(50.0), [1, 2, 3]), "one line"),
    "point": (np.ones((50, 3)), "one line"),
    "NaN": (np.where(CLOUD == CLOUD[7], np.nan, CLOUD), "finite"),
    "few": (CLOUD[:8], "at least 12"),
    "equal points": (np.concatenate([CLOUD, CLOUD[[3]]]), "3 and 500 are equal"),
    "no triangle": (PointCloud(SHEET, triangles=[[0, 0, 1]]), "no triangle"),
}


@pytest.mark.parametrize("name", NOT_A_DISK)
def test_not_a_disk(name):
    """Closed, branched, in pieces, one-sided, collinear, ... : an `InputError` that says which."""
    data, message = NOT_A_DISK[name]
    with pytest.raises(InputError, match=message) as caught:
        conformal(data)
    assert "\n" not in str(caught.value)


RIM = [0, 11, 107, 96]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"corners": [0, 11, 107, 0]}, "0 is given twice"),
        ({"corners": [0, 11, 107]}, "four points"),
        ({"corners": [0, 11, 107, 96.0]}, "four points"),
        ({"corners": [0, 11, 107, 108]}, "0 to 107"),
        ({"corners": [0, 11, 107, 50]}, "50 does not"),
        ({"corners": [0, 107, 11, 96]}, "in order"),
        ({"boundary": [0, 11, 107, 96]}, "loops of free edges"),
        ({"boundary": [0, 11, 11, 96]}, "11 is given twice"),
        ({"boundary": [0, 11]}, "at least four"),
        ({"outward": (0, 0, np.nan)}, "outward"),
        ({"neighbours": 2}, "neighbours"),
        ({"max_points": 3}, "max_points"),
    ],
)
def test_misuse(options, message):
    """Corners and boundaries that do not fit, and options out of range."""
    with pytest.raises(InputError, match=message):
        conformal(PointCloud(SHEET, triangles=TRIANGLES), **options)


def test_equal_points_can_share_parameters():
    """On request, equal points are one; a mesh whose seams repeat vertices is whole again."""
    repeated = np.concatenate([CLOUD, CLOUD[:40]])
    parameters = conformal(repeated, merge_duplicates=True).parameters
    np.testing.assert_array_equal(parameters[500:], parameters[:40])
    np.testing.assert_allclose(parameters[:500], conformal(CLOUD).parameters, atol=1e-9)
    soup = PointCloud(SHEET[TRIANGLES].reshape(-1, 3), triangles=np.arange(TRIANGLES.size).reshape(-1, 3))
    whole = conformal(PointCloud(SHEET, triangles=TRIANGLES)).parameters
    np.testing.assert_allclose(conformal(soup, merge_duplicates=True).parameters, whole[TRIANGLES.ravel()], atol=1e-9)


def test_given_corners_and_boundary():
    """Corners name the rectangle; clockwise ones are turned round; a boundary may be given, either way round."""
    mesh = PointCloud(SHEET, triangles=TRIANGLES)
    given = conformal(mesh, corners=[11, 107, 96, 0]).parameters
    np.testing.assert_allclose(given[[11, 107, 96, 0]], [[0, 0], [1, 0], [1, 1], [0, 1]])
    np.testing.assert_array_equal(conformal(mesh, corners=[11, 0, 96, 107]).parameters, given)
    loop = find_boundary(SHEET)
    assert len(loop) == 2 * (11 + 8)
    for boundary in (loop, loop[::-1]):
        np.testing.assert_allclose(conformal(SHEET, boundary=boundary).parameters, SHEET[:, :2], atol=1e-6)
    np.testing.assert_array_equal(find_corners(SHEET, loop), RIM)


def test_boundary_leaves_holes_out():
    """The outer loop only, counter-clockwise seen from outside."""
    u, v = grid(40, 40)
    keep = np.hypot(u - 0.5, v - 0.5) > 0.25
    points = np.column_stack([u, v, 0.2 * u * v])[keep]
    loop = find_boundary(points)
    assert len(loop) == 4 * 39
    assert _area(points[loop]) == pytest.approx(1)
    assert _area(points[find_boundary(points, outward=(0, 0, -1))]) == pytest.approx(-1)


def _area(ring):
    x, y = ring[:, 0], ring[:, 1]
    return 0.5 * float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())
