"""What stands between camera and target: named where something does, nothing where nothing does."""

import math

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from tests.robots.joint_paths import straight_joint_path

from omniservo.errors import InputError
from omniservo.robots import (
    CAMERA_HOUSING,
    ArmBodies,
    MountedCamera,
    Solid,
    arm_clearance,
    load_arm,
    own_sight,
)
from omniservo.robots.collision.own_sight import _Lines, own_sight_in
from omniservo.robots.collision.sight_kernel import SURFACE

MOUNT = RigidTransform.from_translation([0.0, 0.0, 0.09])
CAMERA = MountedCamera(MOUNT)
AHEAD = np.radians([0.0, 20.0, 110.0, 0.0, 50.0, 0.0])
START = np.array([0.0, 0.4, -0.8, 0.1, 0.7, 0.2])


@pytest.fixture(scope="module")
def arm():
    return load_arm("rx60")


def rays(arm, around=()):
    """What a ray from the camera's centre to a point meets before its last millimetre, cast by MuJoCo."""
    spec = arm.spec()
    for solid in around:
        solid.add_to(spec, spec.worldbody.add_body(name=solid.name))
    model = spec.compile()
    data = mujoco.MjData(model)

    def first(q, point):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        centre = arm.base_T_flange(q).apply(MOUNT.translation)
        way, met = point - centre, np.zeros(1, dtype=np.int32)
        length = np.linalg.norm(way)
        groups = np.ones(6, dtype=np.uint8)
        part = mujoco.mj_ray(model, data, centre, way, groups, 1, -1, met)
        if met[0] < 0 or part * length > length - SURFACE or model.geom_contype[met[0]] == 0:
            return ""
        return model.body(model.geom_bodyid[met[0]]).name

    return first


@pytest.fixture(scope="module")
def hit(arm):
    return rays(arm)


def test_points_before_the_camera_are_free_on_the_whole_path(arm):
    path = straight_joint_path(START, START + np.array([0.3, 0.2, -0.1, 0.4, 0.1, 0.2]))
    ahead = arm.base_T_flange(START) * MOUNT
    points = ahead.apply(np.array([[0.0, 0.0, 0.5], [0.1, 0.0, 0.4], [0.0, -0.1, 0.4]]))
    assert own_sight(arm, path, CAMERA, points).status == "free"
    for link in ("wrist", "base"):
        assert own_sight(arm, path, CAMERA, points, kept={link: 2.0}).link == link
    assert (
        own_sight(arm, path, CAMERA, points, kept={"flange": 0.2}).status == "free"
    )  # it goes with the camera


def test_what_is_called_free_or_hidden_is_what_rays_meet(arm, hit):
    random, seen = np.random.default_rng(2), {"free": 0, "hidden": 0}
    for _ in range(25):
        begin = random.uniform(-1.5, 1.5, 6)
        path = straight_joint_path(begin, begin + random.uniform(-0.2, 0.2, 6))
        point = random.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 0.8])
        found = own_sight(arm, path, CAMERA, [point])
        seen[found.status] += 1
        if found.status == "free":
            assert all(hit(q, point) == "" for q in path(np.linspace(0.0, 1.0, 40)))
        elif found.gap < -1e-3:
            assert hit(path(found.w), point)
            assert f"{found.link} stands" in found.reason
            assert f"w = {found.w:.4f}" in found.reason
    assert min(seen.values()) >= 5


def test_links_that_pass_through_a_line_of_sight_between_places_are_found(arm, hit):
    """Long ways, on which a point is hidden for a short while only."""
    random, w, short = np.random.default_rng(5), np.linspace(0.0, 1.0, 101), 0
    for _ in range(60):
        begin = random.uniform(-1.5, 1.5, 6)
        path = straight_joint_path(begin, begin + random.uniform(-1.0, 1.0, 6), knots=2)
        point = random.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 0.8])
        hidden = np.mean([hit(q, point) != "" for q in path(w)])
        if hidden > 0.0:
            assert own_sight(arm, path, CAMERA, [point]).status == "hidden"
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
    moving = [g for g in range(speck) if model.geom_contype[g] and welded[g] != last]

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
        found = own_sight(arm, path, CAMERA, [point], kept=margins)
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


