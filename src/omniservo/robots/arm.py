"""The arm: forward and inverse kinematics, Jacobians and limits, read from an MJCF or URDF file."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError, JointLimit
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number, frozen
from omniservo.geometry.single_pose import single_pose
from omniservo.renamed import renamed_arguments, renamed_attribute
from omniservo.robots.arm_files import read_arm_file
from omniservo.robots.kinematics.chain import LENGTH_SCALE, SINGULAR_VALUE, Chain, locate, miss
from omniservo.robots.kinematics.numeric_inverse import STARTS, descend_all, solutions
from omniservo.robots.kinematics.parallel_geometry import ParallelGeometry
from omniservo.robots.kinematics.reach import farthest
from omniservo.robots.kinematics.twist_matrix import twist_matrix
from omniservo.robots.kinematics.wrist_geometry import WristGeometry
from omniservo.robots.link import Link, Shape

__all__ = ["LEAST_SINGULAR_VALUE", "LENGTH_SCALE", "SINGULAR_VALUE", "Arm"]

LEAST_SINGULAR_VALUE = 0.005
"""An arm that is led along planned joints is stopped below it. Plans keep `SINGULAR_VALUE`; noise leads arms
that start or end near it below that."""


class Arm:
    """A serial arm of six or seven revolute joints.

    Its frames are ``base`` (its foot: the world of its MJCF file, or the URDF's root link) and ``flange``
    (what carries the camera).
    """

    def __repr__(self) -> str:
        return f"Arm({self.name}, {self.dof} joints, flange {self.flange}, reaches {self.reach:.3g} m)"

    @renamed_arguments(tool="flange")
    def __init__(
        self,
        file: str | Path,
        *,
        flange: str | None = None,
        packages: Mapping[str, str | Path] | None = None,
    ) -> None:
        """Read the arm from an MJCF or URDF file, which need not be trusted.

        Args:
            file: its path. A URDF states limits and speeds of the arm's joints; an MJCF states ranges and,
                as custom numerics, ``joint_speed_deg_s`` and, if known, ``joint_acceleration_deg_s2``.
            flange: the site or link that is it; None: the one called ``tool0``, ``flange`` or
                ``attachment_site``, else the last link before a gripper's joints. Joints that do not carry it
                are held still, and listed in `notices`.
            packages: folders of ROS packages by name, where ``package://NAME/…`` finds meshes; others are
                looked for above and beside the file, in ROS_PACKAGE_PATH and in AMENT_PREFIX_PATH.

        Raises:
            InputError: the file cannot be read, or is no such arm; the message names file, element and what
                is legal.
        """
        self.path = Path(file)
        folders = {name: Path(folder).absolute() for name, folder in (packages or {}).items()}
        self._given, self._share = (self.path.absolute(), flange, folders), 1.0
        self._file = read_arm_file(self.path, flange, packages)
        self._model = self._file.model
        self.joint_names = tuple(self._model.joint(i).name for i in range(self._model.njnt))
        """Names of the joints, from the base outwards."""
        self.joint_range = frozen(self._model.jnt_range.copy())
        """(n, 2) lowest and highest joint position [rad]."""
        self.joint_speed = frozen(self._file.speed)
        """(n,) nominal speed [rad/s]."""
        self.joint_acceleration = frozen(self._file.acceleration)
        """(n,) largest acceleration that is commanded [rad/s²]."""
        self.joint_effort = self._read_effort()
        """(n,) largest torque [N m]; None where the file does not state it of every joint."""
        self.flange = self._file.flange
        """Name of the site or link that is the flange."""
        self.flange_link = self._file.flange_body
        """Name of the link that the flange is fixed to."""
        self.link_T_flange = self._file.body_T_flange
        """The flange in that link's frame."""
        self.notices = self._file.notices
        """What of the file was left out, put in or assumed."""
        self.chain = self._read_chain()
        """The same kinematics as arrays, for compiled code: not to be written to."""
        self._geometry = self._read_geometry()

    def __reduce__(self) -> tuple[object, tuple[object, ...]]:
        """Another process reads the file again."""
        return _read_again, (*self._given, self._share)

    tool = renamed_attribute("tool", "flange")
    tool_link = renamed_attribute("tool_link", "flange_link")

    @classmethod
    def rx60(cls) -> Arm:
        """Return the Stäubli RX60 that ships with the package (standard arm, reach 600 mm to the wrist)."""
        return cls(Path(__file__).parent / "shipped" / "rx60.xml")

    def slowed(self, share: float) -> Arm:
        """Return the same arm with its joints' speeds reduced to a share in (0, 1].

        Raises:
            InputError: a share that is not legal.
        """
        finite_number("share", share, above=0.0, maximum=1.0)
        return _read_again(*self._given, share * self._share)

    @property
    def name(self) -> str:
        """What the file calls the arm."""
        return str(self._file.spec.modelname)

    @property
    def dof(self) -> int:
        """Number of joints n."""
        return int(self._model.nv)

    @property
    def has_closed_form(self) -> bool:
        """Whether `inverse` is a formula and knows every branch; else it is a seeded numeric search."""
        return self._geometry is not None

    @cached_property
    def links(self) -> tuple[Link, ...]:
        """The links from the base outwards, with the bodies that can be touched."""
        model = self._model
        carriers = {int(model.jnt_bodyid[j]): str(model.joint(j).name) for j in range(model.njnt)}
        return tuple(
            Link(str(model.body(i).name), carriers.get(i, ""), tuple(self._shapes(i)))
            for i in range(1, model.nbody)
        )

    @cached_property
    def reach(self) -> float:
        """The farthest that the flange gets from the axis of the first joint [m]."""
        axis, foot = self.chain.axes[0], self.chain.anchors[0]

        def distance(q: FloatArray) -> tuple[float, FloatArray]:
            flange, jacobian = self._locate(q)
            arm = flange[:, 3] - foot
            arm = arm - (arm @ axis) * axis
            length = float(np.linalg.norm(arm))
            return length, arm @ (flange[:, :3] @ jacobian[:3]) / max(length, 1e-12)

        return farthest(distance, self.joint_range)

    def spec(self, *, seen: bool = True) -> Any:
        """Return a new MuJoCo MjSpec of the arm alone, with drives, to build a world around.

        Args:
            seen: with the shapes that are only seen: meshes of many triangles, with which every compilation
                takes several times as long.
        """
        return (self._file.spec if seen else self._file.touched_spec).copy()

    def base_T_flange(self, q: npt.ArrayLike) -> RigidTransform:
        """Return the flange's pose in the base frame for the joints ``q`` (n,) [rad].

        Raises:
            InputError: wrong shape, NaN or infinity. Limits are not checked (see `within_limits`).
        """
        pose = np.eye(4)
        pose[:3] = self._locate(q)[0]
        return RigidTransform(pose, normalize=False)  # it is a rotation but for rounding

    def locate(self, q: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return `base_T_flange` as axes and place (3, 4), and `flange_jacobian` (6, n): fast, for loops.

        Raises:
            InputError: wrong shape, NaN or infinity.
        """
        return self._locate(q)

    def flange_jacobian(self, q: npt.ArrayLike) -> FloatArray:
        """Return J (6, n): flange twist (linear [m/s], angular [rad/s], flange frame) = J q̇.

        Raises:
            InputError: wrong shape, NaN or infinity.
        """
        return self._locate(q)[1]

    def camera_jacobian(self, q: npt.ArrayLike, flange_T_camera: RigidTransform) -> FloatArray:
        """Return J (6, n): camera twist (linear [m/s], angular [rad/s], camera frame) = J q̇.

        Raises:
            InputError: wrong shape, NaN or infinity.
        """
        jacobian: FloatArray = twist_matrix(flange_T_camera) @ self.flange_jacobian(q)
        return jacobian

    def scaled_flange_jacobian(self, q: npt.ArrayLike) -> FloatArray:
        """Return `flange_jacobian` (6, n) with its linear rows over `LENGTH_SCALE`.

        Raises:
            InputError: wrong shape, NaN or infinity.
        """
        return self._locate(q, LENGTH_SCALE)[1]

    def scaled_camera_jacobian(self, q: npt.ArrayLike, flange_T_camera: RigidTransform) -> FloatArray:
        """Return `camera_jacobian` (6, n) with its linear rows over `LENGTH_SCALE`: as singularity is judged.

        Raises:
            InputError: wrong shape, NaN or infinity.
        """
        scaled = self.camera_jacobian(q, flange_T_camera)
        scaled[:3] /= LENGTH_SCALE
        return scaled

    def joint_velocities(
        self,
        q: npt.ArrayLike,
        camera_twist: npt.ArrayLike,
        flange_T_camera: RigidTransform,
        wish: npt.ArrayLike | None = None,
    ) -> FloatArray:
        """Return q̇ (n,) [rad/s] that moves the camera with the twist (6,) (linear, angular; camera frame).

        q̇ = J* twist + (I − J*J) wish, J = U diag(σ) Vᵀ the camera Jacobian with its linear rows divided by
        `LENGTH_SCALE`, J* = V diag(σ / max(σ, `SINGULAR_VALUE`)²) Uᵀ. Where no σ is below `SINGULAR_VALUE`
        J* is the pseudoinverse, so q̇ has the twist; of the many that do with seven joints, it is the nearest
        to ``wish`` (n,) [rad/s], or the smallest. Along a v of a smaller σ twist and wish are mixed, the
        twist with a share of (σ / `SINGULAR_VALUE`)².

        Raises:
            JointLimit: the arm is singular at ``q``: a σ is below `LEAST_SINGULAR_VALUE`, or, where there is
                no wish, below `SINGULAR_VALUE`.
            InputError: wrong shape, NaN or infinity.
        """
        twist = finite_array("camera_twist", camera_twist, (6,)).copy()
        scaled = self.scaled_camera_jacobian(q, flange_T_camera)
        twist[:3] /= LENGTH_SCALE
        left, values, right = np.linalg.svd(scaled, full_matrices=False)
        least = SINGULAR_VALUE if wish is None else LEAST_SINGULAR_VALUE
        if values[-1] < least:
            raise JointLimit(
                f"the arm is singular: smallest singular value {values[-1]:.4f}; at least {least:g} is needed"
            )
        inverted = values / np.maximum(values, SINGULAR_VALUE) ** 2
        velocities: FloatArray = right.T @ (inverted * (left.T @ twist))
        if wish is not None:
            wanted = finite_array("wish", wish, (self.dof,))
            velocities += wanted - right.T @ (inverted * values * (right @ wanted))
        return velocities

    def limit_margins(self, q: npt.ArrayLike) -> FloatArray:
        """Return each joint's room to the nearer end of its range at q (…, n): (…, n) [rad], < 0 outside.

        Raises:
            InputError: wrong shape, NaN or infinity.
        """
        low, high = self.joint_range.T
        joints = finite_array("q", q, (-1, self.dof))
        margins: FloatArray = np.minimum(joints - low, high - joints)
        return margins

    def within_limits(self, q: npt.ArrayLike, reserve: float = 0.0) -> bool:
        """Return whether every joint (n,) [rad] keeps ``reserve`` [rad] to both ends of its range.

        Raises:
            InputError: wrong shape, NaN or infinity.
        """
        return bool((self.limit_margins(finite_array("q", q, (self.dof,))) >= reserve).all())

    def inverse(self, base_T_flange: RigidTransform) -> FloatArray:
        """Return q (k, n) [rad] within the limits that reach the pose, sorted lexicographically.

        With a closed form (parallel shoulder and elbow axes and a spherical wrist, as the RX60; or axes 2, 3
        and 4 parallel, as the arms of Universal Robots) these are all branches: full turns of a joint count
        as branches of their own where its range allows them; where axes 4 and 6 are parallel (sin q5 = 0) one
        representative with the first q4, the second q6 as near to 0 as its range allows is given; where the
        wrist's centre is on axis 1, q1 is 0, or π. For other arms they are what a seeded numeric search
        finds, which may miss some; of seven joints they are samples of families.

        Raises:
            InputError: not one finite pose, out of reach, or reached by no branch within the limits.
        """
        if self._geometry is not None:
            return self._legal_branches(self._geometry, base_T_flange, np.zeros(6))
        found = solutions(self.chain, _single(base_T_flange))
        if not len(found):
            raise self._not_found(base_T_flange)
        ordered: FloatArray = found[np.lexsort(found.T[::-1])]
        return ordered

    def inverse_near(self, base_T_flange: RigidTransform, q: npt.ArrayLike) -> FloatArray:
        """Return joints (n,) [rad] that reach the pose, on the branch nearest to ``q``.

        With a closed form: the branch of `inverse` whose largest joint motion from ``q`` is smallest; where
        axes 4 and 6 are parallel joint 4 (RX60) or joint 6 (Universal Robots) stays where it is, or at the
        end of its range. For other arms: where a descent from ``q`` leads (least joint motion); only if that
        fails, the nearest of `inverse`.

        Raises:
            InputError: not one finite pose, or out of reach; or ``q`` has a wrong shape, NaN or infinity.
        """
        near = finite_array("q", q, (self.dof,))
        if self._geometry is not None:
            branches = self._legal_branches(self._geometry, base_T_flange, near)
        else:
            found = descend_all(self.chain, _single(base_T_flange), near[None])
            branches = found if len(found) else self.inverse(base_T_flange)
        nearest: FloatArray = branches[int(np.argmin(np.abs(branches - near).max(axis=1)))]
        return nearest

    def miss(self, q: FloatArray, goal: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the flange's twist (6,) from ``q`` (n,) to ``goal`` (4, 4), and its Jacobian (6, n).

        Both in the flange frame, linear rows divided by `LENGTH_SCALE`; to first order in the distance. The
        goal is not checked.

        Raises:
            InputError: ``q`` has a wrong shape, NaN or infinity.
        """
        twist, jacobian = np.empty(6), np.empty((6, self.dof))
        miss(self.chain, finite_array("q", q, (self.dof,)), np.array(goal), twist, jacobian)
        return twist, jacobian

    def branches(self, base_T_flange: RigidTransform) -> FloatArray:
        """Return q (k, n) [rad] that reach the pose, one of all that differ by full turns, sorted.

        With a closed form: all branches (k ≤ 8), whatever the limits say, each joint in (−π, π]. For other
        arms what `inverse` finds within the limits.

        Raises:
            InputError: not one finite pose, or out of reach.
        """
        if self._geometry is not None:
            found = self._solutions(self._geometry, base_T_flange, 0.0)
            ordered: FloatArray = found[np.lexsort(found.T[::-1])]
            return ordered
        kept: list[FloatArray] = []
        for q in self.inverse(base_T_flange):
            if all(np.abs(np.sin(0.5 * (q - other))).max() > 1e-6 for other in kept):
                kept.append(q)
        return np.array(kept)

    def _solutions(
        self, geometry: WristGeometry | ParallelGeometry, base_T_flange: RigidTransform, free: float
    ) -> FloatArray:
        pose = _single(base_T_flange)
        found = geometry.solutions(pose[:3, :3], pose[:3, 3], free)
        if not len(found):
            distance = float(np.linalg.norm(base_T_flange.translation))
            far = f", which is {self.reach:.3g} m" + (
                "; are all lengths in the unit that is stated, as units: {length: mm}?"
                if distance > _ANOTHER_UNIT * self.reach
                else ""
            )
            raise InputError(f"{_place(base_T_flange)}: out of the arm's reach{far}")
        return found

    def _legal_branches(
        self, geometry: WristGeometry | ParallelGeometry, base_T_flange: RigidTransform, near: FloatArray
    ) -> FloatArray:
        free = float(near.clip(*self.joint_range.T)[geometry.free_joint])
        found = self._solutions(geometry, base_T_flange, free)
        every = (found[:, None, :] + self._turns[None]).reshape(-1, 6)
        low, high = self.joint_range.T
        legal = every[((every >= low - _ROUNDED) & (every <= high + _ROUNDED)).all(axis=1)].clip(low, high)
        if not len(legal):
            raise InputError(f"{_place(base_T_flange)}: every branch leaves a joint's range")
        ordered: FloatArray = legal[np.lexsort(legal.T[::-1])]
        return ordered

    @cached_property
    def _turns(self) -> FloatArray:
        """(m, 6) shifts by full turns [rad] that lead from (−π, π] into the ranges."""
        whole = [
            2.0
            * np.pi
            * np.arange(np.ceil((low - np.pi) / (2 * np.pi)), np.floor((high + np.pi) / (2 * np.pi)) + 1)
            for low, high in self.joint_range
        ]
        return np.stack(np.meshgrid(*whole, indexing="ij"), axis=-1).reshape(-1, 6)

    def _not_found(self, base_T_flange: RigidTransform) -> InputError:
        distance = float(np.linalg.norm(base_T_flange.translation))
        return InputError(
            f"{_place(base_T_flange)}: no joints within their ranges found by {STARTS} seeded descents; the "
            f"place is {distance:.3f} m from the foot; the arm reaches {self.reach:.3f} m from its first axis"
        )

    def _locate(self, q: npt.ArrayLike, length: float = 1.0) -> tuple[FloatArray, FloatArray]:
        """Return axes and place (3, 4) of the flange in the base frame, and its Jacobian (6, n).

        The linear rows are over a ``length`` [m].
        """
        flange, jacobian = np.empty((3, 4)), np.empty((6, self.dof))
        locate(self.chain, finite_array("q", q, (self.dof,)), length, flange, jacobian)
        return flange, jacobian

    def _read_chain(self) -> Chain:
        model, data = self._model, mujoco.MjData(self._model)
        data.qpos[:] = 0.0
        mujoco.mj_kinematics(model, data)
        link = data.body(self.flange_link)
        base_T_link = np.column_stack([link.xmat.reshape(3, 3), link.xpos])
        tool = base_T_link[:, :3] @ self.link_T_flange.as_matrix()[:3]
        tool[:, 3] += base_T_link[:, 3]
        return Chain(data.xaxis.copy(), data.xanchor.copy(), tool, model.jnt_range.copy())

    def _read_effort(self) -> FloatArray | None:
        if not self._model.jnt_actfrclimited.all():
            return None
        return frozen(np.abs(self._model.jnt_actfrcrange).min(axis=1))

    def _read_geometry(self) -> WristGeometry | ParallelGeometry | None:
        axes, anchors, tool, _ = self.chain
        flange = np.concatenate([tool, [[0.0, 0.0, 0.0, 1.0]]])
        return WristGeometry.of(axes, anchors, flange) or ParallelGeometry.of(axes, anchors, flange)

    def _shapes(self, body: int) -> list[Shape]:
        model = self._model
        touched = np.flatnonzero((model.geom_bodyid == body) & (model.geom_contype != 0))
        names = [str(mujoco.mjtGeom(kind).name) for kind in model.geom_type[touched]]
        kinds = [name.removeprefix("mjGEOM_").lower() for name in names]
        extents = 2.0 * model.geom_aabb[touched, 3:]
        return [Shape(kind, tuple(size.tolist())) for kind, size in zip(kinds, extents, strict=True)]


_ROUNDED = 1e-9
"""[rad] by which joints that are found may leave their range: they stand at its end."""

_ANOTHER_UNIT = 5.0
"""A pose that many times farther off than the arm reaches is probably stated in another unit."""


def _single(base_T_flange: RigidTransform) -> FloatArray:
    """Return a pose (4, 4), checked."""
    return np.ascontiguousarray(single_pose("base_T_flange", base_T_flange).as_matrix())


def _place(base_T_flange: RigidTransform) -> str:
    place = np.array2string(np.asarray(base_T_flange.translation), precision=4, separator=", ")
    return f"flange pose at {place} m in the base frame"


def _read_again(file: Path, flange: str | None, packages: Mapping[str, Path], share: float) -> Arm:
    arm = Arm(file, flange=flange, packages=packages)
    arm._share = share
    arm.joint_speed = frozen(share * arm.joint_speed)
    return arm
