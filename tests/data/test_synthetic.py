"""Synthetic surfaces: figures of the reference surfaces, independence of resolution, poses, noise, missing pixels."""

import numpy as np
import pytest

from tsplinejax import data
from tsplinejax._errors import InputError

# Range, standard deviation and three heights of the benchmark surfaces, from their own definition.
PIXELS = ((100, 37), (255, 256), (300, 10))
REFERENCE = {
    "T1": (data.laser_textured_disk, {}, 27.980403235582994, 5.403515918455801,
           (0.06199802281328067, 0.0, 0.00018713679539671157)),
    "T2": (data.plate_with_particles, {}, 4.60622499311317, 0.5288441481033797,
           (0.765922572647904, 0.2874337869966922, -0.2800339770521217)),
    "T2n": (data.plate_with_particles, {"noise": 0.01}, 4.723579367433336, 0.5308613496147244,
            (0.6843629218357191, 0.3471901681033781, -0.31917850888706784)),
    "T6": (data.sparse_bumps, {}, 1.7557035184955812, 0.3002929002070568,
           (0.10388203466828111, -0.4622220777473551, -0.09383709427278288)),
}  # fmt: skip


@pytest.mark.parametrize("name", REFERENCE)
def test_figures_of_the_reference_surfaces(name):
    """The 512 x 512 maps are the benchmark surfaces, to rounding."""
    make, options, extent, deviation, heights = REFERENCE[name]
    height_map = make(**options)
    assert height_map.shape == (512, 512)
    assert height_map.range == pytest.approx(extent, rel=1e-12)
    assert height_map.heights.std() == pytest.approx(deviation, rel=1e-12)
    np.testing.assert_allclose([height_map.heights[pixel] for pixel in PIXELS], heights, atol=1e-12)


def test_scattered_peaks_are_the_reference_cloud():
    """Places, truth and noise of the scattered benchmark."""
    cloud, truth = data.scattered_peaks(), data.scattered_peaks(sigma=0.0)
    np.testing.assert_allclose(cloud.points[0], [-2.486105, -2.23642219, -0.02912037], atol=1e-7)
    np.testing.assert_array_equal(cloud.points[:, :2], truth.points[:, :2])
    assert (cloud.points - truth.points)[:, 2].std() == pytest.approx(0.05, rel=0.01)


def test_missing_blobs_are_the_reference_ones():
    """55 313 pixels (21.1 %) are missing of a surface of range 1.14142; the complete one agrees elsewhere."""
    height_map, complete = data.structured_with_missing(), data.structured_with_missing(missing=0.0)
    assert (~height_map.valid).sum() == 55313
    assert complete.range == pytest.approx(1.1414218901391322, rel=1e-12)
    np.testing.assert_array_equal(height_map.heights[height_map.valid], complete.heights[height_map.valid])


@pytest.mark.parametrize(
    ("make", "coarse", "fine", "step"),
    [
        (data.laser_textured_disk, (65, 33), (129, 65), slice(None, None, 2)),
        (data.plate_with_particles, (65, 33), (129, 65), slice(None, None, 2)),
        (data.sparse_bumps, (64, 32), (192, 96), slice(1, None, 3)),
        (data.peaks, (65, 33), (129, 65), slice(None, None, 2)),
    ],
)
def test_resolution_only_samples_the_formula(make, coarse, fine, step):
    """Pixels at the same place have the same height at any resolution and aspect."""
    np.testing.assert_allclose(make(fine).heights[step, step], make(coarse).heights, atol=1e-11)


def test_missing_blobs_do_not_move_with_resolution():
    """The missing region is one region, sampled."""
    fine, coarse = (data.structured_with_missing(shape).valid for shape in ((513, 513), (129, 129)))
    assert (fine[::4, ::4] == coarse).mean() > 0.99


@pytest.mark.parametrize("make", [data.laser_textured_disk, data.plate_with_particles, data.sparse_bumps])
def test_a_quarter_turn_turns_the_map(make):
    """Rotating the pattern by 90 degrees about the middle rotates the array."""
    plain, turned = make((96, 96)).heights, make((96, 96), rotation=np.pi / 2).heights
    np.testing.assert_allclose(np.rot90(plain, -1), turned, atol=1e-11)