KINDS = ("sphere", "capsule", "cylinder", "box", "ellipsoid", "hull")


def somewhere(random, kind, name):
    """A body of some kind beside the arm."""
    place = np.array([random.uniform(0.15, 0.6), 0.0, random.uniform(0.0, 0.8)])
    turned = Rotation.from_euler("z", random.uniform(-np.pi, np.pi))
    pose = RigidTransform.from_components(turned.apply(place), Rotation.random(rng=random))
    if kind == "hull":
        return Solid(name, kind, np.zeros(0), pose, random.uniform(-0.12, 0.12, (8, 3)))
    size = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3}[kind]
    return Solid(name, kind, random.uniform(0.01, 0.12, size), pose)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rx60", "panda"])
def test_what_stands_around_hides_what_rays_meet_there(name):
    arm, random = load_arm(name), np.random.default_rng(8)
    low, high = arm.joint_range.T
    seen = {"free": 0, **dict.fromkeys(KINDS, 0)}
    w = np.linspace(0.0, 1.0, 60)
    for trial in range(60):
        around = tuple(somewhere(random, kind, kind) for kind in KINDS)
        hit = rays(arm, around)
        begin = np.clip(random.uniform(-1.5, 1.5, arm.dof), low, high)
        path = straight_joint_path(begin, begin + random.uniform(-0.4, 0.4, arm.dof))
        point = random.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 0.8])
        if trial % 3 == 0:  # it lies on what stands around
            point = around[0].pose.translation + np.array([0.0, 0.0, around[0].size[0]])
        found = own_sight(arm, path, CAMERA, [point], surroundings=around)
        met = {hit(q, point) for q in path(w)} - {""}
        if found.status == "free":
            seen["free"] += 1
            assert not met
        else:
            seen[found.link] = seen.get(found.link, 0) + 1
            assert found.gap > -1e-3 or hit(path(found.w), point)
        assert found.status == "hidden" or not met
    assert seen["free"] >= 5
    assert sum(seen[kind] for kind in KINDS) >= 5


TABLE = Solid.box("table", RigidTransform.from_translation([0.0, 0.0, -0.05]), [20.0, 20.0, 0.05])


def test_points_on_a_table_and_before_a_wall_are_not_hidden_by_them(arm):
    """Their lines of sight end on the surface, one of them at five degrees to it."""
    path = straight_joint_path(AHEAD, AHEAD + np.array([0.1, 0.1, -0.1, 0.1, 0.1, 0.2]))
    x, y, z = (arm.base_T_flange(AHEAD) * MOUNT).translation
    wall = Solid.box("wall", RigidTransform.from_translation([x + 0.4, 0, 0.5]), [0.1, 2.0, 0.5])
    low = [x + 0.1, y + z / math.tan(math.radians(5.0)), 0.0]
    points = np.array([[x + 0.1, 0.1, 0.0], [x + 0.3, 0.05, 0.3], low])
    around = TABLE, wall
    for strays in (0.0, 0.02):
        found = own_sight(arm, path, CAMERA, points, surroundings=around, camera_strays=strays)
        assert found.status == "free"
    assert own_sight(arm, path, CAMERA, points[:1] - [0, 0, 0.002], surroundings=around).link == "table"
    assert own_sight(arm, path, CAMERA, points[1:2] - [-0.003, 0, 0], surroundings=around).link == "wall"


@pytest.mark.parametrize(("before", "status"), [(0.9e-3, "free"), (1.1e-3, "hidden"), (-1e-3, "free")])
def test_the_last_millimetre_before_a_point_is_the_surface_that_it_lies_on(arm, before, status):
    camera = arm.base_T_flange(START) * MOUNT
    around = camera * RigidTransform.from_translation([0.0, 0.0, 0.5 - before + 0.01])
    plate = Solid.box("plate", around, [0.1, 0.1, 0.01])
    point = camera.apply([0.0, 0.0, 0.5])
    assert own_sight_in(arm, START, CAMERA, [point], surroundings=(plate,)).status == status
    near = straight_joint_path(START, START + 1e-5)
    assert own_sight(arm, near, CAMERA, [point], surroundings=(plate,)).status == status


