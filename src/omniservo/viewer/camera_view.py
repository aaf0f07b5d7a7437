"""What the camera sees at a place of the path, with the planned trajectories of the points drawn in."""

from __future__ import annotations

from functools import lru_cache
from typing import TypeAlias

import numpy as np
from PIL import Image, ImageDraw
from scipy.spatial.transform import RigidTransform

from omniservo.cameras import UnifiedCamera
from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray
from omniservo.planning import Plan, PlanningProblem
from omniservo.planning.obstacles.obstacle import hides_points
from omniservo.reporting.image_distance import image_distance
from omniservo.scenes import Scene
from omniservo.simulation import UnifiedRenderer, World
from omniservo.simulation.body_meshes import solid_triangles
from omniservo.viewer.situation import Situation
from omniservo.whole_arm.solids_of import solids_of

Colour: TypeAlias = tuple[int, int, int]

SAMPLES = 41
"""of a trajectory"""

_LONGEST = 480
"""[px] of the image's longer side"""

_FINE = 2
"""so many times as fine bodies are drawn, whose sides are then smooth"""

_TRAJECTORY: Colour = (240, 160, 30)
_VIOLATED: Colour = (225, 40, 50)
_POINT: Colour = (20, 120, 255)
_LIMIT: Colour = (255, 60, 60)
_GROUND, _BODY = 205, 95
"""greys of what is drawn without an arm's scene"""


class CameraView:
    """Renders the views of one camera in one scene after the other. For one thread."""

    def __init__(self) -> None:
        self._scene: Scene | None = None
        self._renderer: UnifiedRenderer | None = None

    def drawn(
        self, situation: Situation, plan: Plan, camera: RigidTransform, joints: FloatArray | None, w: float
    ) -> ByteArray:
        """Return the view (rows, columns, 3) with a plan's trajectories.

        Args:
            situation: what stands where.
            plan: in the frame of its initial camera.
            camera: in the world, where there are no joints to render with.
            joints: (n,) of the arm [rad].
            w: where on the path the points are marked.
        """
        scene = situation.world_scene
        if scene is None or joints is None:
            grey = drawn_obstacles(situation.problem, situation.world_T_initial.inv() * camera)
        else:
            grey = self.rendered(scene, joints)
        return with_trajectories(grey, plan, w)

    def rendered(self, scene: Scene, joints: FloatArray) -> ByteArray:
        """Return the grey image (height, width) that the simulator's camera sees, the arm in these joints."""
        if self._renderer is None or self._scene is not scene:
            self._renderer, self._scene = UnifiedRenderer(World(scene)), scene
        lit = np.clip(self._renderer.render(joints), 0.0, 1.0)
        return np.asarray(np.rint(255.0 * lit ** (1.0 / 2.2)), dtype=np.uint8)


def drawn_obstacles(problem: PlanningProblem, initial_T_camera: RigidTransform) -> ByteArray:
    """Return a grey image of the problem's obstacles alone: for a problem without an arm.

    It has the shape of the camera's, and no more pixels than are seen of it: a file may state any size.
    """
    camera = problem.camera
    scale = min(1.0, _FINE * _LONGEST / max(camera.width, camera.height))
    size = (max(1, round(scale * camera.width)), max(1, round(scale * camera.height)))
    drawing = Image.new("L", size, _GROUND)
    pen = ImageDraw.Draw(drawing)
    hiding = tuple(o for o in problem.obstacles if hides_points(o) and o.motion is None)
    triangles = [np.zeros((0, 3, 3))]
    for solid in solids_of(hiding, initial_T_camera.inv()):
        shape = solid_triangles(solid.kind, solid.size, solid.vertices).subdivide().subdivide()
        triangles.append(solid.pose.apply(np.array(shape.triangles).reshape(-1, 3)).reshape(-1, 3, 3))
    corners = np.concatenate(triangles)
    corners = corners[np.argsort(-np.linalg.norm(corners.mean(axis=1), axis=1))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = np.einsum("ij,ij->i", normals, corners.mean(axis=1)) < 0.0
    pixels, valid = camera.project(corners)
    shown = facing & valid.all(axis=1)
    for pixel, normal in zip(pixels[shown], normals[shown], strict=True):
        light = abs(normal[1]) / max(float(np.linalg.norm(normal)), 1e-12)
        pen.polygon([tuple(p) for p in scale * (pixel + 0.5) - 0.5], fill=int(_BODY + 60 * light))
    return np.asarray(drawing)


def with_trajectories(grey: ByteArray, plan: Plan, w: float) -> ByteArray:
    """Return the image in colour, no larger than a page needs, with trajectories, points and true limits."""
    problem = plan.problem
    camera = problem.camera
    scale = min(1.0, _LONGEST / max(camera.width, camera.height))
    size = max(1, round(scale * camera.width)), max(1, round(scale * camera.height))
    picture = Image.fromarray(grey).resize(size, Image.Resampling.BILINEAR).convert("RGB")
    outside = _beyond_limits(camera, problem.image_margin, size)
    tinted = np.array(picture)
    tinted[outside] = (0.55 * tinted[outside] + 0.45 * np.array(_LIMIT) * 0.7).astype(np.uint8)
    picture = Image.fromarray(tinted)
    pen = ImageDraw.Draw(picture)
    if plan.path is not None:
        colour = _TRAJECTORY if plan.status == "certified" else _VIOLATED
        pixels, valid = _seen(plan, np.linspace(0.0, 1.0, SAMPLES))
        for j in range(pixels.shape[1]):
            for line in _pieces(scale * pixels[:, j], valid[:, j]):
                pen.line([tuple(p) for p in line], fill=colour, width=2, joint="curve")
    here, seen = _seen(plan, np.array([w]))
    for x, y in scale * here[0][seen[0]]:
        pen.ellipse([x - 4, y - 4, x + 4, y + 4], outline=_POINT, width=2)
    return np.asarray(picture)


def _seen(plan: Plan, w: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the points' pixels (m, n, 2) at w (m,), and which are in the camera's domain."""
    problem = plan.problem
    if plan.path is None:
        ends = [RigidTransform.identity(), problem.initial_T_goal]
        poses = np.array([ends[int(place > 0.5)].as_matrix() for place in w])
    else:
        poses, _ = plan.path.sampled(np.ascontiguousarray(w))
    there = np.einsum("mji,mnj->mni", poses[:, :3, :3], problem.points[None] - poses[:, None, :3, 3])
    return problem.camera.project(there)


@lru_cache(maxsize=4)
def _beyond_limits(camera: UnifiedCamera, margin: float, size: tuple[int, int]) -> BoolArray:
    """Return which pixels of an image of another size no point may be at (rows, columns)."""
    columns = (np.arange(size[0]) + 0.5) * camera.width / size[0] - 0.5
    rows = (np.arange(size[1]) + 0.5) * camera.height / size[1] - 0.5
    distances = image_distance(camera, np.stack(np.meshgrid(columns, rows), axis=-1))
    return np.asarray(~(distances >= margin))


def _pieces(pixels: FloatArray, valid: BoolArray) -> list[FloatArray]:
    """Return the runs of pixels (k, 2), k ≥ 2, that the camera can see."""
    ends = np.flatnonzero(np.diff(np.concatenate([[0], valid.astype(int), [0]])))
    return [pixels[a:b] for a, b in ends.reshape(-1, 2) if b - a >= 2]
