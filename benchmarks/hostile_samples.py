"""One good file of every kind that the program reads, to be spoiled by `benchmarks.hostile_files`."""

from __future__ import annotations

import io
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from PIL import Image
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.calibration.hand_eye import load_hand_eye
from omniservo.calibration.hand_eye.robot_poses_file import load_robot_poses
from omniservo.camera_files import load_model
from omniservo.camera_files.mask_image import load_mask
from omniservo.cameras import UnifiedCamera, preset
from omniservo.estimation import TwoViewEstimate, estimate_two_view
from omniservo.files.image_files import read_grey_image, read_image
from omniservo.files.mesh_files import read_triangles
from omniservo.planning import Plan, PlanningProblem, plan_path
from omniservo.planning.obstacles.cloud_file import read_cloud
from omniservo.robots import Arm, TrackingTube
from omniservo.targets import Target
from omniservo.tasks import TaughtGoal, load_task
from omniservo.verification import PlanFileError, verify_plan

TESTS = Path(__file__).parents[1] / "tests"
sys.path += [str(TESTS / "calibration"), str(TESTS / "robots")]  # where samples of formats stand

from format_samples import SAMPLES  # noqa: E402
from urdf_arms import urdf  # noqa: E402

CORNERS = np.array([[i, j, k] for i in (-0.1, 0.1) for j in (-0.1, 0.1) for k in (-0.1, 0.1)])
FACES = np.array([
    [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6],
    [0, 6, 4], [1, 5, 7], [1, 7, 3],
])  # fmt: skip
"""of the box of these corners"""


@dataclass(frozen=True)
class Sample:
    """A good file, and what reads it."""

    name: str
    """of the file"""
    content: bytes
    read: Callable[[Path], Any]
    beside: dict[str, bytes]
    """other files of its folder"""
    command: tuple[str, ...] = ()
    """arguments that read it: FILE is its path, OUT that of a result"""

    @property
    def kind(self) -> str:
        """What it is, for the table."""
        return self.name.split(".", 1)[0].rstrip("0123456789") + Path(self.name).suffix


def samples() -> list[Sample]:
    """Return all of them."""
    return [*_cameras(), *_problems_and_plans(), *_tasks(), *_arms(), *_bodies(), *_pictures(), *_poses()]


def _sample(
    name: str, content: str | bytes, read: Callable[[Path], Any], *command: str, **beside: bytes
) -> Sample:
    data = content.encode() if isinstance(content, str) else content
    return Sample(name, data, read, {k.replace("__", "."): v for k, v in beside.items()}, command)


def _cameras() -> list[Sample]:
    found = []
    for i, (text, options, _) in enumerate(SAMPLES.values()):
        ending = "xml" if text.lstrip().startswith("<") else "json" if text.lstrip()[:1] == "{" else "yaml"

        def read(path: Path, options: Any = options) -> None:
            camera = load_model(path, **options)
            pixels = np.random.default_rng(0).uniform(0, 500, (200, 2))
            camera.project(camera.unproject(pixels)[0])

        named = ["--camera-name", options["name"]] if "name" in options else []
        found.append(_sample(f"camera{i}.{ending}", text, read, "camera", "show", "FILE", *named))
    lens = preset("fe185").to_dict()
    own = json.dumps({"format": "omniservo.camera/1", **lens})
    found.append(_sample("camera.json", own, load_model, "camera", "convert", "FILE", "OUT", "--to", "mei"))
    return found


def _problem() -> dict[str, Any]:
    points = [[i, j, 0.5] for i in (-0.08, 0.0, 0.08) for j in (-0.08, 0.08)]
    return {
        "format": "omniservo.problem/1",
        "camera": preset("fe185").to_dict(),
        "points": points,
        "goal": {"translation": [0.05, 0.02, 0.1], "quaternion": [0.0, 0.0, 0.0, 1.0]},
        "obstacles": [
            {"type": "sphere", "center": [0.0, -0.3, 0.1], "radius": 0.05},
            {
                "type": "box",
                "center": [0.5, 0, 0],
                "quaternion": [0, 0, 0, 1],
                "half_extents": [0.1, 0.1, 0.1],
            },
            {"type": "capsule", "from": [-0.4, -0.1, 0], "to": [-0.4, 0.1, 0.1], "radius": 0.05},
            {"type": "cylinder", "from": [-0.6, -0.1, 0], "to": [-0.6, 0.1, 0.1], "radius": 0.05},
            {"type": "ellipsoid", "center": [0.0, -0.8, 0.0], "radii": [0.1, 0.02, 0.05]},
            {"type": "half_space", "normal": [0, 0, 1], "offset": -0.5, "clearance": 0.01},
            {"type": "mesh", "vertices": (CORNERS + np.array([0.0, 0.4, 0.0])).tolist()},
            {"type": "cloud", "points": [[-0.4, 0.2, 0.1], [-0.4, 0.25, 0.1]], "radius": 0.01},
            {"type": "mesh", "file": "brick.stl", "units": "m", "translation": [0.0, -0.6, 0.0]},
            {"type": "cloud", "file": "cloud.ply", "radius": 0.01},
        ],
        "clearance": 0.02,
        "least_distance": 0.02,
        "visibility_margin": 2.0,
        "occlusion": True,
        "workspace": {"min": [-1, -1, -1], "max": [1, 1, 1]},
        "degrees": {"rotation": 2, "translation": 2},
    }


