"""What perspective does to patches that are laid on each other by affinities."""

import numpy as np
import pytest
from benchmarks.pictured_scenes import WIDE, Face, picture_of
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.perception import NaturalKind
from omniservo.perception.perspective_bias import LEAST_NEIGHBOURS, SHARE, perspective_bias
from omniservo.perception.tangent_patches import TangentFrames
from omniservo.scenes.textures import texture

NORMAL, DISTANCE = np.array([0.4, -0.3, 0.866]), 0.6
"""of the plane that is seen"""
GOAL = RigidTransform.from_components([0.12, -0.05, 0.15], Rotation.from_rotvec([0.1, -0.2, 0.4]))
WINDOW = 0.1
"""[rad]"""
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(5)


def on_plane(bearings, normal=NORMAL, distance=DISTANCE):
    return bearings * (distance / (bearings @ normal))[..., None]


def seen(points):
    there = GOAL.inv().apply(points.reshape(-1, 3)).reshape(points.shape)
    return there / np.linalg.norm(there, axis=-1, keepdims=True)


def rms(differences):
    return np.sqrt((differences**2).mean())


def bearings_of(count, seed=0, spread=0.5):
    rng = np.random.default_rng(seed)
    found = np.column_stack((rng.uniform(-spread, spread, (count, 2)), np.ones(count)))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


class Patches:
    """Exact places, affinities, and how far the mean over each window lies from its middle."""

    def __init__(self, bearings, surface=on_plane):
        self.one, self.other = TangentFrames.at(bearings), TangentFrames.at(seen(surface(bearings)))

        def mapped(x):
            goal = seen(surface(self.one.directions(np.broadcast_to(x, (len(bearings), 1, 2)))[:, 0]))
            return self.other.places(goal)

        self.places = mapped([0.0, 0.0])
        step = 1e-5
        self.affinities = np.stack(
            [(mapped(e) - mapped(-e)) / (2.0 * step) for e in step * np.eye(2)], axis=2
        )
        whole = (2.0 * np.pi) ** 0.5
        mean = sum(
            a * b / whole**2 * mapped(WINDOW * np.array([u, v]))
            for u, a in zip(NODES, WEIGHTS, strict=True)
            for v, b in zip(NODES, WEIGHTS, strict=True)
        )
        self.moved = mean - self.places

    def bias(self, rows=slice(None), affinities=None):
        return perspective_bias(
            self.one[rows],
            self.other[rows],
            self.places[rows],
            (self.affinities if affinities is None else affinities)[rows],
            np.full(len(self.one[rows]), WINDOW),
        )


def test_patches_of_a_plane_are_off_by_a_share_of_the_mean_over_their_windows():
    patches = Patches(bearings_of(200))
    assert np.linalg.norm(patches.moved, axis=1).min() > 1e-4
    assert rms(patches.bias() - SHARE * patches.moved) < 0.05 * SHARE * rms(patches.moved)


def test_affinities_that_are_a_little_wrong_hardly_matter():
    patches = Patches(bearings_of(200))
    off = np.random.default_rng(1).normal(0.0, 0.02, (200, 2, 2))
    error = patches.bias(affinities=patches.affinities + off) - SHARE * patches.moved
    assert rms(error) < 0.1 * SHARE * rms(patches.moved)


def test_a_turned_camera_s_patches_are_not_off():
    """Rotations map tangent planes to tangent planes by affinities."""
    bearings = bearings_of(100)
    turned = GOAL.rotation.inv().apply(bearings)
    one, other = TangentFrames.at(bearings), TangentFrames.at(turned)
    along = np.stack([other.places(turned + 1e-5 * GOAL.rotation.inv().apply(e)) / 1e-5
                      for e in (one.first, one.second)], axis=2)  # fmt: skip
    bias = perspective_bias(one, other, np.zeros((100, 2)), along, np.full(100, WINDOW))
    assert np.abs(bias).max() < 1e-8


def test_wrong_matches_among_the_neighbours_do_no_harm():
    patches = Patches(bearings_of(200))
    right = SHARE * patches.moved
    wrong = np.arange(200) % 5 == 0
    patches.places[wrong] += np.random.default_rng(2).normal(0.0, 0.1, (40, 2))
    assert patches.bias()[~wrong] == pytest.approx(right[~wrong], abs=0.1 * np.abs(right).max())


def test_where_two_planes_meet_each_keeps_most_of_its_own():
    bearings = bearings_of(400)
    left = bearings[:, 0] < 0.0

    def surface(rays):
        near, far = on_plane(rays), on_plane(rays, np.array([-0.5, 0.2, 0.84]), 0.55)
        return np.where(left[:, None], near, far)

    patches = Patches(bearings, surface)
    assert rms(patches.bias() - SHARE * patches.moved) < 0.5 * SHARE * rms(patches.moved)


def test_a_few_matches_tell_nothing_and_the_same_one_again_tells_no_more():
    patches = Patches(bearings_of(200))
    assert not patches.bias(slice(LEAST_NEIGHBOURS)).any()
    same = Patches(np.tile(bearings_of(1), (20, 1)))
    assert not same.bias().any()
    around = Patches(np.vstack((bearings_of(20), [[0.0, 0.0, -1.0]])), lambda rays: 0.5 * rays)
    assert np.isfinite(around.bias()).all()


@pytest.mark.parametrize("seed", [2, 4])
def test_matches_on_a_slanted_board_are_not_all_off_alike(seed):
    """Through a fisheye of 280°, whose pixels are large; without what is tested by 0.13 px in the mean."""
    rng, tilt = np.random.default_rng(seed), Rotation.from_rotvec([0.5, 0.4, 0.3])
    place = RigidTransform.from_components([0.0, 0.0, 0.5], tilt)
    board = Face(place, np.array([0.4, 0.4]), texture("poster", seed, 64, 64))
    goal = RigidTransform.from_components([0.05, 0.1, 0.2], Rotation.from_rotvec([0.2, -0.1, 0.3]))
    one, other = (picture_of([board], WIDE, pose, rng) for pose in (RigidTransform.identity(), goal))
    match = NaturalKind().match(WIDE, one, other)
    normal = tilt.apply([0.0, 0.0, 1.0])
    points = on_plane(WIDE.unproject(match.initial)[0], normal, 0.5 * normal[2])
    error = match.goal - WIDE.project(goal.inv().apply(points))[0]
    error = error[np.linalg.norm(error, axis=1) < 0.5]
    assert len(error) > 30
    assert np.linalg.norm(error.mean(axis=0)) < 0.06
