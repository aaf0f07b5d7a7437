"""The world: one MuJoCo model of arm, camera housing, boards, dots, panels, obstacles and floor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.robots import CAMERA_HOUSING, SHOWN_GROUP, ArmBodies
from omniservo.robots.collision.arm_bodies import MOUNTED
from omniservo.robots.collision.plain import PLAIN
from omniservo.scenes.panel import Panel
from omniservo.scenes.scene import BOARD_COLOUR, OBSTACLE_COLOUR, Ball, Colour, Dots, Scene, SceneBox

TICK = 0.001
"""Physics step [s]."""

SURROUNDINGS_GROUP = 0
"""MuJoCo geom group of everything that does not move."""

ARM_GROUP = SHOWN_GROUP
"""MuJoCo geom group of the arm's links as they are seen."""

CAMERA_GROUP = 2
"""MuJoCo geom group of the camera's housing, which the camera itself does not see."""

_FLOOR_COLOUR: Colour = (0.30, 0.31, 0.33)
_HOUSING_COLOUR: Colour = (0.07, 0.08, 0.10)
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear red, green, blue (Rec. 709)
_THICKNESS = 1e-5  # [m] of dots and panels: thinner than any pixel shows from the side

_DOT_KIND = mujoco.mjtGeom.mjGEOM_CYLINDER
"""only dots are cylinders among what does not move and cannot be touched"""

_CAMERA_SHAPE = "camera shape {}"

_FACING = 0.5  # cosine between normals that tells a panel's front from its sides and back


class World:
    """The scene as a MuJoCo model. Immutable after construction; every user makes its own MjData."""

    def __init__(self, scene: Scene) -> None:
        """Build the model.

        Args:
            scene: what stands in the world; body names in contacts are its boxes' and balls' names, the
                arm's link names, ``camera`` and ``floor``.
        """
        self.scene = scene
        spec = scene.arm.spec()
        spec.option.timestep = TICK
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        _put_base(spec, scene.world_T_base)
        link_T_camera = scene.arm.link_T_flange * scene.flange_T_camera
        _add_camera(spec, spec.body(scene.arm.flange_link), link_T_camera)
        _let_camera_touch_wrist(spec, scene)
        for body in scene.bodies:
            _add_body(spec, body)
        _add_solids(spec, scene)
        if scene.dots is not None:
            _add_dots(spec, scene.dots)
        for panel in scene.panels:
            _add_panel(spec, panel)
        if scene.floor is not None:
            floor = spec.worldbody.add_body(name="floor", pos=[0.0, 0.0, scene.floor])
            plane = floor.add_geom(PLAIN, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 0.1])
            _paint(plane, _FLOOR_COLOUR)
        self.model: Any = spec.compile()
        self.luminance: FloatArray = self.model.geom_rgba[:, :3].astype(np.float64) @ _LUMINANCE
        """(geoms,) linear grey of each geom, in [0, 1]."""
        is_arms = (self.model.geom_group != SURROUNDINGS_GROUP) & (self.model.geom_contype != 0)
        self.arm_geoms: IntArray = np.flatnonzero(is_arms)
        """geoms of the arm's links and the camera's housing that can be touched"""
        still = self.model.geom_group == SURROUNDINGS_GROUP
        is_dots = still & (self.model.geom_type == _DOT_KIND) & (self.model.geom_contype == 0)
        self.dot_geoms: IntArray = np.flatnonzero(is_dots)
        """geoms of the target's dots"""
        self._panel_of_geom = _panel_of_geom(self.model, scene.panels)
        self._panel_faces = np.array([p.world_T_panel.rotation.apply([0.0, 0.0, -1.0]) for p in scene.panels])
        obstacles = {body.name for body in (*scene.obstacles, *scene.solids)}
        owners = [self.body_of(geom) for geom in range(self.model.ngeom)]
        self.obstacle_geoms: IntArray = np.flatnonzero([owner in obstacles for owner in owners])
        """geoms of the scene's obstacles"""
        self._camera_body = int(self.model.body("camera").id)

    def body_of(self, geom: int) -> str:
        """Return the name of the body that a geom belongs to; empty for the dots."""
        return str(self.model.body(int(self.model.geom_bodyid[geom])).name)

    def panels_at(self, geoms: NDArray[np.int32], normals: FloatArray) -> IntArray:
        """Return whose image each ray meets: indices (n,) into the scene's panels, −1 for no image.

        Args:
            geoms: (n,) as `RayCaster.cast` returns them.
            normals: (n, 3) of the surfaces there; a panel's back and sides bear no image.
        """
        panels = self._panel_of_geom[geoms]
        met = np.flatnonzero(panels >= 0)
        facing = np.einsum("ij,ij->i", normals[met], self._panel_faces[panels[met]]) if len(met) else met
        panels[met[facing < _FACING]] = -1
        return panels

    def data_at(self, q: FloatArray) -> Any:
        """Return new MjData with the arm at rest in the joints ``q`` (n,) [rad], all positions computed."""
        data = mujoco.MjData(self.model)
        data.qpos[:] = q
        mujoco.mj_forward(self.model, data)
        return data

    def world_T_camera(self, data: Any) -> RigidTransform:
        """Return the camera's pose in ``data`` (whose kinematics are up to date)."""
        return RigidTransform.from_components(
            data.xpos[self._camera_body].copy(),
            Rotation.from_matrix(data.xmat[self._camera_body].reshape(3, 3)),
        )

    def touching(self, data: Any) -> set[tuple[str, str]]:
        """Return the pairs of bodies, each pair sorted by name, that touch or penetrate in ``data``."""
        if data.ncon == 0:
            return set()
        contacts = data.contact
        pairs = contacts.geom[contacts.dist <= 0.0]
        return {_sorted_pair(self.body_of(first), self.body_of(second)) for first, second in pairs}

    def arm_obstacle_distance(self, data: Any, farthest: float = 1.0) -> float:
        """Return the smallest distance from arm or camera housing to any obstacle [m].

        Negative: depth of the penetration. ``farthest`` where nothing is nearer, or without obstacles.
        """
        nearest = farthest
        for arm in self.arm_geoms:
            for obstacle in self.obstacle_geoms:
                distance = mujoco.mj_geomDistance(self.model, data, int(arm), int(obstacle), nearest, None)
                nearest = min(nearest, float(distance))
        return nearest


