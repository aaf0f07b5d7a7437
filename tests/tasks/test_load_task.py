import base64
import json
import re
import struct
import zlib
from importlib import resources

import numpy as np
import pytest
import trimesh
import yaml
from scipy.spatial import ConvexHull
from scipy.spatial.transform import RigidTransform, Rotation
from tests.planning.quad_cubes import quad_cubes
from tests.robots.urdf_arms import urdf

from omniservo.camera_files import save_camera
from omniservo.cameras import UnifiedCamera, preset
from omniservo.errors import InputError
from omniservo.planning import Sphere
from omniservo.robots import load_arm
from omniservo.scenes.scene_of_task import scene_of_task
from omniservo.tasks import TaughtGoal, load_task, shipped_tasks
from omniservo.tasks.save_task import save_task

SHIPPED = (
    "catadioptric-ring",
    "moving-panel",
    "panda-table",
    "paper-example-1",
    "paper-example-2",
    "perspective-wall",
    "tag-board",
    "textured-object",
    "ur5e-table",
    "whole-arm-1",
    "whole-arm-2",
)

MINIMAL = {
    "format": "omniservo.task/1",
    "name": "small",
    "summary": "a task",
    "units": {"length": "mm", "angle": "deg"},
    "camera": "fe185",
    "arm": {"foot": [0, 0, -341], "flange_T_camera": {"translation": [0, 0, 90.5]}},
    "start": {"world_T_camera": {"translation": [240, -50, 500]}, "joints_near": [0, 43, -64, 0, 111, 90]},
    "target": {"dot_radius": 10, "dots": [{"center": [0, 0, 400]}]},
    "teach": {"initial_T_goal": {"translation": [0, -100, 200], "rotation_vector": [0, 90, 0]}},
    "scale": {"displacement": 223.6},
}


def written(tmp_path, document):
    path = tmp_path / "task.yaml"
    path.write_text(yaml.safe_dump(document))
    return path


def changed(field, value):
    """MINIMAL with one field (dotted path) replaced."""
    document = yaml.safe_load(yaml.safe_dump(MINIMAL))
    *parents, last = field.split(".")
    section = document
    for parent in parents:
        section = section.setdefault(parent, {})
    section[last] = value
    return document


def test_the_shipped_tasks_are_valid():
    assert shipped_tasks() == SHIPPED
    for name in SHIPPED:
        task = load_task(name)
        assert task.name == name
        corners = 4 * len(task.target.tags.panels) if task.target.tags else 0
        assert len(task.target.dots) >= 9 or corners >= 20 or len(task.target.textures) >= 5


def test_lengths_are_metres_and_angles_radians_whatever_the_file_states(tmp_path):
    task = load_task(written(tmp_path, MINIMAL))
    np.testing.assert_allclose(task.teach.initial_T_goal.translation, [0, -0.1, 0.2])
    np.testing.assert_allclose(task.teach.initial_T_goal.rotation_vector, [0, np.pi / 2, 0])
    assert task.scale.displacement == pytest.approx(0.2236)
    assert task.planning.least_distance == 0.02


