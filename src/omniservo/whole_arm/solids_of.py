"""The planner's obstacles as bodies around an arm."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import InputError
from omniservo.geometry.along import along
from omniservo.planning.obstacles.box import Box
from omniservo.planning.obstacles.capsule import Capsule
from omniservo.planning.obstacles.cloud import Cloud
from omniservo.planning.obstacles.cylinder import Cylinder
from omniservo.planning.obstacles.ellipsoid import Ellipsoid
from omniservo.planning.obstacles.half_space import HalfSpace
from omniservo.planning.obstacles.mesh import Mesh
from omniservo.planning.obstacles.obstacle import Body, Obstacle
from omniservo.planning.obstacles.sphere import Sphere
from omniservo.robots import Solid
from omniservo.robots.collision.solid import Kind


def solids_of(obstacles: Sequence[Obstacle], base_T_initial: RigidTransform) -> tuple[Solid, ...]:
    """Return the obstacles in the base frame, called as in a certificate: ``obstacle i``.

    A cloud becomes some hundred boxes of one name that hold all its balls (`cloud_boxes`), or balls where
    points stand alone.

    Args:
        obstacles: in the initial camera frame.
        base_T_initial: the initial camera in the arm's base frame.

    Raises:
        InputError: an obstacle that moves, which is not judged for the whole arm.
    """
    found: list[Solid] = []
    for i, obstacle in enumerate(obstacles):
        if obstacle.motion is not None:
            raise InputError(f"obstacle {i}: it moves; the whole arm is judged among what stands still")
        name = f"obstacle {i}"
        if isinstance(obstacle, Cloud):
            found += _solids_of_cloud(name, obstacle, base_T_initial)
        else:
            found.append(_solid(name, obstacle, base_T_initial))
    return tuple(found)


def _solids_of_cloud(name: str, cloud: Cloud, base_T_initial: RigidTransform) -> list[Solid]:
    boxes = cloud.boxes
    places = base_T_initial * RigidTransform.from_components(boxes.middles, Rotation.from_matrix(boxes.axes))
    return [
        Solid(name, "sphere", half[:1], place) if single else Solid(name, "box", half, place)
        for place, half, single in zip(places, boxes.half_extents, boxes.single, strict=True)
    ]


def _solid(name: str, obstacle: Body | HalfSpace, base_T_initial: RigidTransform) -> Solid:
    match obstacle:
        case Sphere():
            return Solid.sphere(name, base_T_initial.apply(np.array(obstacle.center)), obstacle.radius)
        case Box() | Ellipsoid():
            turn = Rotation.from_quat(np.array(obstacle.quaternion))
            pose = base_T_initial * RigidTransform.from_components(obstacle.center, turn)
            if isinstance(obstacle, Box):
                return Solid.box(name, pose, obstacle.half_extents)
            return Solid(name, "ellipsoid", obstacle.radii, pose)
        case Capsule() | Cylinder():
            axis = obstacle.end - obstacle.start
            middle = RigidTransform.from_components(0.5 * (obstacle.start + obstacle.end), along(axis))
            size = np.array([obstacle.radius, 0.5 * np.linalg.norm(axis)])
            kind: Kind = "capsule" if isinstance(obstacle, Capsule) else "cylinder"
            return Solid(name, kind, size, base_T_initial * middle)
        case HalfSpace():
            upright = base_T_initial.rotation.apply(np.array(obstacle.normal))
            height = float(obstacle.offset + base_T_initial.translation @ upright)
            return Solid.half_space(name, upright, height)
        case Mesh():
            return Solid(name, "hull", np.zeros(0), base_T_initial, obstacle.vertices)
