"""The page's scene: what stands in it, what can be dragged, and where the planner's answer is shown."""

from __future__ import annotations

from dataclasses import replace
from itertools import count
from threading import Lock, RLock
from typing import Any

import numpy as np
import trimesh
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras.models import CentralModel
from omniservo.geometry.arrays import FloatArray
from omniservo.planning import Cloud, HalfSpace
from omniservo.planning.obstacles.obstacle import Obstacle
from omniservo.simulation import World
from omniservo.simulation.body_meshes import BodyPoses, body_meshes, solid_triangles
from omniservo.viewer.answer import Answer
from omniservo.viewer.field_of_view import field_outline, field_surface
from omniservo.viewer.lit_triangles import lit_triangles
from omniservo.viewer.path_rods import Colour, PathRods
from omniservo.viewer.situation import Situation, obstacle_pose
from omniservo.whole_arm.solids_of import solids_of

CERTIFIED: Colour = (0, 150, 70)
VIOLATED: Colour = (215, 30, 40)
SEARCHING: Colour = (225, 140, 0)
EXECUTED: Colour = (30, 110, 200)
_START: Colour = (90, 95, 105)
_GOAL: Colour = (0, 80, 216)
_OBSTACLE: Colour = (150, 70, 45)
_TARGET: Colour = (200, 30, 30)

_PLACES = 65
"""of the path that it is drawn by"""

_MOST_SHOWN = 5000
"""points of a cloud"""

_STRAIGHT = 1e-6
"""sine of an angle from the vertical [rad] below which there is none"""

_NUMBERS = count()
"""A handle's name has one: of one that is made where another was, viser sends no place that is the origin."""

_COLOURS = {"certified": CERTIFIED, "no path": VIOLATED, "searching": SEARCHING}