def test_a_camera_that_strays_is_kept_free_by_what_its_lines_then_sweep(arm):
    """At the share s of a line (1 − s) of it: a cone to the point, by balls along the line."""
    random, strays, seen = np.random.default_rng(11), 0.04, {"free": 0, "hidden": 0}
    shares = np.linspace(0.0, 1.0, 200)
    camera = arm.base_T_flange(START) * MOUNT
    for _ in range(80):
        point = camera.apply(random.uniform([-0.1, -0.1, 0.3], [0.1, 0.1, 0.5]))
        post = somewhere(random, "capsule", "post")
        place = camera.apply(random.uniform([-0.1, -0.1, 0.05], [0.1, 0.1, 0.4]))
        post = Solid("post", "capsule", 0.3 * post.size, RigidTransform.from_translation(place))
        found = own_sight_in(arm, START, CAMERA, [point], surroundings=(post,), camera_strays=strays)
        ends = place[:, None] + np.array([[0, 0], [0, 0], [-1, 1]]) * post.size[1]
        begin, along = ends[:, 0], ends[:, 1] - ends[:, 0]
        line = camera.translation + shares[:, None] * (point - camera.translation)
        nearest = np.clip((line - begin) @ along / (along @ along), 0, 1)[:, None] * along + begin
        left = np.linalg.norm(line - nearest, axis=1) - post.size[0] - (1.0 - shares) * strays
        if abs(left.min()) < 1e-3:
            continue
        seen[found.status] += 1
        assert (found.status == "free") == (left.min() > 0.0)
        if found.status == "hidden":
            assert (found.link, found.kept) == ("post", strays)
    assert min(seen.values()) >= 8


@pytest.mark.parametrize("left", [-1e-6, 1e-6])
def test_a_half_space_is_kept_off_a_line_by_what_the_camera_strays_at_either_end(arm, left):
    """The lowest place of the cone that a straying camera sweeps is at its centre or where the line ends."""
    random, strays, lowest = np.random.default_rng(3), 0.04, []
    centre = (arm.base_T_flange(START) * MOUNT).translation
    for _ in range(20):
        point = centre + random.uniform(0.2, 0.8) * Rotation.random(rng=random).apply([0.0, 0.0, 1.0])
        share = 1.0 - SURFACE / np.linalg.norm(point - centre)
        normal = Rotation.random(rng=random).apply([0.0, 0.0, 1.0])
        end = centre + share * (point - centre)
        ends = normal @ centre - strays, normal @ end - (1.0 - share) * strays
        side = Solid.half_space("side", normal, min(ends) - left)
        lines = _Lines(arm, CAMERA, point[None], (side,), {}, strays)
        lines._sights = lines._sights._replace(hiders=np.array([lines._shapes.kinds.size - 2]))
        assert lines.are_clear(START, np.zeros(6)) == (left > 0.0)
        lowest.append(int(np.argmin(ends)))
    assert 5 <= sum(lowest) <= 15


@pytest.mark.parametrize("kind", ["sphere", "capsule", "cylinder", "box", "ellipsoid"])
def test_a_body_whose_middle_is_that_of_a_line_of_sight_hides_the_point(arm, kind):
    """No direction leads from one middle to the other."""
    point = (arm.base_T_flange(START) * MOUNT).apply([0.0, 0.0, 0.5])
    line = _Lines(arm, CAMERA, point[None], (), {}, 0.0)
    assert line.are_clear(START, np.zeros(6))
    middle = RigidTransform.from_translation(line._scene.places[line._sights.line])
    size = np.full(somewhere(np.random.default_rng(0), kind, "body").size.shape, 0.02)
    body = Solid("body", kind, size, middle)
    found = own_sight_in(arm, START, CAMERA, [point], surroundings=(body,))
    assert (found.status, found.link) == ("hidden", "body")
    assert found.gap == pytest.approx(-0.02, abs=0.015)