def test_the_papers_numbers_stand_in_its_tasks():
    one, two = load_task("paper-example-1"), load_task("paper-example-2")
    np.testing.assert_allclose(
        np.array(one.teach.initial_T_goal.translation) * 1e3, [0.0497, -99.9782, 199.9552], atol=1e-12
    )
    np.testing.assert_allclose(
        np.rad2deg(two.teach.initial_T_goal.rotation_vector), [-0.0111, -24.9738, 0.0056], atol=1e-12
    )
    assert (one.planning.clearance, two.planning.clearance) == pytest.approx((0.055, 0.070))
    points = np.array([o.center for o in one.planning.obstacles]) * 1e3
    np.testing.assert_allclose(points, [[-10, -65, 85], [-5, -80, 90]], atol=1e-12)
    assert one.camera == two.camera == preset("fe185")


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("format", "omniservo.task/2", "format: 'omniservo.task/2' given; legal: 'omniservo.task/1'"),
        ("units", {"length": "inch"}, "units.length: 'inch' given; legal: m, cm, mm"),
        ("colour", "red", "colour: no such field"),
        ("planning", None, "planning: "),
        ("planning.clearence", 5, "planning.clearence: no such field"),
        ("planning.clearance", -5, "planning.clearance"),
        ("planning.clearance", float("nan"), "planning.clearance"),
        ("target.dot_radius", 0, "target.dot_radius"),
        ("target.dots", [], "target.dots"),
        ("start.world_T_camera.quaternion", [0, 0, 0, 2], "norm 2"),
        ("scale", {}, "exactly one"),
        ("scale.sigma", -0.01, "scale.sigma: "),
        ("planning.risk", 0.0, "planning.risk: "),
        ("planning.risk", 1.0, "less than or equal to 0.5; 1.0 given"),
        ("scale", {"displacement": 5, "odometry": True}, "exactly one"),
        ("scale", {"known_length": {"dots": [1, 1], "length": 5}}, "must differ"),
        (
            "camera",
            "../secret.yaml",
            "'../secret.yaml' given; legal: a relative path inside the file's folder",
        ),
        ("camera", "missing.yaml", "neither a file nor a preset"),
        ("camera", 5, "camera: 5 given"),
        ("sensor.rate", 0, "sensor.rate"),
        (
            "sensor.exposure",
            -0.01,
            "sensor.exposure: Input should be greater than or equal to 0; -0.01 given",
        ),
        ("sensor.exposure", float("nan"), "sensor.exposure: Input should be a finite number; nan given"),
        ("sensor.exposure", 0.04, "exposure: 0.04 s given; legal: 0 to a frame's period, 0.03333 s"),
        ("sensor.readout", 0.04, "readout: 0.04 s given; legal: 0 to a frame's period, 0.03333 s"),
        ("sensor", {"exposure": 0.03, "readout": 0.03}, "latency: 0.02 s given; legal: half of exposure and"),
        ("sensor.gain", -1, "sensor.gain: Input should be greater than or equal to 0; -1 given"),
        ("sensor.vignetting", 1, "sensor.vignetting: Input should be less than 1; 1 given"),
        ("sensor.defocus", float("inf"), "sensor.defocus: Input should be a finite number; inf given"),
        ("sensor.jpeg", 0, "sensor.jpeg: Input should be greater than or equal to 1; 0 given"),
        ("sensor.jpeg", 80.5, "sensor.jpeg: Input should be a valid integer"),
        ("simulation.true_camera", 5, "simulation.true_camera: 5 given; legal: a preset's name"),
        ("simulation.true_camera", "fe186", "simulation.true_camera: 'fe186' is neither a file nor a preset"),
        ("simulation.true_camera", {"model": "eucm"}, "simulation.true_camera: fx: missing"),
        ("simulation.true_camera", "perspective", "640 × 480 px given; legal: that of the camera, 659 × 432"),
        ("simulation.lens_error", {"sigma": -0.1}, "simulation.lens_error.sigma: Input should be greater"),
        ("simulation.lens_error", {"sigma": 0.1, "length": 0}, "simulation.lens_error.length: Input should"),
        (
            "simulation.light.brightness",
            float("nan"),
            "simulation.light.brightness: Input should be a finite",
        ),
        (
            "target.dots",
            [{"center": [0, 0, 400], "normal": [0, 0, 0]}],
            "target.dots.0.normal: its length must not be 0",
        ),
        ("simulation.light.direction", [0, 0, 0], "its length must not be 0"),
        ("simulation.light_changes", [{"time": 2}, {"time": 1}], "the times must not fall"),
        ("simulation.lights", [], "simulation.lights: no such field; legal: true_camera, lens_error, light,"),
        ("servo.time_law", "fastest", "servo.time_law"),
        ("servo.image_speed", 0, "servo.image_speed"),
        ("servo.image_speed", float("nan"), "servo.image_speed"),
        ("servo", {"time_law": "time-optimal", "duration": 3}, "duration goes with time_law: rest-to-rest"),
        ("servo", {"time_law": "exponential", "image_speed": 90}, "exponential is not stretched"),
        ("planning.degrees.rotation", 9, "planning.degrees.rotation"),
        ("planning.workspace", {"min": [0, 0, 0], "max": [1, 1, 0]}, "smaller"),
        ("name", "../x", "name"),
        ("planning.obstacles", [{"type": "cone"}], "planning.obstacles.0"),
        (
            "planning.obstacles",
            [{"type": "cylinder", "from": [0, 0, 1], "to": [0, 0, 1], "radius": 1}],
            "planning.obstacles.0.cylinder: to: 0 m from the other end given",
        ),
        (
            "planning.obstacles",
            [{"type": "mesh", "vertices": [[0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1]]}],
            "planning.obstacles.0.mesh: vertices: all within 1e-12 m of one plane; a solid is needed",
        ),
        ("planning.obstacles", [{"type": "box", "center": [0, 0, 0]}], "half_extents"),
        ("planning.obstacles", [{"type": "half_space", "normal": [0, 0, 2], "offset": 0}], "length 2"),
        ("planning.obstacles", [{"center": [0, 0, 0], "half_extents": [1, 1, 1]}], "no such field"),
        (
            "obstacles",
            [{"center": [0, 0, 0], "half_extents": [1, 1, 1], "quaternion": [0, 0, 0, 2]}],
            "obstacles.0: quaternion has norm 2; it must be 1",
        ),
        (
            "planning.obstacles",
            [
                {"type": "box", "center": [0, 0, 0], "half_extents": [1, 1, 1]}
                | {"quaternion": [0, 0, 0, 1], "rotation_vector": [0, 0, 0]}
            ],
            "give quaternion or rotation_vector, not both",
        ),
    ],
)
def test_a_wrong_field_is_named_with_file_and_value(tmp_path, field, value, says):
    path = written(tmp_path, changed(field, value))
    with pytest.raises(InputError) as refusal:
        load_task(path)
    assert str(path) in str(refusal.value)
    assert says in str(refusal.value)


