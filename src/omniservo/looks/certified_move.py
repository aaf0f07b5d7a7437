"""Straight moves in joint space that are proven before they are made, for structures an estimate allows."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.cameras import UnifiedCamera
from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.adjoint import adjoint
from omniservo.geometry.arrays import FloatArray
from omniservo.planning import Degrees, Plan, PlanningProblem, widened_evenly
from omniservo.planning.judged_plan import judged_plan
from omniservo.risk.gap_slopes import gap_slopes
from omniservo.robots import ArmBodies, ArmClearance, JointPath, Tube, arm_clearance
from omniservo.robots.path_following.joint_segment import joint_segment
from omniservo.short_repr import short_repr
from omniservo.whole_arm import ArmSetting
from omniservo.whole_arm.joint_curves import camera_poses, path_near

FOLLOWED = 1e-3
"""[rad] Joints keep to the line as near as this; a move that does not is stopped."""

SIGMAS = 3.0
"""of the mount's error that a move has room for"""

_PLACES = 33


@with_field_docs
@dataclass(frozen=True, eq=False)
class CertifiedMove:
    """A straight line in joint space, and what is proven of it."""

    joints: JointPath
    clearance: ArmClearance
    """of all links and the camera's housing, for every w"""
    plan: Plan
    """of the camera: its path along the line, certified; its points are those of many samples"""

    __repr__ = short_repr

    @property
    def begin_T_end(self) -> RigidTransform:
        """Where the camera ends, in the frame where it begins, as the joints have it."""
        return self.plan.problem.initial_T_goal


def certified_move(
    asked: PlanningProblem,
    setting: ArmSetting,
    samples: FloatArray,
    ends: tuple[FloatArray, FloatArray],
    mount: FloatArray | None,
) -> CertifiedMove | str:
    """Return the straight move between joints ``ends`` (n,), or why it is none.

    Proven for every w: joint limits; the gaps of all bodies; lines of sight; the camera's constraints
    (`certify`) on a polynomial path, for all points of the samples. Room is left for what joints may be off
    the line (`FOLLOWED`), for what the mount may be off (`SIGMAS`) and for what the camera is off the
    polynomial.

    Args:
        asked: what to keep, in the frame of the camera as it stands; its points and goal do not count.
        setting: the arm as it stands; its tube, which is that of paths led by the image, does not count.
        samples: (k, 3) where points of the target may be [m].
        ends: from where the arm stands to where [rad].
        mount: (6, 6) covariance of the mount's error in the camera's frame; None: exact.
    """
    setting = replace(setting, tube=None)
    path = joint_segment(setting.arm, *ends, setting.flange_T_camera)
    reserve = float(path.limit_margins.min())
    if reserve < setting.limit_reserve + FOLLOWED:
        return f"a joint keeps {math.degrees(reserve):.2f} deg to the end of its range"
    bare = setting.bodies(asked.obstacles)
    tube, room = following_tube(bare, setting.flange_T_camera), 0.0
    plan = _camera_plan(asked, setting, samples, path, tube.position, mount)
    if isinstance(plan, str) or plan.status != "certified":
        return plan if isinstance(plan, str) else plan.reason
    if mount is not None:
        still, postures = RigidTransform.identity(), path(np.linspace(0.0, 1.0, _PLACES))
        slopes = np.concatenate([gap_slopes(setting, bare, still, q).by_mount for q in postures])
        variance = np.einsum("ki,ij,kj->k", slopes, mount, slopes)
        room = SIGMAS * math.sqrt(float(variance.max(initial=0.0)))
    following = replace(setting, tube=tube)
    found = arm_clearance(
        following.bodies(asked.obstacles),
        path,
        clearance=setting.clearance_around + room,
        self_clearance=setting.self_clearance,
        worst=False,
    )
    if found.status != "clear":
        return found.reason
    if asked.occlusion:
        sight = following.own_sight(path, setting.base_T_initial.apply(samples))
        if sight.status == "hidden":
            return f"a point is hidden: {sight.reason}"
    return CertifiedMove(path, found, plan)


