"""A move is certified only where it is clear, in view and within the joints' ranges, with room for errors."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from tests.looks.conftest import FLANGE_T_CAMERA, MOUNT, START

from omniservo.cameras import UnifiedCamera, preset
from omniservo.looks import FOLLOWED, CertifiedMove, certified_move
from omniservo.looks.certified_move import _image_room, following_tube, mount_room
from omniservo.looks.next_look import structures
from omniservo.robots import CAMERA_HOUSING, ArmBodies, MountedCamera, Solid
from omniservo.robots.collision.own_sight import own_sight_in

END = START + np.radians([6.0, -4.0, 5.0, 3.0, -4.0, 8.0])


def move_of(here, end=END, samples=None):
    samples = structures(here.estimate, 0, here.planned_rows) if samples is None else samples
    return certified_move(here.asked, here.setting, samples, (here.start, end), here.mount)


def test_a_free_move_keeps_every_sampled_structure_in_view_and_every_body_off(standing):
    here = standing(obstacles=[((0.0, -0.3, 0.1), 0.04)])
    move = move_of(here)
    assert isinstance(move, CertifiedMove)
    assert move.plan.status == "certified"
    assert move.clearance.status == "clear"
    bodies = here.setting.bodies(here.asked.obstacles)
    samples = move.plan.problem.points
    for q in move.joints(np.linspace(0.0, 1.0, 41)):
        bodies.place(q)
        asked = bodies.asked(here.setting.clearance_around, here.setting.self_clearance)
        assert all(near.gap >= asked[near.pair] for near in bodies.near(0.05))
        pixels, valid = here.asked.camera.project(here.camera_at(q).inv().apply(samples))
        assert valid.all()
        assert here.asked.camera.in_image(pixels).all()


@pytest.mark.parametrize(
    ("obstacles", "end", "why"),
    [
        ([((0.06, 0.02, 0.0), 0.03)], END, "clearance obstacle 0|apart|overlap|start pose"),
        ([((0.11, 0.0, -0.15), 0.05)], END, "apart|overlap"),
        ([], START + np.radians([0, 0, 0, 0, -130.0, 0]), "visibility|domain"),
        ([], np.radians([10.0, 20.0, 110.0, 5.0, 140.0, 0.0]), "end of its range"),
    ],
    ids=["through a ball", "a link near a ball", "out of view", "beyond a joint's range"],
)
def test_a_move_that_is_not_certified_says_why(standing, obstacles, end, why):
    found = move_of(standing(obstacles=obstacles), end)
    assert isinstance(found, str)
    assert any(words in found for words in why.split("|")), found


def test_what_is_kept_for_joints_off_the_line_holds_for_every_point_of_the_arm(arm):
    carried = [solid.moved(FLANGE_T_CAMERA) for solid in CAMERA_HOUSING]
    bodies = ArmBodies(arm, mounted=carried)
    tube, random = following_tube(bodies, FLANGE_T_CAMERA), np.random.default_rng(0)
    most = dict.fromkeys(bodies.links, 0.0)
    for _ in range(200):
        q, rays = random.uniform(*arm.joint_range.T), random.normal(size=(len(bodies.shapes.radii), 3))
        rays *= bodies.shapes.radii[:, None] / np.linalg.norm(rays, axis=1, keepdims=True)
        ends = []
        for at in (q, q + FOLLOWED * random.choice([-1.0, 1.0], arm.dof)):
            bodies.place(at)
            axes = bodies.scene.axes.reshape(-1, 3, 3)
            ends.append(bodies.scene.places + np.einsum("gij,gj->gi", axes, np.nan_to_num(rays)))
        gone = np.linalg.norm(ends[1] - ends[0], axis=1)
        for link in bodies.links:
            most[link] = max(most[link], float(gone[bodies.shapes_of(link)].max()))
    assert all(0.0 < most[link] <= tube.links[link] for link in bodies.links)


@pytest.mark.slow
@pytest.mark.parametrize("aside", [0.0, 0.4])
def test_what_is_kept_for_joints_off_the_line_holds_for_a_camera_wherever_it_sits(arm, aside):
    mount = RigidTransform.from_translation([aside, 0.0, 0.1])
    kept, random, gone = following_tube(ArmBodies(arm), mount).position, np.random.default_rng(0), []
    for _ in range(2000):
        q = random.uniform(*arm.joint_range.T)
        off = q + FOLLOWED * random.choice([-1.0, 1.0], arm.dof)
        gone.append(np.subtract(*((arm.base_T_flange(at) * mount).translation for at in (q, off))))
    assert 0.5 * kept < np.linalg.norm(gone, axis=1).max() <= kept


def test_the_mounts_error_moves_what_stands_still_by_no_more_than_is_kept():
    pose = RigidTransform.from_exp_coords([0.2, -0.3, 0.1, 0.08, 0.02, -0.05])
    room, random, worst = mount_room(pose, MOUNT, 0.5), np.random.default_rng(1), []
    x = np.array([0.1, 0.2, 0.4])
    for _ in range(500):
        error = np.sqrt(np.diag(MOUNT)) * random.standard_normal(6)
        mount = RigidTransform.from_exp_coords(np.concatenate([error[3:], error[:3]]))
        there = mount.inv() * pose * mount
        worst.append(np.linalg.norm(there.inv().apply(x) - pose.inv().apply(x)))
    assert np.quantile(worst, 0.99) < room < 6.0 * np.quantile(worst, 0.99)
    assert mount_room(pose, None, 0.5) == 0.0


def test_what_is_kept_in_the_image_holds_for_a_camera_that_is_turned_and_displaced():
    fisheye = preset("fe185")
    points = np.array([[0.3, 0.2, 0.4], [-0.2, 0.1, 0.5], [0.0, 0.0, 0.3]])
    before, rng = fisheye.project(points)[0], np.random.default_rng(7)
    for turned, off in ((1e-4, 0.0), (0.0, 1e-4), (1e-4, 1e-4)):
        most = 0.0
        for _ in range(300):
            turn, shift = rng.standard_normal((2, 3))
            turn, shift = turned * turn / np.linalg.norm(turn), off * shift / np.linalg.norm(shift)
            pose = RigidTransform.from_exp_coords(np.concatenate([turn, shift]))
            gone = np.linalg.norm(fisheye.project(pose.apply(points))[0] - before, axis=1)
            most = max(most, float(gone.max()))
        kept = _image_room(fisheye, points, turned, off)
        assert 0.5 * kept < most < 1.001 * kept


def test_room_for_the_mounts_error_is_kept_off_what_comes_near_on_the_way_only(standing):
    """A ball 13 cm off the arm at first, which the camera passes nearer than the mount's error allows."""
    ball, end = np.array([0.212, -0.009, -0.127]), START + np.radians([20.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    here = standing(obstacles=[(ball, 0.03)])
    bodies = here.setting.bodies(here.asked.obstacles)
    pairs, gaps = [i for i in range(len(bodies.pairs)) if bodies.is_around(i)], []
    for q in START + np.linspace(0.0, 1.0, 41)[:, None] * (end - START):
        bodies.place(q)
        gaps.append(min(bodies.measure(pair) for pair in pairs))
    assert gaps[0] > 0.12
    lost = 3.0 * np.sqrt(MOUNT[0, 0] + MOUNT[3, 3] * 0.5 * (ball @ ball))
    assert 0.01 < min(gaps) < 0.01 + lost
    found = move_of(here, end)
    assert isinstance(found, str)
    assert "apart" in found
    assert isinstance(move_of(replace(here, mount=None), end), CertifiedMove)


@pytest.mark.parametrize("xi", [0.0, 0.8])
def test_what_is_kept_in_the_image_for_joints_off_the_line_holds_in_its_corners(standing, arm, xi):
    """By all combinations of joints as far off as they may be; a perspective camera is steep there."""
    camera = UnifiedCamera(
        fx=160.0 + 240.0 * xi, fy=160.0 + 240.0 * xi, cx=319.5, cy=239.5, width=640, height=480, xi=xi
    )
    pixels = np.array([[45.0, 45.0], [594.0, 45.0], [45.0, 434.0], [594.0, 434.0]])
    points = 0.5 * camera.unproject(pixels)[0]
    here = standing()
    here = replace(here, asked=replace(here.asked, camera=camera), mount=None)
    move = move_of(here, START + np.radians([1.0, 0.5, -0.5, 1.0, 0.5, 1.0]), points)
    assert isinstance(move, CertifiedMove), move
    kept = move.plan.problem.visibility_margin - here.asked.visibility_margin
    most = 0.0
    for w in np.linspace(0.0, 1.0, 5):
        planned = camera.project(move.plan.path(w).inv().apply(points))[0]
        for signs in product((-1.0, 1.0), repeat=arm.dof):
            pose = here.camera_at(move.joints(w) + FOLLOWED * np.array(signs))
            off = camera.project(pose.inv().apply(points))[0] - planned
            most = max(most, float(np.linalg.norm(off, axis=1).max()))
    assert 0.2 * kept < most <= kept


@pytest.mark.parametrize(("beside", "certified"), [(2e-4, False), (8e-3, True)])
def test_a_ball_that_joints_off_the_line_bring_before_a_point_is_kept_off_its_line_of_sight(
    standing, arm, beside, certified
):
    """The camera turns about its line of sight to the point, that a ball stands beside."""
    here, point = standing(), np.array([[0.0, 0.0, 0.45]])
    place = here.setting.base_T_initial.apply([0.02 + beside, 0.0, 0.25])
    ball = Solid.sphere("ball", place, 0.02)
    setting = replace(here.setting, surroundings=(ball,))
    here = replace(here, asked=replace(here.asked, occlusion=True), setting=setting, mount=None)
    end = START + np.radians([0.0, 0.0, 0.0, 0.0, 0.0, 5.0])
    seen, base_point = MountedCamera(FLANGE_T_CAMERA), setting.base_T_initial.apply(point)
    hidden = [
        own_sight_in(arm, START + FOLLOWED * np.array(signs), seen, base_point, surroundings=(ball,)).what
        for signs in product((-1.0, 1.0), repeat=arm.dof)
    ]
    assert any(hidden) != certified
    found = move_of(here, end, point)
    assert isinstance(found, CertifiedMove) == certified, found
    assert certified or "a point is hidden: ball" in found


def test_a_move_keeps_the_reserve_to_joint_limits_that_is_asked_for(standing, arm):
    here, room = standing(), arm.limit_margins(START)
    nearest = int(np.argmin(room))
    asked = replace(here.setting, limit_reserve=float(room[nearest]) - 0.01)
    way = np.sign(START[nearest] - arm.joint_range[nearest].mean()) * np.eye(arm.dof)[nearest]
    assert isinstance(move_of(here, START + 0.03 * way), CertifiedMove)
    found = move_of(replace(here, setting=asked), START + 0.03 * way)
    assert isinstance(found, str)
    assert "end of its range" in found
    assert isinstance(move_of(replace(here, setting=asked), START - 0.03 * way), CertifiedMove)