def test_the_planner_knows_every_kind_of_obstacle_in_metres(tmp_path):
    obstacles = [
        {"center": [10, 0, 0]},
        {"type": "box", "center": [0, 0, 50], "half_extents": [10, 20, 30], "rotation_vector": [0, 0, 90]},
        {"type": "capsule", "from": [0, 0, 0], "to": [0, 0, 40], "radius": 5, "clearance": 7},
        {"type": "half_space", "normal": [0, 0, -1], "offset": -300},
        {"type": "cylinder", "from": [0, 0, 0], "to": [0, 0, 40], "radius": 5},
        {"type": "ellipsoid", "center": [0, 0, 50], "radii": [10, 20, 30], "rotation_vector": [0, 0, 90]},
    ]
    task = load_task(written(tmp_path, changed("planning.obstacles", obstacles)))
    sphere, box, capsule, wall, rod, egg = (o.obstacle for o in task.planning.obstacles)
    at = np.array([[0.1, 0.0, 0.05]])
    assert sphere.distance(at)[0] == pytest.approx(np.hypot(0.09, 0.05))
    assert box.distance(at)[0] == pytest.approx(0.08)
    assert capsule.distance(at)[0] == pytest.approx(np.hypot(0.1, 0.01) - 0.005)
    assert rod.distance(at)[0] == pytest.approx(np.hypot(0.095, 0.01))
    assert egg.distance(at)[0] == pytest.approx(0.08)
    assert wall.distance(at)[0] == pytest.approx(0.25)
    assert capsule.clearance == pytest.approx(0.007)


QUARTER = Rotation.from_euler("y", 90, degrees=True)
BLOCK = {"center": [0, 0, 50], "half_extents": [10, 20, 30]}


@pytest.mark.parametrize(
    "turned", [{"quaternion": QUARTER.as_quat().tolist()}, {"rotation_vector": [0, 90, 0]}]
)
@pytest.mark.parametrize("frame", ["initial", "base"])
def test_every_box_of_a_task_is_turned_by_a_quaternion_or_a_rotation_vector(tmp_path, turned, frame):
    stated = changed("planning.obstacles", [{"type": "box", **BLOCK, **turned, "frame": frame}])
    stated |= {"obstacles": [{**BLOCK, **turned, "frame": frame}], "surroundings": [{**BLOCK, **turned}]}
    (tmp_path / "task.yaml").write_text(json.dumps(stated))
    task = load_task(tmp_path / "task.yaml")
    box = task.planning.obstacles[0].obstacle
    pose = task.obstacles[0].transform
    planned = Rotation.from_quat(np.array(box.quaternion))
    np.testing.assert_allclose(planned.as_matrix(), pose.rotation.as_matrix(), atol=1e-15)
    np.testing.assert_allclose(box.center, pose.translation)
    if frame == "initial":
        np.testing.assert_allclose(pose.rotation.as_matrix(), QUARTER.as_matrix(), atol=1e-15)
        assert box.distance(np.array([[0.1, 0.0, 0.05]]))[0] == pytest.approx(0.07)  # 30 mm along x
    np.testing.assert_allclose(task.surroundings[0].rotation.as_matrix(), QUARTER.as_matrix(), atol=1e-15)


def cloud_task(folder, points, /, **fields):
    np.save(folder / "seen.npy", points)
    cloud = {"type": "cloud", "file": "seen.npy", "radius": 2} | fields
    return written(folder, changed("planning.obstacles", [{"center": [10, 0, 0]}, cloud]))


def test_a_cloud_is_read_from_its_file_in_the_units_of_the_task(tmp_path):
    points = np.random.default_rng(0).uniform(100, 200, (50, 3))
    task = load_task(cloud_task(tmp_path, points, clearance=7))
    section = task.planning.obstacles[1]
    cloud = section.obstacle
    np.testing.assert_allclose(cloud.points, points * 1e-3, rtol=1e-15)
    assert cloud.radius == pytest.approx(0.002)
    assert cloud.clearance == pytest.approx(0.007)
    at = np.array([[0.0, 0.0, 0.0], [0.15, 0.15, 0.15]])
    nearest = np.linalg.norm(cloud.points[:, None] - at, axis=2).min(axis=0)
    np.testing.assert_allclose(cloud.distance(at), nearest - 0.002)
    moved = section.transformed(RigidTransform.from_translation([0.1, 0.0, -0.1])).obstacle
    np.testing.assert_allclose(moved.points - cloud.points, np.tile([0.1, 0.0, -0.1], (50, 1)))
    assert moved.clearance == cloud.clearance
    assert task.planning.common_obstacles == (0,)
    inline = changed("planning.obstacles", [{"type": "cloud", "points": points.tolist()}])
    np.testing.assert_allclose(
        load_task(written(tmp_path, inline)).planning.obstacles[0].obstacle.points, points * 1e-3
    )


