"""Links between camera and target: named where they are, none where there are none."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from tests.robots.joint_paths import straight_joint_path

from omniservo.robots import load_arm, own_sight

MOUNT = RigidTransform.from_translation([0.0, 0.0, 0.09])
START = np.array([0.0, 0.4, -0.8, 0.1, 0.7, 0.2])


@pytest.fixture(scope="module")
def arm():
    return load_arm("rx60")


@pytest.fixture(scope="module")
def hit(arm):
    """What a ray from the camera's centre to a point meets on its way: MuJoCo's ray casting."""
    model = arm.spec().compile()
    data = mujoco.MjData(model)

    def first(q, point):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        centre = (arm.base_T_flange(q) * MOUNT).translation
        way, met = point - centre, np.zeros(1, dtype=np.int32)
        groups = np.ones(6, dtype=np.uint8)
        part = mujoco.mj_ray(model, data, centre, way, groups, 1, -1, met)
        if met[0] < 0 or part > 1.0 or model.geom_contype[met[0]] == 0:
            return ""
        return model.body(model.geom_bodyid[met[0]]).name

    return first


def test_points_before_the_camera_are_free_on_the_whole_path(arm):
    path = straight_joint_path(START, START + np.array([0.3, 0.2, -0.1, 0.4, 0.1, 0.2]))
    ahead = arm.base_T_flange(START) * MOUNT
    points = ahead.apply(np.array([[0.0, 0.0, 0.5], [0.1, 0.0, 0.4], [0.0, -0.1, 0.4]]))
    assert own_sight(arm, path, MOUNT, points).status == "free"
    assert own_sight(arm, path, MOUNT, points, kept={"wrist": 0.2}).link == "wrist"
    assert (
        own_sight(arm, path, MOUNT, points, kept={"flange": 0.2}).status == "free"
    )  # it goes with the camera


def test_what_is_called_free_or_hidden_is_what_rays_meet(arm, hit):
    random, seen = np.random.default_rng(2), {"free": 0, "hidden": 0}
    for _ in range(25):
        begin = random.uniform(-1.5, 1.5, 6)
        path = straight_joint_path(begin, begin + random.uniform(-0.2, 0.2, 6))
        point = random.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 0.8])
        found = own_sight(arm, path, MOUNT, [point])
        seen[found.status] += 1
        if found.status == "free":
            assert all(hit(q, point) in ("", "base") for q in path(np.linspace(0.0, 1.0, 40)))
        elif found.gap < -1e-3:
            assert hit(path(found.w), point)
            assert f"{found.link} stands" in found.reason
            assert f"w = {found.w:.4f}" in found.reason
    assert min(seen.values()) >= 5


def test_links_that_pass_through_a_line_of_sight_between_places_are_found(arm, hit):
    """Long ways, on which a point is hidden for a short while only."""
    random, w, short = np.random.default_rng(5), np.linspace(0.0, 1.0, 301), 0
    for _ in range(60):
        begin = random.uniform(-1.5, 1.5, 6)
        path = straight_joint_path(begin, begin + random.uniform(-1.0, 1.0, 6), knots=2)
        point = random.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 0.8])
        hidden = np.mean([hit(q, point) not in ("", "base") for q in path(w)])
        if hidden > 0.0:
            assert own_sight(arm, path, MOUNT, [point]).status == "hidden"
            short += hidden < 0.2
    assert short >= 3


def test_links_keep_what_they_may_stray_from_every_line_but_what_carries_the_camera(arm):
    """By MuJoCo's distances of the links from a speck that goes along the line."""
    spec = arm.spec()
    holder = spec.worldbody.add_body(name="speck", mocap=True)
    holder.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[1e-6] * 3)
    model = spec.compile()
    data, speck = mujoco.MjData(model), int(model.body("speck").geomadr[0])
    welded, names = model.body_weldid[model.geom_bodyid], [model.body(b).name for b in model.geom_bodyid]
    last = welded[:speck].max()
    moving = [g for g in range(speck) if model.geom_contype[g] and welded[g] not in (0, last)]

    def distances(q, point):
        """Of every link (k,) from the line [m]."""
        centre, found = (arm.base_T_flange(q) * MOUNT).translation, []
        data.qpos[:] = q
        for share in np.linspace(0.0, 1.0, 80):
            data.mocap_pos[0] = centre + share * (point - centre)
            mujoco.mj_kinematics(model, data)
            found.append([mujoco.mj_geomDistance(model, data, g, speck, 1.0, None) for g in moving])
        return np.min(found, axis=0)

    random, kept, seen = np.random.default_rng(3), 0.03, {"free": 0, "hidden": 0}
    margins = dict.fromkeys(names, kept)
    for _ in range(40):
        begin = random.uniform(-1.5, 1.5, 6)
        path = straight_joint_path(begin, begin + random.uniform(-0.2, 0.2, 6))
        point = random.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 0.8])
        found = own_sight(arm, path, MOUNT, [point], kept=margins)
        if found.status == "free":
            seen["free"] += 1
            assert min(distances(q, point).min() for q in path(np.linspace(0.0, 1.0, 9))) >= kept - 1e-6
        elif found.gap > 1e-3:
            seen["hidden"] += 1
            own = [k for k, g in enumerate(moving) if names[g] == found.link]
            assert distances(path(found.w), point)[own].min() <= found.gap + 1e-3
            assert found.gap <= found.kept == kept
            assert "30.00 mm are kept from it for what a run strays" in found.reason
    assert min(seen.values()) >= 4
