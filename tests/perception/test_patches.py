"""Patches on tangent planes: their derivatives, their interpolation, and where they are found again."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from textured_scenes import facing_plate, picture, pose, rough_texture

from omniservo.cameras import UnifiedCamera
from omniservo.perception.align_patches import align, make_templates
from omniservo.perception.local_affinity import local_affinities, transported
from omniservo.perception.patch_kernels import write_greys
from omniservo.perception.rival_kernels import best_and_rival
from omniservo.perception.tangent_patches import TangentFrames, sample

CAMERA = UnifiedCamera(220.0, 221.0, 239.0, 162.0, 1.29, 480, 330, max_angle=np.radians(100.0))


def bearings(seed, count, angle_deg=85.0):
    rng = np.random.default_rng(seed)
    angle, turn = np.radians(angle_deg) * np.sqrt(rng.uniform(0, 1, count)), rng.uniform(0, 2 * np.pi, count)
    return np.stack([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)], axis=1)


def test_a_planes_jacobian_is_the_cameras_along_its_axes():
    frames = TangentFrames.at(bearings(0, 50))
    exact = CAMERA.project_jacobian(frames.bearings)[1] @ np.stack([frames.first, frames.second], axis=2)
    np.testing.assert_allclose(frames.jacobians(CAMERA), exact, rtol=1e-6, atol=1e-5)


def test_places_and_directions_are_inverse():
    frames = TangentFrames.at(bearings(1, 50))
    places = np.random.default_rng(2).uniform(-0.5, 0.5, (50, 2))
    rays = frames.directions(places[:, None])[:, 0]
    np.testing.assert_allclose(
        frames.places(rays / np.linalg.norm(rays, axis=1)[:, None]), places, atol=1e-12
    )


def test_the_interpolation_reproduces_a_quadratic():
    v, u = np.mgrid[0:20, 0:30].astype(float)
    image = (2.0 + 0.3 * u - 0.7 * v + 0.02 * u * u + 0.05 * u * v - 0.03 * v * v).astype(np.float32)
    pixels = np.random.default_rng(0).uniform([2, 2], [27, 17], (1, 200, 2))
    greys = np.empty((1, 200))
    write_greys(image, pixels, greys)
    u, v = pixels[0].T
    np.testing.assert_allclose(
        greys[0], 2.0 + 0.3 * u - 0.7 * v + 0.02 * u * u + 0.05 * u * v - 0.03 * v * v, atol=2e-5
    )


@pytest.fixture(scope="module")
def image():
    plates = [facing_plate(rough_texture(np.random.default_rng(1)), 40.0)]
    return picture(CAMERA, plates, pose([0, 0, 0]), rays=2).astype(np.float32)


def on_the_plate(seed, count):
    turn = Rotation.from_euler("y", 40, degrees=True)
    return TangentFrames.at(turn.apply(bearings(seed, count, 10.0)))


def test_a_templates_derivatives_are_those_of_its_grey(image):
    frames = on_the_plate(3, 6)
    pitch = np.full(6, 0.012)
    templates = make_templates(CAMERA, image, frames, pitch, 8)
    step = 0.02
    u = np.stack(np.meshgrid(np.arange(-8.0, 9.0), np.arange(-8.0, 9.0)), axis=-1).reshape(-1, 2)
    for p, change in enumerate(np.eye(6)):
        ends = []
        for sign in (1.0, -1.0):
            affine = np.eye(2) + sign * step * change[:4].reshape(2, 2) / 8.0
            shift = np.tile(sign * step * change[4:] * pitch[0], (6, 1))
            ends.append(sample(CAMERA, image, frames, shift, np.tile(pitch[0] * affine, (6, 1, 1)), u)[0])
        slope = (ends[0] - ends[1]) / (2.0 * step) * (8.0 if p < 4 else 1.0)
        for i in np.flatnonzero(templates.whole):
            alike = np.corrcoef(slope[i], templates.steepest[i, :, p])[0, 1]
            assert (
                alike > 0.9
            )  # the template takes differences over two samples, and leaves out gain and offset


def test_a_patch_is_found_where_it_was_moved_to_under_another_gain(image):
    frames = on_the_plate(4, 12)
    templates = make_templates(CAMERA, image, frames, np.full(12, 0.009), 8)
    start = np.random.default_rng(0).uniform(-0.01, 0.01, (12, 2))
    turn = np.tile([[1.05, 0.08], [-0.08, 0.97]], (12, 1, 1))
    found = align(CAMERA, (0.5 * image + 30.0).astype(np.float32), templates, frames, start, turn, steps=25)
    assert templates.whole.all()
    assert found.converged.mean() > 0.9
    assert np.abs(found.places[found.converged]).max() < 2e-4  # 0.03 px
    assert np.abs(found.affinities[found.converged] - np.eye(2)).max() < 0.01
    assert found.correlation[found.converged].min() > 0.999


def test_transported_frames_go_there_and_back():
    frames, there = TangentFrames.at(bearings(5, 40)), bearings(6, 40)
    moved = transported(frames, there)
    np.testing.assert_allclose((moved.first * there).sum(1), 0.0, atol=1e-12)
    np.testing.assert_allclose(transported(moved, frames.bearings).first, frames.first, atol=1e-12)


def test_neighbours_tell_the_affinity_of_a_patch():
    before = TangentFrames.at(bearings(7, 30, 3.0))
    matrix = np.array([[1.2, 0.3], [-0.1, 0.8]])
    axis = TangentFrames.at(np.array([[0.0, 0.0, 1.0]]))
    places = before.bearings[:, :2] / before.bearings[:, 2:]
    rays = axis.directions((places @ matrix.T)[None])[0]
    after = transported(before, rays / np.linalg.norm(rays, axis=1)[:, None])
    found = local_affinities(before, after, np.ones(30, dtype=bool))
    assert np.abs(found - matrix).max() < 0.15  # drawn towards a similarity
    alone = local_affinities(before, after, np.arange(30) == 4)
    np.testing.assert_array_equal(alone[4], np.eye(2))


@pytest.mark.parametrize("itself", [False, True])
def test_the_rival_is_the_most_similar_one_elsewhere(itself):
    rng = np.random.default_rng(8)
    pixels, reach = rng.uniform(0, 20, (40, 2)), rng.uniform(1, 6, 40)
    similarity = rng.uniform(-1, 1, (40, 40)).astype(np.float32)
    best, rival = np.empty(40, np.int64), np.empty(40, np.int64)
    best_and_rival(similarity, pixels, reach, itself, best, rival)
    first = np.arange(40) if itself else similarity.argmax(1)
    np.testing.assert_array_equal(best, first)
    away = np.linalg.norm(pixels[None] - pixels[first][:, None], axis=2) > reach[first][:, None]
    np.testing.assert_array_equal(rival, np.where(away, similarity, -2.0).argmax(1))