@pytest.mark.parametrize("make", [data.laser_textured_disk, data.plate_with_particles, data.sparse_bumps])
def test_a_shift_moves_the_pattern_along_s_then_t(make):
    """A shift by (0.25, 0.5) shows what lies there."""
    count = 97 if make is not data.sparse_bumps else 96
    plain, moved = make((count, count)).heights, make((count, count), shift=(0.25, 0.5)).heights
    np.testing.assert_allclose(moved[:48, :72], plain[48:96, 24:96], atol=1e-11)


def test_oblique_particles_turn_with_the_plate():
    """An elliptic particle's axes rotate with the pattern: each point sees the formula at its turned place."""
    angle = 0.3
    turned = data.plate_with_particles((33, 33), rotation=angle, seed=3).heights
    fine = data.plate_with_particles((3201, 3201), seed=3).heights
    u, v = np.meshgrid(np.linspace(0, 1, 33), np.linspace(0, 1, 33), indexing="ij")
    place_u = 0.5 + np.cos(angle) * (u - 0.5) - np.sin(angle) * (v - 0.5)
    place_v = 0.5 + np.sin(angle) * (u - 0.5) + np.cos(angle) * (v - 0.5)
    inside = (place_u > 0) & (place_u < 1) & (place_v > 0) & (place_v < 1)
    pixel = tuple(np.rint(3200 * place[inside]).astype(int) for place in (place_u, place_v))
    assert np.abs(fine[pixel] - turned[inside]).max() < 0.06


def test_noise_is_relative_and_seeded():
    """Noise has the standard deviation asked for, relative to the range, and is the same for a seed."""
    plain, noisy = data.peaks((200, 200)), data.peaks((200, 200), noise=0.02, noise_seed=4)
    assert (noisy.heights - plain.heights).std() == pytest.approx(0.02 * plain.range, rel=0.02)
    np.testing.assert_array_equal(noisy.heights, data.peaks((200, 200), noise=0.02, noise_seed=4).heights)


def test_the_saddle_carries_its_texture_along_normals():
    """Sq 0.033, mean 0, the stated correlation, along the normals of the form; resolution only samples it."""
    cloud, form = data.saddle_with_texture(), data.saddle_with_texture(roughness=0.0)
    x, y, z = form.points.T
    np.testing.assert_allclose(z, 1.5 * (x**2 - y**2), atol=1e-15)
    moved = cloud.points - form.points
    normal = np.stack([-3 * x, 3 * y, np.ones_like(x)], axis=1) / np.sqrt(1 + 9 * x**2 + 9 * y**2)[:, None]
    texture = (moved * normal).sum(axis=1)
    np.testing.assert_allclose(moved, texture[:, None] * normal, atol=1e-15)
    assert texture.std() == pytest.approx(0.033, rel=0.01)
    grid = texture.reshape(90, 90) / texture.std()
    step = 2 / 89
    for lag in (1, 2, 3):
        expected = np.exp(-((lag * step) ** 2) / (2 * 0.045**2))
        assert (grid[:, :-lag] * grid[:, lag:]).mean() == pytest.approx(expected, abs=0.03)
    fine = data.saddle_with_texture((179, 179)).points.reshape(179, 179, 3)[::2, ::2]
    np.testing.assert_allclose(fine.reshape(-1, 3), cloud.points, atol=1e-12)


def test_steps():
    """A sharp step has two heights; a wide one rises monotonically; its direction is the angle against s."""
    assert set(np.unique(data.step(height=2.0).heights)) == {0.0, 2.0}
    np.testing.assert_array_equal(data.step((8, 8), angle=np.pi / 2).heights, data.step((8, 8)).heights.T)
    assert (np.diff(data.step((4, 64), width=0.1).heights, axis=1) > 0).all()


@pytest.mark.parametrize(
    ("make", "options"),
    [
        (data.laser_textured_disk, {"shape": (1, 8)}),
        (data.laser_textured_disk, {"shape": 8}),
        (data.laser_textured_disk, {"shape": (8, 8), "bumps": 0}),
        (data.peaks, {"shape": (8, 8), "noise": -0.1}),
        (data.peaks, {"shape": (8.5, 8)}),
        (data.structured_with_missing, {"shape": (8, 8), "missing": 1.0}),
        (data.scattered_peaks, {"points": 0}),
        (data.saddle_with_texture, {"shape": (1, 8)}),
        (data.saddle_with_texture, {"correlation_length": 0.0}),
    ],
)
def test_bad_options_are_refused(make, options):
    """Nonsense sizes and amplitudes are refused."""
    with pytest.raises(InputError):
        make(**options)