def test_a_post_that_passes_a_line_of_sight_for_a_moment_is_found(arm):
    """The camera goes by a thin post: at no more than a tenth of the path it hides the point."""
    path = straight_joint_path(AHEAD, AHEAD + np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]), knots=2)
    point = np.array([1.2, 0.5, 0.4])
    camera = (arm.base_T_flange(path(0.437)) * MOUNT).translation
    middle = 0.5 * (camera + point)
    post = Solid("post", "cylinder", [0.004, 0.05], RigidTransform.from_translation(middle))
    hit = rays(arm, (post,))
    hidden = [hit(q, point) == "post" for q in path(np.linspace(0.0, 1.0, 301))]
    assert 0.0 < np.mean(hidden) < 0.1
    found = own_sight(arm, path, CAMERA, [point], surroundings=(post,))
    assert (found.status, found.link) == ("hidden", "post")
    assert found.w == pytest.approx(0.437, abs=0.05)
    assert own_sight(arm, path, CAMERA, [point], surroundings=(post,), span=(0.5, 1.0)).status == "free"
    assert own_sight(arm, path, CAMERA, [point]).status == "free"


def test_a_speck_that_no_part_of_a_path_tells_from_a_line_is_not_called_free(arm):
    """It is on the line at one place, which halving never comes upon."""
    path = straight_joint_path(AHEAD, AHEAD + np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]), knots=2)
    point = np.array([1.2, 0.5, 0.4])
    middle = 0.5 * ((arm.base_T_flange(path(0.437)) * MOUNT).translation + point)
    found = own_sight(arm, path, CAMERA, [point], surroundings=(Solid.sphere("speck", middle, 1e-6),))
    assert (found.status, found.link) == ("hidden", "speck")
    assert found.w == pytest.approx(0.437, abs=1e-3)
    assert 0.0 < found.gap < 1e-3


@pytest.mark.parametrize("hidden", range(3))
def test_whichever_point_is_hidden_by_whichever_body_however_little_is_found(arm, hidden):
    """One box is 0.2 mm into a line, another leaves 0.2 mm of it."""
    camera = arm.base_T_flange(START) * MOUNT
    points = np.array([[-0.1, 0.0, 0.5], [0.0, 0.0, 0.5], [0.1, 0.0, 0.5]])

    into, beside = (
        Solid.box(
            name,
            camera * RigidTransform.from_translation(0.5 * points[hidden] + [0.0, 0.01 + left, 0.0]),
            [0.01] * 3,
        )
        for name, left in (("in", -2e-4), ("beside", 2e-4))
    )
    for around in ((into, beside), (beside, into)):
        found = own_sight_in(arm, START, CAMERA, camera.apply(points), surroundings=around)
        assert (found.status, found.link, found.point) == ("hidden", "in", hidden)
    assert own_sight_in(arm, START, CAMERA, camera.apply(points), surroundings=(beside,)).status == "free"


def test_the_flange_hides_what_is_inside_it(arm):
    inside = (arm.base_T_flange(START) * MOUNT).apply([0.0, 0.0, -0.09 - 0.012])
    assert own_sight_in(arm, START, CAMERA, [inside]).link == "flange"


@pytest.mark.parametrize(
    ("away", "gap", "status"), [(1.0, 1e-7, "free"), (5e5, 1e-7, "hidden"), (5e5, 1e-5, "free")]
)
def test_what_is_allowed_for_rounding_grows_with_coordinates(arm, away, gap, status):
    ahead = arm.base_T_flange(AHEAD) * MOUNT
    point = ahead.apply([0.0, 0.0, 1.8 * away])
    ball = Solid(
        "ball", "sphere", [0.2], RigidTransform.from_translation(ahead.apply([0.2 + gap, 0.0, away]))
    )
    assert own_sight_in(arm, AHEAD, CAMERA, point[None], surroundings=(ball,)).status == status


PLACES = {"at its end": -1.0, "near its end": 0.99, "in its middle": 0.5, "near the camera": 0.02}
"""shares of a line of sight; −1: where what counts of it ends"""