def _problems_and_plans() -> list[Sample]:
    fields, beside = _problem(), {"brick__stl": _stl(), "cloud__ply": _ply("ascii")}
    alone = {**fields, "obstacles": fields["obstacles"][:6]}
    plan = plan_path(PlanningProblem.from_dict(alone))
    solve = lambda path: plan_path(PlanningProblem.load(path), time_budget=None)  # noqa: E731
    return [
        _sample("problem.json", json.dumps(fields), solve, "plan", "FILE", "--out", "OUT", **beside),
        _sample("problem.yaml", yaml.safe_dump(fields), solve, "plan", "FILE", "--out", "OUT", **beside),
        _sample("plan.json", json.dumps(plan.to_dict()), _load_and_verify, "verify", "FILE"),
    ]


def _load_and_verify(path: Path) -> None:
    try:
        verify_plan(path)
    except PlanFileError:
        Plan.load(path)
        raise AssertionError("a plan that the verifier cannot read was loaded") from None
    Plan.load(path)


def _tasks() -> list[Sample]:
    folder, found = resources.files("omniservo.tasks") / "shipped", []
    for name in ("paper-example-1", "tag-board", "panda-table", "textured-object", "moving-panel"):
        text = (folder / f"{name}.yaml").read_text(encoding="utf-8")
        found.append(_sample("task.yaml", text, load_task, "estimate", "FILE", "--out", "OUT"))
    return found


def _arms() -> list[Sample]:
    def read(path: Path) -> None:
        arm = Arm(path)
        arm.base_T_flange(arm.joint_range.mean(axis=1))

    meshed = urdf(collision='<mesh filename="brick.stl"/>')
    shipped = (resources.files("omniservo.robots") / "shipped" / "rx60.xml").read_text(encoding="utf-8")
    show = ("robot", "show", "FILE")
    return [
        _sample("arm.urdf", urdf(), read, *show),
        _sample("arm.urdf", meshed, read, *show, brick__stl=_stl()),
        _sample("arm.xml", shipped, read, *show),
    ]


def _stl() -> bytes:
    rows = np.zeros(
        len(FACES), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]
    )
    rows["corners"] = CORNERS[FACES]
    return b"\0" * 80 + np.uint32(len(FACES)).tobytes() + rows.tobytes()


def _ply(kind: str) -> bytes:
    header = f"ply\nformat {kind} 1.0\nelement vertex {len(CORNERS)}\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    text = "\n".join(" ".join(map(str, row)) for row in CORNERS.tolist()) + "\n"
    body = text.encode() if kind == "ascii" else (CORNERS + np.array([2.0, 0.0, 0.0])).astype("<f4").tobytes()
    return header.encode() + body


def _bodies() -> list[Sample]:
    found = []
    text = "solid brick\n"
    for corners in CORNERS[FACES].tolist():
        rows = "\n".join(f"vertex {x} {y} {z}" for x, y, z in corners)
        text += f"facet normal 0 0 1\nouter loop\n{rows}\nendloop\nendfacet\n"
    text += "endsolid brick\n"
    obj = "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS.tolist())
    obj += "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in FACES.tolist())
    values, triangles = " ".join(map(str, CORNERS.ravel())), " ".join(map(str, FACES.ravel()))
    dae = (
        '<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
        '<asset><unit name="meter" meter="1"/><up_axis>Z_UP</up_axis></asset><library_geometries>'
        '<geometry id="g"><mesh><source id="p"><float_array id="a" count="24">' + values + "</float_array>"
        '<technique_common><accessor source="#a" count="8" stride="3"><param name="X" type="float"/>'
        '<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>'
        '<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>'
        '<triangles count="12"><input semantic="VERTEX" source="#v" offset="0"/><p>' + triangles + "</p>"
        '</triangles></mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="s">'
        '<node id="n"><instance_geometry url="#g"/></node></visual_scene></library_visual_scenes><scene>'
        '<instance_visual_scene url="#s"/></scene></COLLADA>'
    )
    for name, content in {"mesh.stl": _stl(), "mesh.STL": text, "mesh.obj": obj, "mesh.dae": dae}.items():
        found.append(_in_problem(name, content, {"type": "mesh"}, read_triangles))
    array = io.BytesIO()
    np.save(array, CORNERS)
    lines = "".join(f"{x} {y} {z}\n" for x, y, z in CORNERS.tolist())
    ascii_ply, binary = _ply("ascii"), _ply("binary_little_endian")
    clouds = {"cloud.npy": array.getvalue(), "cloud.xyz": lines, "cloud.ply": ascii_ply, "cloud.PLY": binary}
    for name, content in clouds.items():
        found.append(_in_problem(name, content, {"type": "cloud", "radius": 0.01}, read_cloud))
    return found


