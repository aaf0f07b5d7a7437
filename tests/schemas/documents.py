"""One full document of every format, who reads it, and small damage to documents."""

import copy
import json
import re
from pathlib import Path

import numpy as np
import yaml
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo import PlanningProblem, TwoViewEstimate, UnifiedCamera, estimate_two_view, plan_path, preset
from omniservo.calibration.hand_eye import load_hand_eye, load_robot_poses
from omniservo.camera_files import load_model
from omniservo.cameras.models import DoubleSphere, ExtendedUnified, KannalaBrandt, OcamPolynomial, Pinhole
from omniservo.planning import (
    Box,
    Capsule,
    Cloud,
    Cylinder,
    Degrees,
    Ellipsoid,
    HalfSpace,
    Mesh,
    Plan,
    Sphere,
    Workspace,
)
from omniservo.robots import TrackingTube
from omniservo.shipped_studies import shipped_studies, study_file
from omniservo.shipped_tasks import shipped_tasks, task_file
from omniservo.targets import Tag, Target
from omniservo.tasks import TaughtGoal, load_robot, load_task

ROOT = Path(__file__).resolve().parents[2]
AWAY = np.array([0.0, 0.0, -3.0])
SQUARE = [[x, y, 0.6 - 0.5 * abs(x)] for x in (-0.1, 0.0, 0.1) for y in (-0.1, 0.0, 0.1)]
UPRIGHT = [0.0, 0.0, 0.0, 1.0]


def full_plan():
    """A plan in which every optional field stands."""
    camera = UnifiedCamera(
        300, 300, 330, 216, 1.2, 659, 432, skew=0.1, distortion=(-0.01, 0, 0, 0), max_angle=1.5,
        dead_zone={"center": [330.0, 300.0], "radius": 5.0}, mask=[[[0, 400], [20, 400], [0, 431]]],
        deviation_px=0.1, model_error={"sigma_px": 0.1, "length_px": 100.0},
        calibration_covariance=np.eye(5),
    )  # fmt: skip
    obstacles = (
        Sphere(AWAY, 0.1, clearance=0.2, motion=np.zeros((3, 1))),
        Box(AWAY, [0.1, 0.1, 0.1], UPRIGHT),
        Capsule(AWAY, AWAY + 0.1, 0.1),
        Cylinder(AWAY, AWAY + 0.1, 0.1),
        Ellipsoid(AWAY, [0.1, 0.1, 0.2], UPRIGHT),
        HalfSpace([0, 0, 1], -4.0),
        Mesh(AWAY + 0.1 * np.eye(4, 3)),
        Cloud(AWAY[None], 0.1),
    )
    problem = PlanningProblem(
        camera, SQUARE[4:6], RigidTransform.from_translation([0, 0, 0.1]),
        obstacles=obstacles, occlusion=True, degrees=Degrees(2, 2), initial_velocity=[0, 0, 0.1, 0, 0, 0],
        workspace=Workspace([-1, -1, -1], [1, 1, 1], (HalfSpace([0, 0, 1], -1.0),)),
    )  # fmt: skip
    return plan_path(problem).to_dict()


def estimate(camera):
    moved = RigidTransform.from_components([0.08, -0.05, 0.12], Rotation.from_rotvec([0.05, -0.1, 0.1]))
    pixels = [camera.project(a_T_b.apply(SQUARE))[0] for a_T_b in (RigidTransform.identity(), moved.inv())]
    noise = np.random.default_rng(1).normal(0.0, 0.05, (2, len(SQUARE), 2))
    return estimate_two_view(camera, *(np.array(pixels) + noise), scale=0.15)


def block(page, wanted):
    """Return the first YAML block of a page that begins with this line, as its fields."""
    blocks = re.findall(r"```yaml\n(.*?)```", (ROOT / "docs" / page).read_text(), re.DOTALL)
    return yaml.safe_load(next(text for text in blocks if text.startswith(wanted)))