@pytest.mark.parametrize("share", PLACES.values(), ids=PLACES.keys())
def test_what_a_line_meets_anywhere_within_the_turns_is_never_called_clear(arm, share):
    """A speck stands on the line of a posture that is as far from the one looked at as the turns allow."""
    random = np.random.default_rng(5)
    for _ in range(12):
        q = START + random.uniform(-0.3, 0.3, 6)
        turns = random.choice([1e-3, 0.02, 0.1]) * random.uniform(0.2, 1.0, 6)
        point = (arm.base_T_flange(q) * MOUNT).apply(random.uniform([-0.2, -0.2, 0.2], [0.2, 0.2, 0.9]))
        centre = (arm.base_T_flange(q + turns * random.choice([-1.0, 1.0], 6)) * MOUNT).translation
        whole = 1.0 - SURFACE / np.linalg.norm(point - centre)
        place = centre + (whole * (1.0 - 1e-9) if share < 0.0 else share) * (point - centre)
        speck = Solid("speck", "sphere", np.array([1e-7]), RigidTransform.from_translation(place))
        lines = _Lines(arm, CAMERA, point[None], (speck,), {}, 0.0)
        lines._sights = lines._sights._replace(hiders=np.array([lines._shapes.kinds.size - 2]))
        assert not lines.are_clear(q, turns)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_what_a_link_carries_where_a_line_ends_that_has_become_longer_is_never_called_clear(tmp_path, sign):
    """As seen from the shoulder, joint 1 takes the point along its line of sight, away from the camera."""
    arm, q, turns = load_arm("rx60"), START + 0.3, 0.05 * np.eye(6)[0]
    centre = (arm.base_T_flange(q) * MOUNT).translation
    ahead = sign * math.acos(0.8)  # the line is a tangent of the circle on which the point goes round
    point = Rotation.from_rotvec([0.0, 0.0, ahead]).apply(centre * [0.8, 0.8, 1.0])
    there = q - sign * turns
    seen_from = (arm.base_T_flange(there) * MOUNT).translation
    assert np.linalg.norm(point - seen_from) > np.linalg.norm(point - centre) + 0.01
    away = seen_from - point
    place = point + (SURFACE + 1e-9) * away / np.linalg.norm(away)
    place = Rotation.from_rotvec([0.0, 0.0, -there[0]]).apply(place) - [0.0, 0.0, 0.341]
    text, link = arm.path.read_text(), '<body name="shoulder" pos="0 0 0.341" gravcomp="1">'
    assert link in text
    speck = f'<geom type="sphere" size="1e-7" pos="{" ".join(map(repr, place.tolist()))}"/>'
    file = tmp_path / "arm.xml"
    file.write_text(text.replace(link, link + speck))
    lines = _Lines(load_arm(file), CAMERA, point[None], (), {}, 0.0)
    small = np.flatnonzero((lines._shapes.kinds == 2) & (lines._shapes.sizes[:, 0] < 1e-6))
    lines._sights = lines._sights._replace(hiders=small)
    assert len(small) == 1
    assert not lines.are_clear(q, turns)
    assert not lines.are_clear(there, np.zeros(6))
    assert lines.are_clear(q, np.zeros(6))


def before(point, half, aside=0.0):
    """A box of half extents half way to a point in the camera frame, moved aside along x."""
    place = 0.5 * np.asarray(point) + [aside, 0.0, 0.0]
    return Solid.box("bracket", RigidTransform.from_translation(place), half)


@pytest.mark.parametrize("kept", [None, {"flange": 0.2}])
def test_what_is_mounted_hides_what_is_behind_it_in_the_cameras_frame_whatever_the_posture(arm, kept):
    """It goes with the camera: neither links that stray nor a camera that does bring it nearer to a line."""
    seen = np.array([[0.0, 0.0, 0.5], [0.15, 0.0, 0.5]])
    for aside, link in ((0.01 - 2e-4, "bracket"), (0.01 + 2e-4, "")):
        camera = MountedCamera(MOUNT, (*CAMERA_HOUSING, before(seen[0], [0.01, 0.02, 0.01], -aside)))
        for q in (AHEAD, START, START + 0.1):
            points = (arm.base_T_flange(q) * MOUNT).apply(seen)
            found = own_sight_in(arm, q, camera, points, kept=kept, camera_strays=0.03)
            assert (found.link, found.status) == (link, "hidden" if link else "free")
            if link:
                assert (found.point, found.kept) == (0, 0.0)
                assert found.gap == pytest.approx(-2e-4, abs=2e-5)