def _put_base(spec: Any, world_T_base: RigidTransform) -> None:
    """Move everything that is there, the arm, from the world's origin to its place."""
    held = (*spec.worldbody.frames, *spec.worldbody.bodies, *spec.worldbody.sites)
    foot = spec.worldbody.add_frame(
        pos=world_T_base.translation, quat=_mujoco_quaternion(world_T_base.rotation)
    )
    for element in held:
        if element.frame is None:
            element.set_frame(foot)


def _add_camera(spec: Any, link: Any, pose: RigidTransform) -> None:
    camera = link.add_body(
        name="camera", pos=pose.translation, quat=_mujoco_quaternion(pose.rotation), gravcomp=1.0
    )
    for number, solid in enumerate(CAMERA_HOUSING):
        geom = solid.add_to(spec, camera)
        geom.name = _CAMERA_SHAPE.format(number)
        geom.mass = 0.15
        _paint(geom, _HOUSING_COLOUR, CAMERA_GROUP)


def _let_camera_touch_wrist(spec: Any, scene: Scene) -> None:
    """State the camera's contacts with the link before the last joint, which MuJoCo itself leaves out."""
    bodies = ArmBodies(
        scene.arm, mounted=tuple(solid.moved(scene.flange_T_camera) for solid in CAMERA_HOUSING)
    )
    camera = bodies.shapes_of(MOUNTED).tolist()
    for first, second in bodies.pairs.tolist():
        if second in camera and bodies.shapes.carried[first] == scene.arm.dof - 1:
            name = _CAMERA_SHAPE.format(camera.index(second))
            spec.add_pair(geomname1=bodies.model.geom(first).name, geomname2=name)


def _add_body(spec: Any, body: SceneBox | Ball) -> None:
    if isinstance(body, SceneBox):
        pose, kind, size = body.world_T_box, mujoco.mjtGeom.mjGEOM_BOX, body.half_extents
    else:
        pose = RigidTransform.from_translation(body.center)
        kind, size = mujoco.mjtGeom.mjGEOM_SPHERE, np.array([body.radius, 0.0, 0.0])
    holder = spec.worldbody.add_body(
        name=body.name, pos=pose.translation, quat=_mujoco_quaternion(pose.rotation)
    )
    _paint(holder.add_geom(PLAIN, type=kind, size=size), body.colour)


def _add_solids(spec: Any, scene: Scene) -> None:
    names = dict.fromkeys(solid.name for solid in scene.solids)
    holders = {name: spec.worldbody.add_body(name=name) for name in names}
    for solid in scene.solids:
        _paint(solid.add_to(spec, holders[solid.name]), OBSTACLE_COLOUR)


def _add_dots(spec: Any, dots: Dots) -> None:
    """Each dot is a cylinder whose upper face's centre is the dot's centre; one nameless body has all."""
    holder = spec.worldbody.add_body()  # rays are not tried on the shapes of a body that they miss
    for center, normal in zip(dots.centers, dots.normals, strict=True):
        geom = holder.add_geom(
            PLAIN,
            type=_DOT_KIND,
            fromto=[*center, *(center - _THICKNESS * normal)],
            size=[dots.radius, 0.0, 0.0],
            contype=0,
            conaffinity=0,
        )
        _paint(geom, dots.colour)


def _add_panel(spec: Any, panel: Panel) -> None:
    """A thin block whose front is the panel's face."""
    pose = panel.world_T_panel * RigidTransform.from_translation([0.0, 0.0, _THICKNESS / 2])
    holder = spec.worldbody.add_body(
        name=panel.name, pos=pose.translation, quat=_mujoco_quaternion(pose.rotation)
    )
    geom = holder.add_geom(
        PLAIN,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[*panel.size / 2, _THICKNESS / 2],
        contype=0,
        conaffinity=0,
    )
    _paint(geom, BOARD_COLOUR)


def _panel_of_geom(model: Any, panels: Sequence[Panel]) -> IntArray:
    """(geoms + 1,) index of the panel that each geom is, else −1; the last entry answers for a ray's miss."""
    owner = np.full(model.ngeom + 1, -1, dtype=np.int64)
    for index, panel in enumerate(panels):
        owner[int(model.body(panel.name).geomadr[0])] = index
    return owner


def _paint(geom: Any, colour: Colour, group: int = SURROUNDINGS_GROUP) -> None:
    geom.rgba = [*colour, 1.0]
    geom.group = group


def _sorted_pair(first: str, second: str) -> tuple[str, str]:
    return (first, second) if first <= second else (second, first)


def _mujoco_quaternion(rotation: Rotation) -> FloatArray:
    """MuJoCo's quaternions are scalar-first."""
    return rotation.as_quat(scalar_first=True)