def _in_problem(
    name: str, content: str | bytes, obstacle: dict[str, Any], read: Callable[[Path], Any]
) -> Sample:
    """A file that a problem beside it names."""
    fields = {**_problem(), "obstacles": [{**obstacle, "file": name}]}

    def read_both(path: Path) -> None:
        read(path)
        PlanningProblem.load(path.parent / "problem.json")

    problem = json.dumps(fields).encode()
    return _sample(
        name, content, read_both, "plan", "BESIDE/problem.json", "--out", "OUT", problem__json=problem
    )


def _pictures() -> list[Sample]:
    rng, found = np.random.default_rng(1), []
    grey = rng.integers(0, 255, (48, 64), dtype=np.uint8)
    mask = np.full((480, 640), 255, np.uint8)
    mask[200:240, 300:400] = 0
    lens = UnifiedCamera(40.0, 40.0, 32.0, 24.0, 0.9, 64, 48)
    camera = json.dumps({"format": "omniservo.camera/1", **lens.to_dict()}).encode()
    kinds = {
        "png": grey,
        "jpg": grey,
        "tif": grey,
        "bmp": grey,
        "webp": np.stack([grey] * 3, -1),
        "pgm": grey,
    }
    for ending, pixels in kinds.items():
        stream = io.BytesIO()
        Image.fromarray(pixels).save(stream, {"jpg": "JPEG", "tif": "TIFF", "pgm": "PPM"}.get(ending, ending))
        command = ("camera", "rectify", "BESIDE/camera.json", "FILE", "OUT", "--view-size", "32x32")
        found.append(
            _sample(f"picture.{ending}", stream.getvalue(), _both_ways, *command, camera__json=camera)
        )
    deep = io.BytesIO()
    Image.fromarray(grey.astype(np.uint16) * 16).save(deep, "PNG")
    found.append(_sample("picture.png", deep.getvalue(), _both_ways))
    hidden = io.BytesIO()
    Image.fromarray(mask).save(hidden, "PNG")
    found.append(_sample("mask.png", hidden.getvalue(), lambda path: load_mask(path, (640, 480))))
    return found


def _both_ways(path: Path) -> None:
    read_grey_image(path)
    read_image(path)


def _poses() -> list[Sample]:
    lens, rng = preset("fe185"), np.random.default_rng(2)
    pose = {"translation": [0.1, 0.2, 0.3], "quaternion": [0.0, 0.0, 0.0, 1.0]}
    vector = {"translation": [0.1, 0.2, 0.4], "rotation_vector": [0.1, 0.0, 0.2]}
    poses = {"format": "omniservo.robot_poses/1", "units": {"length": "m"}, "base_T_flange": [pose, vector]}
    table = "x,y,z,rx,ry,rz\n0.1,0.2,0.3,0,0,1\n0.2,0.2,0.3,0,1,0\n"
    hand_eye = {"format": "omniservo.hand_eye/1", "flange_T_camera": pose, "covariance": np.eye(6).tolist()}
    points = CORNERS + np.array([0.0, 0.0, 0.6])
    motion = RigidTransform.from_components([0.05, 0.02, 0.1], Rotation.from_rotvec([0.0, 0.1, 0.0]))
    views = [lens.project(points)[0], lens.project(motion.inv().apply(points))[0]]
    estimate = estimate_two_view(lens, *(v + 0.1 * rng.normal(size=v.shape) for v in views), scale=0.1)
    tag = {"dictionary": "tag36h11", "id": 3, "edge": 0.05, "translation": [0.0, 0.0, 0.0]}
    target = {"format": "omniservo.target/1", "points": [{"name": "a", "position": [0, 0, 0]}], "tags": [tag]}
    small = UnifiedCamera(40.0, 40.0, 32.0, 24.0, 0.9, 64, 48)
    goal = TaughtGoal(small, np.zeros((48, 64), np.uint8), views[0][:4], np.zeros(6))
    tube = (resources.files("omniservo.robots") / "shipped" / "rx60.tube.json").read_text(encoding="utf-8")
    problem = json.dumps({**_problem(), "obstacles": []}).encode()
    return [
        _sample("poses.yaml", yaml.safe_dump(poses), load_robot_poses),
        _sample("poses.csv", table, load_robot_poses),
        _sample("handeye.json", json.dumps(hand_eye), load_hand_eye),
        _sample("target.yaml", yaml.safe_dump(target), Target.load),
        _sample(
            "estimate.json", json.dumps(estimate.to_dict()), TwoViewEstimate.load,
            "plan", "BESIDE/problem.json", "--estimate", "FILE", "--out", "OUT", problem__json=problem,
        ),
        _sample("goal.json", _saved(goal.save), TaughtGoal.load),
        _sample("tube.json", tube, TrackingTube.load),
    ]  # fmt: skip


def _saved(save: Callable[[Path], None]) -> bytes:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        save(Path(folder) / "saved.json")
        return (Path(folder) / "saved.json").read_bytes()