class SceneNodes:
    """What is drawn for a situation and its answers. Any thread may change what is shown.

    Args:
        server: viser's.
        situation: what the page begins with; its arm and target do not change.
        dragged: called, on the server's loop, whenever a handle is dragged: it must be quick.
    """

    def __init__(self, server: Any, situation: Situation, dragged: Any) -> None:
        self._server, self._dragged = server, dragged
        self._size = float(np.linalg.norm(situation.problem.points, axis=1).mean())
        self._changing, self._ended = RLock(), False
        """held while handles come and go: a place is that of the obstacle that it is read for"""
        self.base = situation
        """what the handles' places are counted from: it changes by edits alone"""
        self._obstacles: list[Obstacle] = []
        self.handles: list[Any] = []
        """what each obstacle is dragged by"""
        self._handles_shown = True
        self._poses: BodyPoses | None = None
        self._posing = Lock()
        self._frames: dict[int, Any] = {}
        self._camera: CentralModel | None = None
        self._planned: Any = None
        server.scene.configure_default_lights(enabled=False)
        server.scene.configure_environment_map(None)  # the light is in the colours: see `lit_triangles`
        if situation.arm is not None:
            self._add_world(situation)
        else:
            server.scene.add_grid(
                "/grid", 4.0, 4.0, cell_size=0.1, position=(0.0, 0.0, self._lowest(situation))
            )
        points = situation.world_T_initial.apply(situation.problem.points).astype(np.float32)
        server.scene.add_point_cloud(
            "/target", points, _TARGET, point_size=0.012 * self._size * 2, point_shape="circle"
        )
        self._start = self._end_handle("start", _START, situation.world_T_initial)
        self._goal = self._end_handle("goal", _GOAL, situation.world_T_goal)
        self._path = PathRods(server.scene, "/path", 0.006 * self._size, (CERTIFIED, VIOLATED, SEARCHING))
        self._camera_frame = server.scene.add_frame("/camera", show_axes=False)
        self._worst = server.scene.add_line_segments("/worst", np.zeros((1, 2, 3)), VIOLATED, **_pixels(4.0))
        self._label = server.scene.add_label(
            "/worst_label", "", font_screen_scale=1.0, anchor="bottom-center"
        )
        self.put(situation)
        self._look_at(situation)

    def put(self, situation: Situation) -> None:
        """Show another situation: its obstacles, its camera; handles go to where it has them."""
        with self._changing:
            self.base = situation
            self._put_handles(situation)
            self.show_arrows_of(None)
        self._put_camera(situation)

    def _put_handles(self, situation: Situation) -> None:
        for handle in self.handles[len(situation.problem.obstacles) :]:
            handle.remove()
        del self.handles[len(situation.problem.obstacles) :]
        del self._obstacles[len(situation.problem.obstacles) :]
        alone = len(situation.handles) == 1
        for i, (obstacle, pose) in enumerate(
            zip(situation.problem.obstacles, situation.handles, strict=True)
        ):
            label = f"obstacle {i}" if alone else str(i)  # of several there would be no room
            if i == len(self.handles):
                self.handles.append(self._obstacle_handle(label, obstacle, pose))
                self._obstacles.append(obstacle)
            elif self._obstacles[i] is not obstacle:
                self.handles[i].remove()
                self.handles[i], self._obstacles[i] = (
                    self._obstacle_handle(label, obstacle, pose),
                    obstacle,
                )
        for handle, pose in ((self._start, situation.world_T_initial), (self._goal, situation.world_T_goal)):
            _place(handle, pose)

    def _put_camera(self, situation: Situation) -> None:
        scene = self._server.scene
        if self._camera != situation.camera:
            self._camera = situation.camera
            surface = trimesh.Trimesh(*field_surface(situation.camera, 0.3 * self._size))
            turn = situation.world_T_initial.rotation
            scene.add_glb("/camera/field", lit_triangles([(surface, _GOAL)], turn, opacity=0.18))
            outline = field_outline(situation.camera, 0.3 * self._size)
            scene.add_line_segments("/camera/border", outline, _GOAL, **_pixels(1.5))
            centre = trimesh.creation.icosphere(1, 0.012 * self._size)
            scene.add_glb("/camera/centre", lit_triangles([(centre, _GOAL)], turn))

    @property
    def situation(self) -> Situation:
        """The situation as the handles are now.

        Raises:
            InputError: the arm cannot bring the camera to its start.
        """
        with self._changing:
            base, start, goal = self.base, _pose(self._start), _pose(self._goal)
            obstacles = {i: _pose(handle) for i, handle in enumerate(self.handles)}
        return base.moved(start, goal, obstacles)

    def end(self) -> None:
        """Change no handle any more, as they are about to be removed: one may be dragged until then."""
        with self._changing:
            self._ended = True

    def show(self, answer: Answer) -> None:
        """Show the path and which constraint is tight."""
        colour = CERTIFIED if answer.camera_alone else _COLOURS[answer.verdict]
        self._path.show(answer.places(_PLACES), colour)
        worst = answer.worst
        self._worst.visible = self._label.visible = worst is not None
        if worst is not None:
            self._worst.points = worst.line[None].astype(np.float32)
            self._worst.colors = np.array(VIOLATED if worst.violated else SEARCHING, dtype=np.uint8)
            self._label.position = np.add(worst.line.mean(axis=0), [0.0, 0.0, 0.14 * self._size])
            self._label.text = worst.words

    def show_arm(self, joints: FloatArray) -> None:
        """Put the arm into these joints (n,) [rad]."""
        if self._poses is None:
            return
        with self._posing:
            places, quaternions = self._poses.at(joints)
        for body, frame in self._frames.items():
            frame.position, frame.wxyz = places[body], quaternions[body]

    def show_camera(self, pose: RigidTransform) -> None:
        """Put the camera with its field of view to a place in the world."""
        _place(self._camera_frame, pose)

    def show_handles(self, *, visible: bool) -> None:
        """Show what things are dragged by, or hide it."""
        if visible != self._handles_shown:
            self._handles_shown = visible
            self.show_arrows_of(None)

    def show_arrows_of(self, dragged: Any) -> None:
        """Show the arrows of one handle alone, as each takes time in every frame; None: of all."""
        with self._changing:
            if self._ended:
                return
            turn_nothing = [_turns_nothing(obstacle) for obstacle in self._obstacles]
            all_handles = (self._start, self._goal, *self.handles)
            for handle, fixed in zip(all_handles, (False, False, *turn_nothing), strict=True):
                shown = self._handles_shown and (dragged is None or dragged is handle)
                handle.disable_axes = not shown
                handle.disable_rotations = fixed or not shown

    def show_executed(self, places: FloatArray) -> None:
        """Draw the way (k, 3) that a run took [m], and a frustum for where its plan has the camera."""
        scene = self._server.scene
        scene.add_spline_catmull_rom("/executed", places, thickness=0.008 * self._size, color=EXECUTED)
        self._planned = scene.add_camera_frustum(
            "/planned", 1.2, 1.4, scale=0.12 * self._size, thickness=0.008 * self._size, color=CERTIFIED
        )

    def show_planned(self, pose: RigidTransform | None) -> None:
        """Put that frustum where the plan has the camera; None: hide it."""
        if self._planned is not None:
            self._planned.visible = pose is not None
            if pose is not None:
                _place(self._planned, pose)

    def _add_world(self, situation: Situation) -> None:
        """Draw arm, target and what stands still; the planner's obstacles have their own nodes."""
        arm = situation.arm
        if arm is None:
            return
        world = World(arm.scene)
        self._poses = BodyPoses(world)
        places, quaternions = self._poses.at(arm.scene.start_joints)
        moving = set(np.flatnonzero(world.model.body_weldid).tolist())
        shapes: dict[int | None, list[tuple[trimesh.Trimesh, Colour]]] = {}
        for mesh in body_meshes(world):
            shape = trimesh.Trimesh(mesh.vertices, mesh.faces)
            if mesh.body not in moving:
                pose = RigidTransform.from_components(places[mesh.body], _turn(quaternions[mesh.body]))
                shape.apply_transform(pose.as_matrix())
            shapes.setdefault(mesh.body if mesh.body in moving else None, []).append((shape, mesh.colour))
        for body, parts in shapes.items():
            turn = Rotation.identity() if body is None else _turn(quaternions[body])
            name = "still" if body is None else str(body)
            node = self._server.scene.add_glb(f"/world/{name}", lit_triangles(parts, turn))
            if body is not None:
                self._frames[body] = node
        for panel in arm.scene.panels:
            picture = np.repeat((255.0 * panel.picture ** (1 / 2.2)).astype(np.uint8)[..., None], 3, axis=2)
            face = panel.world_T_panel * RigidTransform.from_translation([0.0, 0.0, -1e-3])
            self._server.scene.add_image(
                f"/world/panels/{panel.name}", picture, *panel.size.tolist(), format="jpeg",
                position=face.translation, wxyz=_wxyz(face.rotation),
            )  # fmt: skip

    def _end_handle(self, name: str, colour: Colour, pose: RigidTransform) -> Any:
        node = f"/handles/{next(_NUMBERS)}"
        handle = self._server.scene.add_transform_controls(
            node, scale=0.22 * self._size, line_width=2.0, depth_test=False,
            disable_sliders=True, position=pose.translation, wxyz=_wxyz(pose.rotation),
        )  # fmt: skip
        self._server.scene.add_camera_frustum(
            f"{node}/frustum",
            1.2,
            1.4,
            scale=0.09 * self._size,
            color=colour,
            **_pixels(2.0),
        )
        self._server.scene.add_label(f"{node}/label", name, anchor="top-center")
        handle.on_update(self._on_drag)
        return handle

    def _obstacle_handle(self, label: str, obstacle: Obstacle, pose: RigidTransform) -> Any:
        name = f"/handles/{next(_NUMBERS)}"
        handle = self._server.scene.add_transform_controls(
            name, scale=0.28 * self._size, line_width=2.0, depth_test=False, disable_sliders=True,
            disable_rotations=_turns_nothing(obstacle), position=pose.translation, wxyz=_wxyz(pose.rotation),
        )  # fmt: skip
        self._draw_obstacle(f"{name}/body", obstacle, pose.rotation)
        self._server.scene.add_label(f"{name}/label", label, anchor="top-center", font_screen_scale=0.8)
        handle.on_update(self._on_drag)
        return handle

    def _draw_obstacle(self, name: str, obstacle: Obstacle, world_R_own: Rotation) -> None:
        """Draw it in its own frame, lit as it stands in the world now."""
        scene = self._server.scene
        own = obstacle_pose(obstacle).inv()
        if isinstance(obstacle, Cloud):
            some = obstacle.points[:: 1 + len(obstacle.points) // _MOST_SHOWN]
            size = max(2.0 * obstacle.radius, 0.01 * self._size)
            scene.add_point_cloud(
                name, own.apply(some).astype(np.float32), _OBSTACLE, point_size=size, point_shape="circle"
            )
            return
        (solid,) = solids_of((replace(obstacle, motion=None),), own)
        least = 0.02 * self._size if solid.kind == "sphere" else 0.0
        shape = solid_triangles(solid.kind, np.maximum(solid.size, least), solid.vertices)
        shape.apply_transform(solid.pose.as_matrix())
        opacity = 0.35 if isinstance(obstacle, HalfSpace) else 1.0
        scene.add_glb(name, lit_triangles([(shape, _OBSTACLE)], world_R_own, opacity))

    async def _on_drag(self, event: Any) -> None:
        """Async: gestures keep their order; nothing is planned on the server's loop."""
        if event.phase in ("start", "end"):
            self.show_arrows_of(event.target if event.phase == "start" else None)
        self._dragged()

    def _lowest(self, situation: Situation) -> float:
        problem = situation.problem
        places = np.vstack([problem.points, np.zeros(3), problem.initial_T_goal.translation])
        return float(situation.world_T_initial.apply(places)[:, 2].min()) - 0.3 * self._size

    def _look_at(self, situation: Situation) -> None:
        """Have every window show path and target from the side."""
        problem = situation.problem
        centre = situation.world_T_initial.apply(problem.points.mean(axis=0))
        between = 0.5 * (situation.world_T_initial.translation + situation.world_T_goal.translation)
        ahead = centre - between
        focus = between + 0.35 * ahead
        side = np.cross(ahead, [0.0, 0.0, 1.0])
        if np.linalg.norm(side) < _STRAIGHT * np.linalg.norm(ahead):  # it looks up or down
            side = np.array([1.0, 0.0, 0.0])
        side = side / np.linalg.norm(side)
        eye = focus + self._size * (2.0 * side + np.array([0.0, 0.0, 1.1])) - 1.1 * ahead
        camera = self._server.initial_camera
        camera.up, camera.position, camera.look_at = (0.0, 0.0, 1.0), tuple(eye), tuple(focus)
        for client in self._server.get_clients().values():
            client.camera.position = tuple(eye)  # first: it takes the place along that is looked at
            client.camera.look_at = tuple(focus)


def _pixels(thickness: float) -> dict[str, Any]:
    return {"thickness": thickness, "thickness_units": "screen"}


def _turns_nothing(obstacle: Obstacle) -> bool:
    return hasattr(obstacle, "center") and not hasattr(obstacle, "quaternion")


def _place(handle: Any, pose: RigidTransform) -> None:
    handle.position, handle.wxyz = pose.translation, _wxyz(pose.rotation)


def _pose(handle: Any) -> RigidTransform:
    return RigidTransform.from_components(np.asarray(handle.position, dtype=np.float64), _turn(handle.wxyz))


def _turn(wxyz: Any) -> Rotation:
    return Rotation.from_quat(np.asarray(wxyz, dtype=np.float64), scalar_first=True)


def _wxyz(rotation: Rotation) -> FloatArray:
    return rotation.as_quat(scalar_first=True)