def following_tube(bodies: ArmBodies, flange_T_camera: RigidTransform) -> Tube:
    """Return how far every part may be beside a line in joint space that joints keep to within `FOLLOWED`.

    From joint j's axis a shape, or the camera's centre, is no farther than the links from there to its own
    joint are long, and it from that one. A pair of links loses what the joints between them make of it.
    """
    shapes, anchors, dof = bodies.shapes, bodies.arm.chain.anchors, bodies.arm.dof
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(anchors, axis=0), axis=1)))
    moves = np.zeros((len(shapes.carried), len(anchors) + 1))
    for shape in np.flatnonzero(shapes.carried > 0).tolist():
        last = int(shapes.carried[shape]) - 1
        beyond = float(np.linalg.norm(shapes.places[shape] - anchors[last]) + shapes.radii[shape])
        turning = np.arange(last + 1 - int(shapes.spins[shape]))
        reach = FOLLOWED * (along[last] - along[turning] + beyond)
        moves[shape, turning] = np.cumsum(reach[::-1])[::-1]
    links = dict.fromkeys(bodies.tube_parts, 0.0)
    for shape, carried in enumerate(shapes.carried.tolist()):
        if carried and (name := bodies.owner(shape)) in links:
            links[name] = max(links[name], float(moves[shape, 0]))
    for pair in bodies.own_pairs.tolist():
        part, shape = bodies.part_of(pair), bodies.pairs[pair, 1]
        links[part] = max(links[part], float(moves[shape, shapes.first_between[pair]]))
    centre = (bodies.arm.base_T_flange(np.zeros(dof)) * flange_T_camera).translation
    position = FOLLOWED * float(np.sum(along[-1] - along + np.linalg.norm(centre - anchors[-1])))
    return Tube(np.full(dof, FOLLOWED), links, position, image=0.0, singular_value=0.0, share=0.0)


def mount_room(begin_T_end: RigidTransform, mount: FloatArray | None, distance: float) -> float:
    """Return how far what stands still may be from where the joints have it in the other camera frame [m].

    To first order (I − Ad(T⁻¹)) ξ with the mount's error ξ, `SIGMAS` of it, up to ``distance`` [m] away.
    """
    if mount is None:
        return 0.0
    slope = np.eye(6) - adjoint(begin_T_end.inv())
    spread = slope @ mount @ slope.T
    return SIGMAS * (math.sqrt(np.trace(spread[:3, :3])) + distance * math.sqrt(np.trace(spread[3:, 3:])))


def _camera_plan(
    asked: PlanningProblem,
    setting: ArmSetting,
    samples: FloatArray,
    path: JointPath,
    followed: float,
    mount: FloatArray | None,
) -> Plan | str:
    """Return the camera's path along a line in joint space as a plan, judged; or why it cannot be one."""
    begin, places = time.perf_counter(), np.linspace(0.0, 1.0, _PLACES)
    joints = path(places)
    poses = camera_poses(setting, joints)
    end = poses[-1]
    away = np.linalg.norm(samples, axis=1)
    try:
        problem = replace(
            asked, points=samples, initial_T_goal=end, degrees=Degrees(3, 3), initial_velocity=None
        )
        near = path_near(problem, setting, joints)
        gaps = near(places).inv() * poses
        off = 2.0 * float(np.linalg.norm(gaps.translation, axis=1).max())
        off += followed + mount_room(end, mount, float(away.max()))
        turned = 2.0 * float(gaps.rotation.magnitude().max()) + setting.arm.dof * FOLLOWED
        back = poses.inv().as_matrix()
        seen = (samples @ back[:, :3, :3].mT + back[:, None, :3, 3]).reshape(-1, 3)
        pixels = _image_room(problem.camera, seen, turned, off)
        return judged_plan(widened_evenly(problem, off, pixels), near, begin, "certified", "")
    except InputError as error:
        return str(error)


def _image_room(camera: UnifiedCamera, seen: FloatArray, turned: float, off: float) -> float:
    """Return how far pixels are off [px], to first order, where a camera is ``turned`` [rad] and ``off`` [m].

    Points ``seen`` (k, 3), in its frame, are off by ‖c‖ turned + off; pixels by the largest singular value of
    ∂pixel/∂c as much. Those that have no pixel do not count.
    """
    _, slopes, valid = camera.project_jacobian(seen)
    of_u, of_v = slopes[valid, 0], slopes[valid, 1]
    uu, uv, vv = ((a * b).sum(axis=1) for a, b in ((of_u, of_u), (of_u, of_v), (of_v, of_v)))
    steepest = np.sqrt(0.5 * (uu + vv + np.hypot(uu - vv, 2.0 * uv)))
    gone = np.linalg.norm(seen[valid], axis=1) * turned + off
    return float((steepest * gone).max(initial=0.0))