def test_a_mesh_is_read_from_its_file_part_by_part_turned_and_moved(tmp_path):
    """Two boxes in one file in inches, in a task in millimetres."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 2) for z in (0, 3)], dtype=float)
    lines = []
    for part, shift in enumerate(([0, 0, 0], [5, 0, 0])):
        lines += [f"v {x} {y} {z}" for x, y, z in corners + shift]
        hull = ConvexHull(corners)
        for face, equation in zip(hull.simplices, hull.equations, strict=True):
            a, b, c = corners[face]
            face = face if np.cross(b - a, c - a) @ equation[:3] > 0 else face[::-1]
            lines.append("f " + " ".join(str(1 + 8 * part + k) for k in face))
    (tmp_path / "boxes.obj").write_text("\n".join(lines))
    mesh = {"type": "mesh", "file": "boxes.obj", "units": "in", "translation": [0, 0, 100], "clearance": 7}
    turned = {**mesh, "rotation_vector": [0, 0, 90]}
    task = load_task(written(tmp_path, changed("planning.obstacles", [turned, {"center": [10, 0, 0]}])))
    *parts, ball = (section.obstacle for section in task.planning.obstacles)
    assert (len(parts), type(ball)) == (2, Sphere)
    for part, shift in zip(parts, ([0, 0, 0], [5, 0, 0]), strict=True):
        x, y, z = (0.0254 * (corners + shift)).T
        expected = np.column_stack([-y, x, z + 0.1])
        np.testing.assert_allclose(np.sort(part.vertices, axis=0), np.sort(expected, axis=0), atol=1e-12)
        assert (part.file, part.clearance) == ("boxes.obj", pytest.approx(0.007))
    moved = task.planning.obstacles[0].transformed(RigidTransform.from_translation([0.1, 0.0, 0.0])).obstacle
    np.testing.assert_allclose(moved.vertices - parts[0].vertices, np.tile([0.1, 0.0, 0.0], (8, 1)))
    with pytest.raises(InputError, match=r"planning\.obstacles\.0\.file: given beside vertices"):
        load_task(written(tmp_path, changed("planning.obstacles", [{**mesh, "vertices": []}])))
    with pytest.raises(InputError, match=r"planning\.obstacles\.0\.file: .*missing\.obj"):
        load_task(written(tmp_path, changed("planning.obstacles", [{**mesh, "file": "missing.obj"}])))


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"file": "../seen.npy"}, "obstacles.1.file: '../seen.npy' given; legal: a relative path inside"),
        ({"file": "missing.npy"}, "obstacles.1.file: "),
        ({"file": "task.yaml"}, "obstacles.1.file: task.yaml: legal: .npy, .xyz, .txt, .ply"),
        ({"file": 3}, "obstacles.1.file: 3 given; a path is needed"),
        ({"points": [[0, 0, 0]]}, "obstacles.1.file: given beside points; legal: one of the two"),
        ({"radius": -1}, "obstacles.1.cloud.radius: "),
    ],
)
def test_a_cloud_that_cannot_be_read_is_refused_by_name(tmp_path, fields, says):
    path = cloud_task(tmp_path, np.ones((4, 3)), **fields)
    with pytest.raises(InputError, match=f"planning.{re.escape(says)}") as refused:
        load_task(path)
    assert str(refused.value).startswith(str(path))
    assert str(refused.value).count("obstacles.1") == 1


def test_points_of_a_cloud_that_are_no_numbers_are_counted(tmp_path):
    points = np.ones((9, 3))
    points[[3, 5], 1] = np.nan
    says = "planning.obstacles.1.file: seen.npy: 2 of 9 points are not finite, the first is number 3"
    with pytest.raises(InputError, match=says):
        load_task(cloud_task(tmp_path, points))


TAGS = {
    "dictionary": "tag36h11",
    "panels": [
        {"id": 7, "edge": 40, "center": [10, 20, 400], "rotation_vector": [0, 0, 90]},
        {"id": 2, "edge": 60, "center": [-50, 0, 300]},
    ],
}
FACES = [{"kind": "stones", "seed": 3, "size": [200, 100], "center": [0, 0, 400]}]


def aimed_at(target, **more):
    return {**MINIMAL, "target": target, **more}


def test_tags_stand_in_the_initial_camera_frame_in_metres(tmp_path):
    target = load_task(written(tmp_path, aimed_at({"tags": TAGS}, scale={"tags": True}))).target
    first, second = target.tags.panels
    assert (first.id, first.edge, second.edge) == pytest.approx((7, 0.04, 0.06))
    np.testing.assert_allclose(first.transform.apply([0.02, 0, 0]), [0.01, 0.04, 0.4], atol=1e-15)
    np.testing.assert_allclose(second.transform.apply([0.02, 0, 0]), [-0.03, 0, 0.3], atol=1e-15)


def test_tags_may_have_opencvs_name_of_their_dictionary(tmp_path):
    """The task was loaded, and refused once its images were to be estimated from."""
    tags = {**TAGS, "dictionary": "DICT_APRILTAG_36h11"}
    target = load_task(written(tmp_path, aimed_at({"tags": tags}, scale={"tags": True}))).target
    assert target.known.tags[0].dictionary == target.tags.dictionary == "tag36h11"


def test_known_target_holds_the_tags_but_not_where_the_camera_is(tmp_path):
    target = load_task(written(tmp_path, aimed_at({"tags": TAGS}))).target
    first, second = target.known.tags
    assert (first.dictionary, first.id, second.id) == ("tag36h11", 7, 2)
    half = 0.02
    np.testing.assert_allclose(first.corners[0], [-half, -half, 0], atol=1e-15)
    between = first.target_T_tag.inv() * second.target_T_tag
    stated = target.tags.panels[0].transform.inv() * target.tags.panels[1].transform
    np.testing.assert_allclose(between.as_matrix(), stated.as_matrix(), atol=1e-15)
    assert load_task(written(tmp_path, MINIMAL)).target.known is None


def test_textured_faces_are_read_in_metres(tmp_path):
    (face,) = load_task(written(tmp_path, aimed_at({"textures": FACES}))).target.textures
    assert (face.kind, face.seed) == ("stones", 3)
    assert face.size == pytest.approx((0.2, 0.1))


@pytest.mark.parametrize(
    ("target", "more", "says"),
    [
        ({}, {}, "exactly one of dots, tags, textures"),
        ({"tags": TAGS, "textures": FACES}, {}, "exactly one of dots, tags, textures"),
        ({"tags": TAGS, "dot_radius": 5}, {}, "dot_radius stands with dots"),
        ({"dots": [{"center": [0, 0, 400]}]}, {}, "dot_radius stands with dots"),
        ({"tags": {**TAGS, "dictionary": "tag37"}}, {}, "target.tags.dictionary: 'tag37' given"),
        (
            {"tags": {**TAGS, "panels": [TAGS["panels"][0], {**TAGS["panels"][1], "id": 7}]}},
            {},
            "id 7 given 2 times",
        ),
        (
            {"tags": {**TAGS, "dictionary": "tag16h5", "panels": [{**TAGS["panels"][0], "id": 30}]}},
            {},
            "0 to 29",
        ),
        ({"tags": {**TAGS, "panels": []}}, {}, "target.tags.panels"),
        (
            {"tags": {**TAGS, "panels": [{"id": 1, "edge": 0, "center": [0, 0, 1]}]}},
            {},
            "target.tags.panels.0.edge",
        ),
        ({"textures": [{**FACES[0], "kind": "wool"}]}, {}, "'stones', 'poster' or 'crate'; 'wool' given"),
        ({"textures": [{**FACES[0], "size": [100, -1]}]}, {}, "target.textures.0.size.1"),
        ({"textures": FACES}, {"scale": {"tags": True}}, "needs a target of tags"),
        (
            {"tags": TAGS},
            {"scale": {"known_length": {"dots": [0, 1], "length": 5}}},
            "needs a target of dots",
        ),
    ],
)
def test_a_target_that_cannot_be_is_refused_with_the_reason(tmp_path, target, more, says):
    with pytest.raises(InputError) as refusal:
        load_task(written(tmp_path, aimed_at(target, **more)))
    assert says in str(refusal.value)


def test_a_missing_field_is_named(tmp_path):
    document = {k: v for k, v in MINIMAL.items() if k != "arm"}
    with pytest.raises(InputError, match="arm: Field required"):
        load_task(written(tmp_path, document))


def test_an_unknown_task_lists_the_shipped_ones():
    with pytest.raises(InputError, match="paper-example-1, paper-example-2"):
        load_task("paper-example-3")


def test_another_camera_replaces_the_tasks(tmp_path):
    assert load_task("paper-example-1", camera="perspective").camera == preset("perspective")


TAG_BOARD = load_task("tag-board").target


def goal():
    camera = preset("fe185")
    image = np.arange(camera.width * camera.height, dtype=np.uint8).reshape(camera.height, camera.width)
    return TaughtGoal(
        camera, image, np.array([[10.25, 20.5], [30.0, 40.125]]), np.linspace(0, 1, 6), TAG_BOARD
    )


def test_a_taught_goal_survives_its_file(tmp_path):
    goal().save(tmp_path / "goal.json")
    back = TaughtGoal.load(tmp_path / "goal.json")
    assert back.camera == goal().camera
    np.testing.assert_array_equal(back.image, goal().image)
    np.testing.assert_array_equal(back.features, goal().features)
    np.testing.assert_array_equal(back.joints, goal().joints)
    assert back.target == goal().target


def test_a_goal_that_does_not_say_what_it_was_taught_of_is_read():
    fields = goal().to_dict()
    del fields["target"]
    assert TaughtGoal.from_dict(fields).target is None


@pytest.mark.parametrize("name", ["paper-example-1", "tag-board", "textured-object"])
def test_a_target_is_like_itself_wherever_it_stands_and_unlike_what_shows_other_features(name):
    there = RigidTransform.from_components([1.0, 2.0, 3.0], Rotation.from_rotvec([0.5, 1.0, -2.0]))
    target = load_task(name).target
    assert target.unlike(target.transformed(there)) == ""
    for other in ("paper-example-2", "panda-table", "textured-object"):
        other_target = load_task(other).target
        assert bool(target.unlike(other_target)) == (name != other)


def test_targets_of_as_many_features_differ_by_their_distances():
    target = load_task("paper-example-1").target
    first, *rest = target.dots
    moved = first.transformed(RigidTransform.from_translation([0.0, 0.004, 0.0]))
    near = first.transformed(RigidTransform.from_translation([0.0, 0.0004, 0.0]))
    assert "differ by" in target.unlike(target.model_copy(update={"dots": (moved, *rest)}))
    assert target.unlike(target.model_copy(update={"dots": (near, *rest)})) == ""
    assert "dots, not" in target.unlike(target.model_copy(update={"dots": tuple(rest)}))
    assert target.unlike(target.model_copy(update={"dots": (*rest, first)})) == ""


def test_the_order_of_tags_and_faces_makes_no_other_target():
    tag = load_task("panda-table").target
    tags = tag.tags.panels[0]
    both = tuple(tags.model_copy(update={"id": number}) for number in (4, 7))
    target, turned = (
        tag.model_copy(update={"tags": tag.tags.model_copy(update={"panels": panels})})
        for panels in (both, both[::-1])
    )
    assert target.unlike(turned) == ""
    faces = load_task("textured-object").target
    assert len(faces.textures) > 1
    assert faces.unlike(faces.model_copy(update={"textures": faces.textures[::-1]})) == ""


def test_a_goal_of_the_first_format_is_read(tmp_path):
    path = tmp_path / "goal.json"
    goal().save(path)
    text = path.read_text().replace("omniservo.goal/2", "omniservo.goal/1").replace('"features"', '"dots"')
    path.write_text(text)
    np.testing.assert_array_equal(TaughtGoal.load(path).features, goal().features)
    fields = json.loads(text)
    TaughtGoal.from_dict(fields)
    assert fields == json.loads(text)  # whose fields they are finds them as they were


def test_a_goal_whose_image_says_that_it_is_huge_is_refused(tmp_path):
    path, bomb = tmp_path / "goal.json", b"\x89PNG\r\n\x1a\n"
    head = struct.pack(">IIBBBBB", 60_000, 60_000, 8, 0, 0, 0, 0)
    for kind, data in ((b"IHDR", head), (b"IDAT", zlib.compress(b"0")), (b"IEND", b"")):
        bomb += struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    goal().save(path)
    fields = json.loads(path.read_text()) | {"image_png": base64.b64encode(bomb).decode()}
    with pytest.raises(InputError, match="image_png: not a PNG image"):
        TaughtGoal.from_dict(fields)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("omniservo.goal/2", "omniservo.goal/7", "legal: 'omniservo.goal/2'"),
        ('"features"', '"points"', "points: no such field; legal: format, camera, image_png, features"),
        ("10.25", "NaN", "features"),
        ('"dictionary": "', '"dictionary": "x', "target.tags.dictionary: "),
        ('"target": {', '"target": {"colour": 3, ', "target.colour: no such field; legal: frame"),
        ('"image_png": "', '"image_png": "AAAA', "not a PNG"),
        ('"width": 659', '"width": 660', "659"),
    ],
)
def test_a_damaged_goal_file_is_refused_with_its_reason(tmp_path, old, new, says):
    path = tmp_path / "goal.json"
    goal().save(path)
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(InputError, match=str(path)) as refusal:
        TaughtGoal.load(path)
    assert says in str(refusal.value)


def test_an_arm_of_ones_own_is_a_file_inside_the_tasks_folder(tmp_path):
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots" / "mine.xml").write_text(load_arm("ur5e").path.read_text())
    task = load_task(written(tmp_path, changed("arm.model", "robots/mine.xml")))
    assert task.arm.model == str(tmp_path / "robots" / "mine.xml")
    assert scene_of_task(task).arm.dof == 6


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("arm.model", "kr6", "arm.model: 'kr6' is neither a file nor a shipped arm: panda, rx60, ur5e"),
        ("arm.model", "../mine.urdf", "arm.model: '../mine.urdf' given; legal: a relative path inside"),
        ("arm.model", "/mine.urdf", "legal: a relative path inside the file's folder"),
        ("arm.model", 7, "arm.model: Input should be a valid string"),
        ("start.joints_near", [0, 0, 0, 0, 0], "start.joints_near: Tuple should have at least 6"),
        ("start.joints_near", [0] * 8, "start.joints_near: Tuple should have at most 7"),
    ],
)
def test_an_arm_that_cannot_be_had_is_named(tmp_path, field, value, message):
    with pytest.raises(InputError, match=message):
        load_task(written(tmp_path, changed(field, value)))


def test_seven_joints_for_an_arm_of_six_are_refused(tmp_path):
    task = load_task(written(tmp_path, changed("start.joints_near", [0] * 7)))
    with pytest.raises(InputError, match="start.joints_near: 7 numbers given; rx60 has 6 joints"):
        scene_of_task(task)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (np.full((5, 6), 1e-6).tolist(), "six rows of six numbers"),
        (np.eye(6, k=1).tolist(), "a symmetric matrix"),
        ((1e-8 * np.eye(6) + 5e-9 * np.eye(6, k=1)).tolist(), "a symmetric matrix"),
        ((-1e-6 * np.eye(6)).tolist(), "without negative eigenvalues"),
        ((np.inf * np.ones((6, 6))).tolist(), "finite number"),
    ],
)
def test_a_mounts_covariance_that_is_none_is_refused(tmp_path, value, message):
    with pytest.raises(InputError, match=message):
        load_task(written(tmp_path, changed("arm.mount_covariance", value)))


def test_a_mount_from_a_file_leaves_the_arm_and_its_foot_as_they_are_stated(tmp_path):
    pose = {"translation": [0, 0, 0.09], "quaternion": [0, 0, 0, 1]}
    covariance = (1e-8 * np.eye(6)).tolist()
    mount = {"format": "omniservo.hand_eye/1", "flange_T_camera": pose, "covariance": covariance}
    (tmp_path / "mount.json").write_text(json.dumps(mount))
    document = changed("arm", {"model": "rx60", "foot": [1, 2, -341], "flange_T_camera": "mount.json"})
    arm = load_task(written(tmp_path, document)).arm
    assert (arm.model, arm.foot) == ("rx60", (0.001, 0.002, -0.341))
    assert arm.flange_T_camera.translation == (0, 0, 0.09)  # in m, whatever the task's units
    assert np.array_equal(arm.mount_covariance, covariance)


@pytest.mark.parametrize("given", ["mount.json", ""])
def test_a_mount_that_is_no_file_is_refused_by_its_field(tmp_path, given):
    document = changed("arm", {"model": "rx60", "foot": [1, 2, -341], "flange_T_camera": given})
    words = rf"task\.yaml: arm\.flange_T_camera: {given!r}: no such file; legal: .* or a pose"
    with pytest.raises(InputError, match=words):
        load_task(written(tmp_path, document))


def test_older_files_say_tool_for_the_flange_but_not_both(tmp_path):
    document = changed("arm.tool_T_camera", {"translation": [0, 0, 50]})
    with pytest.raises(InputError, match="give flange_T_camera or tool_T_camera, which mean the same"):
        load_task(written(tmp_path, document))
    del document["arm"]["flange_T_camera"]
    document["arm"]["tool"] = "flange"
    task = load_task(written(tmp_path, document))
    np.testing.assert_allclose(task.arm.flange_T_camera.translation, [0, 0, 0.05])
    assert task.arm.flange == "flange"
    with pytest.warns(DeprecationWarning, match="ArmMount.tool is called flange now"):
        assert task.arm.tool == "flange"
    document["arm"]["flange"] = "flange"
    with pytest.raises(InputError, match="give flange or tool, which mean the same"):
        load_task(written(tmp_path, document))


def test_a_misspelt_field_of_the_arm_is_told_the_names_of_now(tmp_path):
    with pytest.raises(InputError, match="legal: model, flange, packages, foot, flange_T_camera, mount_cov"):
        load_task(written(tmp_path, changed("arm.flang", "tool0")))


def test_moves_shift_what_is_known_from_their_time_on(tmp_path):
    shapes = [
        {"center": [0, 0, 90]},
        {"type": "capsule", "from": [0, 0, 1], "to": [0, 0, 2], "radius": 1},
        {"type": "half_space", "normal": [0, 0, 1], "offset": -50},
    ]
    document = MINIMAL | {
        "obstacles": [{"center": [0, 0, 90], "half_extents": [5, 5, 5]}],
        "planning": {"obstacles": shapes},
        "moves": [{"time": 1.5, "by": [10, 0, 20], "bodies": [0], "known": [0, 1, 2]}],
    }
    task = load_task(written(tmp_path, document))
    assert task.known_obstacles(1.4) == task.planning.obstacles
    ball, rod, side = task.known_obstacles(1.5)
    assert ball.center == pytest.approx([0.01, 0.0, 0.11])
    assert rod.start == pytest.approx([0.01, 0.0, 0.021])
    assert rod.end == pytest.approx([0.01, 0.0, 0.022])
    assert side.offset == pytest.approx(-0.03)


def test_an_obstacle_is_counted_once_whatever_parts_the_file_of_a_mesh_before_it_has(tmp_path):
    """Two cubes in one file, then a ball."""
    (tmp_path / "boxes.obj").write_text(quad_cubes([0, 0, 0], [5, 0, 0]))
    document = MINIMAL | {
        "obstacles": [{"center": [0, 0, 90], "half_extents": [5, 5, 5]}],
        "planning": {"obstacles": [{"type": "mesh", "file": "boxes.obj"}, {"center": [0, 0, 90]}]},
        "moves": [
            {"time": time, "by": [10, 0, 0], "bodies": [0], "known": [k]} for k, time in enumerate((2, 1))
        ],
    }
    task = load_task(written(tmp_path, document))
    before, after, last = (task.known_obstacles(time) for time in (0.0, 1.0, 2.0))
    assert [x == y for x, y in zip(before, after, strict=True)] == [True, True, False]
    assert [x == y for x, y in zip(after, last, strict=True)] == [False, False, True]
    document["planning"]["obstacles"][1]["radius"] = -1
    with pytest.raises(InputError, match=r"planning\.obstacles\.1\.sphere\.radius"):
        load_task(written(tmp_path, document))
    document["planning"]["obstacles"][1]["radius"] = 1
    document["moves"][1]["known"] = [2]
    with pytest.raises(InputError, match=r"moves\.1\.known: 2 given; there are 2"):
        load_task(written(tmp_path, document))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"bodies": [1]}, r"moves.0.bodies: 1 given; there are 1, counted from 0"),
        ({"known": [0]}, r"moves.0.known: 0 given; there are 0"),
        ({"bodies": []}, "moves.0.bodies"),
        ({"bodies": [0, 0]}, r"moves.0.bodies: 0 given twice; once is legal"),
        ({"time": -1}, "moves.0.time"),
        ({"by": [float("nan"), 0, 0]}, "moves.0.by"),
    ],
)
def test_a_move_that_cannot_be_is_refused(tmp_path, change, says):
    move = {"time": 1.0, "by": [1, 0, 0], "bodies": [0], "known": [0]} | change
    blocks = [{"center": [0, 0, 90], "half_extents": [5, 5, 5]}]
    with pytest.raises(InputError, match=says):
        load_task(written(tmp_path, MINIMAL | {"obstacles": blocks, "moves": [move]}))


def test_a_task_knows_its_files_wherever_the_process_works_by_then(tmp_path, monkeypatch):
    (tmp_path / "arm.urdf").write_text(urdf())
    written(tmp_path, changed("arm.model", "arm.urdf"))
    monkeypatch.chdir(tmp_path)
    task = load_task("task.yaml", packages={"meshes": "."})
    monkeypatch.chdir(tmp_path.parent)
    kept = task.sources.kept(task)
    assert (kept.task, sorted(kept.files), kept.packages) == (
        "task.yaml",
        ["arm.urdf", "task.yaml"],
        {"meshes": "."},
    )


def test_files_elsewhere_are_read_only_where_the_reader_allows_it(tmp_path):
    folder = tmp_path / "tasks" / "one"
    folder.mkdir(parents=True)
    elsewhere = tmp_path / "calibrations" / "lens.yaml"
    elsewhere.parent.mkdir()
    save_camera(UnifiedCamera(200.0, 200.0, 319.5, 239.5, 0.7, 640, 480), elsewhere)
    file = written(folder, changed("camera", "../../calibrations/lens.yaml"))
    with pytest.raises(
        InputError, match=r"camera: .*lens.yaml' given; legal: .*; --allow-outside allows any"
    ):
        load_task(file)
    assert load_task(file, allow_outside=True).camera.xi == 0.7
    assert load_task(file, camera=elsewhere).camera.xi == 0.7  # named by the reader, not by the task


def test_packages_of_a_task_lie_in_its_folder_and_the_readers_win(tmp_path):
    folder = tmp_path / "task"
    for place, radius in ((folder / "inside", 0.02), (tmp_path / "own", 0.03)):
        place.mkdir(parents=True)
        trimesh.creation.icosphere(1, radius).export(place / "ball.stl")
    (folder / "arm.urdf").write_text(urdf(collision='<mesh filename="package://shapes/ball.stl"/>'))
    document = changed("arm", {**MINIMAL["arm"], "model": "arm.urdf", "packages": {"shapes": "inside"}})
    document["start"] = {"joints": [0, 0, 30, 0, 60, 0]}
    own = {"shapes": tmp_path / "own"}
    for options, radius in (({}, 0.02), ({"packages": own}, 0.03)):
        arm = scene_of_task(load_task(written(folder, document), **options)).arm
        assert arm.links[0].shapes[0].extents[0] == pytest.approx(2.0 * radius, rel=0.1)
    task = load_task(written(folder, document))
    save_task(task, folder / "saved.yaml")
    assert load_task(folder / "saved.yaml").arm == task.arm
    document["arm"]["packages"] = {"shapes": "../own"}
    with pytest.raises(InputError, match=r"arm\.packages\.shapes: '../own' given; legal: a relative path"):
        load_task(written(folder, document))
    load_task(written(folder, document), allow_outside=True)
    document["arm"]["packages"] = ["shapes"]
    with pytest.raises(InputError, match=r"arm\.packages: \['shapes'\] given; legal: \{NAME: FOLDER, …\}"):
        load_task(written(folder, document))


@pytest.mark.parametrize("own", [{"units": "in"}, {"scale": 0.0254}])
def test_a_cloud_s_file_may_be_in_another_unit_than_the_task(own, tmp_path):
    text = (resources.files("omniservo.tasks") / "shipped" / "paper-example-1.yaml").read_text()
    fields = yaml.safe_load(text)
    np.save(tmp_path / "scan.npy", np.array([[1.0, 2.0, 10.0]]))
    cloud = {"type": "cloud", "file": "scan.npy", "radius": 1, **own}
    fields["planning"]["obstacles"], file = [cloud], tmp_path / "task.yaml"
    file.write_text(yaml.safe_dump(fields))
    (section,) = load_task(file).planning.obstacles
    assert np.allclose(section.obstacle.points, [[0.0254, 0.0508, 0.254]])
    assert section.obstacle.file == "scan.npy"
    file.write_text(yaml.safe_dump({**fields, "planning": {"obstacles": [{**cloud, "units": "ell"}]}}))
    with pytest.raises(InputError, match=r"planning\.obstacles\.0\.units"):
        load_task(file)


@pytest.mark.parametrize("kind", ["sphere", "box", "half_space", "cloud"])
def test_a_motion_over_w_is_refused_by_a_message_that_names_moves(tmp_path, kind):
    places = {
        "sphere": {"center": [0, 0, 100]},
        "box": {"center": [0, 0, 100], "half_extents": [1, 1, 1]},
        "half_space": {"normal": [0, 0, 1], "offset": -500},
        "cloud": {"points": [[0, 0, 100]]},
    }
    obstacle = {"type": kind, **places[kind]}
    file = tmp_path / "task.json"
    file.write_text(json.dumps({**MINIMAL, "planning": {"obstacles": [obstacle]}}))
    assert len(load_task(file).planning.obstacles) == 1
    moving = {**obstacle, "motion": [[10, 0], [0, 0], [0, 0]]}
    file.write_text(json.dumps({**MINIMAL, "planning": {"obstacles": [moving]}}))
    with pytest.raises(InputError, match=r"task\.json: planning\.obstacles\.0.*motion: .*moves"):
        load_task(file)