def test_what_passes_behind_a_mounted_body_for_a_moment_is_found(arm):
    """The camera turns past a point: a thin rod that it carries hides it at less than a tenth of the path."""
    path = straight_joint_path(AHEAD, AHEAD + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.6]), knots=2)
    point = (arm.base_T_flange(path(0.437)) * MOUNT).apply([0.1, 0.0, 0.5])
    rod = Solid("rod", "capsule", [0.002, 0.02], RigidTransform.from_translation([0.05, 0.0, 0.25]))
    camera = MountedCamera(MOUNT, (rod,))
    found = own_sight(arm, path, camera, [point])
    assert (found.status, found.link) == ("hidden", "rod")
    assert found.w == pytest.approx(0.437, abs=0.06)
    assert own_sight(arm, path, camera, [point], span=(0.6, 1.0)).status == "free"
    assert own_sight(arm, path, CAMERA, [point]).status == "free"


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_what_is_mounted_hides_what_rays_meet_there(arm, kind):
    random, seen = np.random.default_rng(13), {"free": 0, "hidden": 0}
    for _ in range(40):
        size = random.uniform(
            0.01, 0.04, {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3, "hull": 0}[kind]
        )
        corners = random.uniform(-0.04, 0.04, (8, 3)) if kind == "hull" else None
        pose = RigidTransform.from_components(
            random.uniform([-0.06, -0.06, 0.08], [0.06, 0.06, 0.3]), Rotation.random(rng=random)
        )
        solid = Solid("body", kind, size, pose, corners)
        q, point = START + random.uniform(-0.3, 0.3, 6), random.uniform([-0.1, -0.1, 0.4], [0.1, 0.1, 0.6])
        camera = arm.base_T_flange(q) * MOUNT
        found = own_sight_in(arm, q, MountedCamera(MOUNT, (solid,)), camera.apply(point)[None])
        hit = rays(arm, (solid.moved(camera),))(q, camera.apply(point))
        seen[found.status] += 1
        assert (found.link, found.status == "hidden") == (hit, hit == "body")
    assert min(seen.values()) >= 5


@pytest.mark.parametrize("kind", KINDS)
def test_a_mounted_body_that_holds_the_cameras_centre_is_looked_out_of(arm, kind):
    """It reaches 5 mm before the centre; 1 mm farther on, with the centre outside, it hides the point."""
    size = {
        "sphere": [0.02],
        "capsule": [0.01, 0.01],
        "cylinder": [0.02, 0.02],
        "box": [0.02] * 3,
        "ellipsoid": [0.01, 0.015, 0.02],
        "hull": [],
    }
    corners = 0.02 * np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T if kind == "hull" else None
    point = (arm.base_T_flange(START) * MOUNT).apply([0.0, 0.0, 0.5])[None]
    for ahead, status in ((-0.015, "free"), (0.019, "free"), (0.021, "hidden")):
        place = RigidTransform.from_translation([0.0, 0.0, ahead])
        body = Solid("body", kind, size[kind], place, corners)
        assert own_sight_in(arm, START, MountedCamera(MOUNT, (body,)), point).status == status


@pytest.mark.parametrize("joints", [5, 7])
def test_a_path_of_another_number_of_joints_is_refused(arm, joints):
    path = straight_joint_path(np.zeros(joints), np.full(joints, 0.1))
    with pytest.raises(InputError, match=f"path: of {joints} joints; .* has 6"):
        own_sight(arm, path, CAMERA, [[0.5, 0.0, 0.5]])
    with pytest.raises(InputError, match=f"path: of {joints} joints; .* has 6"):
        arm_clearance(ArmBodies(arm), path, clearance=0.0)