def full_documents():
    """Return of every format that has a reader one document as it is written, with all that it may have."""
    fe185, plan = preset("fe185"), full_plan()
    found = estimate(fe185)
    assert found.status == "ok"
    pose = {"translation": [0.0, 0.0, 0.1], "quaternion": UPRIGHT}
    tag = Tag("tag36h11", 3, 0.04, RigidTransform.identity())
    image, target = np.zeros((fe185.height, fe185.width), np.uint8), load_task("ur5e-table").target
    goal = TaughtGoal(fe185, image, np.ones((3, 2)), np.zeros(6), target)
    mount = {"model": "ur5e", "packages": {}, "flange_T_camera": {"translation": [0.0, 0.0, 0.1]}}
    robot = block("real-robot.md", "format: omniservo.robot/1")
    tube = ROOT / "src/omniservo/robots/shipped/rx60.tube.json"
    return {
        "problem": plan["problem"],
        "plan": plan,
        "camera": {"format": "omniservo.camera/1", **plan["problem"]["camera"]},
        "task": yaml.safe_load(task_file("ur5e-table").read_text()),
        "robot": {**robot, "arm": mount, "camera": {**robot["camera"], "calibration": "fe185"}},
        "target": {
            **Target(("bolt",), np.array([[0.1, 0.0, 0.0]]), (tag,)).to_dict(),
            "units": {"length": "mm", "angle": "deg"},
        },
        "goal": goal.to_dict(),
        "estimate": {**found.to_dict(), "camera": fe185.to_dict(), "alternatives": [pose]},
        "hand_eye": {
            "format": "omniservo.hand_eye/1", "flange_T_camera": pose, "covariance": np.eye(6).tolist(),
        },
        "robot_poses": {
            "format": "omniservo.robot_poses/1",
            "units": {"length": "mm"},
            "base_T_flange": [{"image": "0.png", **pose}, {"image": "1.png", "matrix": np.eye(4).tolist()}],
        },
        "tracking-tube": json.loads(tube.read_text()),
    }  # fmt: skip


LENSES = (
    KannalaBrandt(190.0, 190.0, 255.0, 257.0, 512, 512, k=(0.01, 0.0, 0.0, 0.0)),
    ExtendedUnified(200.0, 200.0, 255.0, 257.0, 0.6, 1.1, 512, 512),
    DoubleSphere(200.0, 200.0, 255.0, 257.0, -0.1, 0.6, 512, 512),
    OcamPolynomial((-200.0, 0.0, 0.001), 255.0, 257.0, 512, 512),
    Pinhole(400.0, 400.0, 255.0, 257.0, 512, 512, distortion=(-0.1, 0.0, 0.0, 0.0)),
    *(preset(name) for name in ("fe185", "perspective", "para-catadioptric")),
)


def shipped_documents():
    """Yield the format's name and the fields of every file that is shipped or shown in full in the docs."""
    for name in shipped_tasks():
        yield "task", yaml.safe_load(task_file(name).read_text())
    for name in shipped_studies():
        yield "study", yaml.safe_load(study_file(name).read_text())
    for file in (ROOT / "src/omniservo/robots/shipped").glob("*.tube.json"):
        yield "tracking-tube", json.loads(file.read_text())
    yield "task", block("tasks.md", "format: omniservo.task/1")
    yield "target", block("targets.md", "format: omniservo.target/1")
    yield "robot", block("real-robot.md", "format: omniservo.robot/1")


def _from_file(load):
    def read(fields, folder):
        path = folder / "document.json"
        path.write_text(json.dumps(fields))
        load(path)

    return read


READERS = {
    "problem": lambda fields, folder: PlanningProblem.from_dict(fields, folder=folder),
    "plan": lambda fields, folder: Plan.from_dict(fields),
    "camera": _from_file(load_model),
    "task": _from_file(load_task),
    "robot": _from_file(load_robot),
    "target": lambda fields, folder: Target.from_dict(fields),
    "goal": lambda fields, folder: TaughtGoal.from_dict(copy.deepcopy(fields)),
    "estimate": lambda fields, folder: TwoViewEstimate.from_dict(fields),
    "hand_eye": _from_file(load_hand_eye),
    "robot_poses": _from_file(load_robot_poses),
    "tracking-tube": _from_file(TrackingTube.load),
}
"""What reads a document, as fields, with a folder for files."""


def damaged(fields, place=()):
    """Yield where and what: the same document with one field gone, one too many, or of another kind."""
    if isinstance(fields, dict):
        yield (*place, "surplus"), {**fields, "surplus": 1}
        for name, held in fields.items():
            yield (*place, name, "missing"), {key: value for key, value in fields.items() if key != name}
            for where, inner in damaged(held, (*place, name)):
                yield where, {**fields, name: inner}
    elif isinstance(fields, list) and fields:
        yield (*place, "shorter"), fields[:-1]
        for where, inner in damaged(fields[0], (*place, 0)):
            yield where, [inner, *fields[1:]]
    if fields is not None:
        yield (*place, "other kind"), _other_kind(fields)


def _other_kind(fields):
    if isinstance(fields, str):
        return {"no": "such"}
    return 7 if isinstance(fields, dict) else "words"
