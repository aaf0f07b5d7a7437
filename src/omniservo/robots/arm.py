"""The arm: forward and inverse kinematics, Jacobians and limits, read from an MJCF file."""

from __future__ import annotations

import itertools
from pathlib import Path

import mujoco
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import InputError, JointLimit
from omniservo.geometry.arrays import FloatArray, finite_array, frozen
from omniservo.robots.wrist_geometry import WristGeometry

SINGULAR_VALUE = 0.02
"""Smallest singular value of the camera Jacobian (linear rows over `LENGTH_SCALE`) that is still inverted.

On the RX60 a wrist with q5 = 2…3° is about there."""

LENGTH_SCALE = 0.3
"""Weighs metres against radians in the singularity test: about the length of one link [m]."""

_FLANGE = "flange"
_FORM = (2, 1, 1, 2, 1, 2)  # axes z y y z y z: shoulder, elbow, spherical wrist


class Arm:
    """A six-joint arm with a spherical wrist; the frames are ``base`` (its foot) and ``flange``.

    Kinematics run in MuJoCo on private data, so one Arm must not be used by two threads at once.
    """

    def __init__(self, mjcf: str | Path) -> None:
        """Read the arm from an MJCF file.

        Args:
            mjcf: path of the file. It names a body ``base``, a site ``flange``, and the numerics
                ``joint_speed_deg_s`` and ``joint_acceleration_deg_s2``.

        Raises:
            InputError: the file cannot be read, or the arm is of another form (axes z y y z y z at q = 0).
        """
        self.path = Path(mjcf)
        try:
            self._model = mujoco.MjModel.from_xml_path(str(self.path))
        except ValueError as error:
            raise InputError(f"arm {self.path}: {error}") from None
        self._data = mujoco.MjData(self._model)
        self._site = mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_SITE, _FLANGE)
        if self._site < 0:
            raise InputError(f"arm {self.path}: no site named {_FLANGE!r}")
        self.joint_names = tuple(self._model.joint(i).name for i in range(self._model.njnt))
        """Names of the joints, from the base outwards."""
        self.joint_range = frozen(self._model.jnt_range)
        """(n, 2) lowest and highest joint position [rad]."""
        self.joint_speed = frozen(np.deg2rad(self._numeric("joint_speed_deg_s")))
        """(n,) nominal speed [rad/s]."""
        self.joint_acceleration = frozen(np.deg2rad(self._numeric("joint_acceleration_deg_s2")))
        """(n,) largest acceleration that is commanded [rad/s²]."""
        self._jacobian = np.zeros((6, self.dof))
        self._geometry = self._read_geometry()

    @classmethod
    def rx60(cls) -> Arm:
        """Return the Stäubli RX60 that ships with the package (standard arm, reach 600 mm to the wrist)."""
        return cls(Path(__file__).with_name("rx60.xml"))

    @property
    def dof(self) -> int:
        """Number of joints n."""
        return int(self._model.nv)

    def base_T_flange(self, q: npt.ArrayLike) -> RigidTransform:
        """Return the flange's pose in the base frame for the joints ``q`` (n,) [rad].

        Raises:
            InputError: wrong shape, NaN or infinity. Limits are not checked (see `within_limits`).
        """
        self._move(q)
        matrix = self._data.site_xmat[self._site].reshape(3, 3)
        return RigidTransform.from_components(
            self._data.site_xpos[self._site].copy(), Rotation.from_matrix(matrix)
        )

    def flange_jacobian(self, q: npt.ArrayLike) -> FloatArray:
        """Return J (6, n): flange twist (linear [m/s], angular [rad/s], flange frame) = J q̇.

        Raises:
            InputError: wrong shape, NaN or infinity.
        """
        self._move(q)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_jacSite(self._model, self._data, self._jacobian[:3], self._jacobian[3:], self._site)
        flange_R_base = self._data.site_xmat[self._site].reshape(3, 3).T
        return np.concatenate([flange_R_base @ self._jacobian[:3], flange_R_base @ self._jacobian[3:]])

    def camera_jacobian(self, q: npt.ArrayLike, flange_T_camera: RigidTransform) -> FloatArray:
        """Return J (6, n): camera twist (linear [m/s], angular [rad/s], camera frame) = J q̇.

        With flange_T_camera = (R, t): v_c = Rᵀ(v_f + ω_f × t), ω_c = Rᵀ ω_f.

        Raises:
            InputError: wrong shape, NaN or infinity.
        """
        flange = self.flange_jacobian(q)
        camera_R_flange = flange_T_camera.rotation.as_matrix().T
        x, y, z = flange_T_camera.translation
        cross = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])  # ω × t = cross @ ω
        linear = camera_R_flange @ (flange[:3] + cross @ flange[3:])
        return np.concatenate([linear, camera_R_flange @ flange[3:]])

    def joint_velocities(
        self, q: npt.ArrayLike, camera_twist: npt.ArrayLike, flange_T_camera: RigidTransform
    ) -> FloatArray:
        """Return q̇ (n,) [rad/s] that moves the camera with the twist (6,) (linear, angular; camera frame).

        Raises:
            JointLimit: the arm is singular at ``q``: the smallest singular value of the camera Jacobian,
                linear rows divided by `LENGTH_SCALE`, is below `SINGULAR_VALUE`.
            InputError: wrong shape, NaN or infinity.
        """
        twist = finite_array("camera_twist", camera_twist, (6,)).copy()
        scaled = self.camera_jacobian(q, flange_T_camera)
        scaled[:3] /= LENGTH_SCALE
        twist[:3] /= LENGTH_SCALE
        left, values, right = np.linalg.svd(scaled)
        if values[-1] < SINGULAR_VALUE:
            raise JointLimit(
                f"the arm is singular: smallest singular value {values[-1]:.4f}; "
                f"at least {SINGULAR_VALUE:g} is needed"
            )
        velocities: FloatArray = right.T @ ((left.T @ twist) / values)
        return velocities

    def within_limits(self, q: npt.ArrayLike, reserve: float = 0.0) -> bool:
        """Return whether every joint (n,) [rad] keeps ``reserve`` [rad] to both ends of its range.

        Raises:
            InputError: wrong shape, NaN or infinity.
        """
        joints = finite_array("q", q, (self.dof,))
        low, high = self.joint_range.T
        return bool((joints >= low + reserve).all() and (joints <= high - reserve).all())

    def inverse(self, base_T_flange: RigidTransform) -> FloatArray:
        """Return every q (k, 6) [rad] within the limits that reaches the pose, sorted lexicographically.

        Full turns of joints 4 and 6 count as branches of their own where their range allows them. Where
        joints 4 and 6 are coaxial (sin q5 = 0) one representative with q4 = 0 is given.

        Raises:
            InputError: the pose is out of reach, or reached by no branch within the limits.
        """
        return self._branches(base_T_flange, 0.0)

    def inverse_near(self, base_T_flange: RigidTransform, q: npt.ArrayLike) -> FloatArray:
        """Return the branch (6,) [rad] of `inverse` whose largest joint motion from ``q`` is smallest.

        Where joints 4 and 6 are coaxial joint 4 stays where it is.

        Raises:
            InputError: the pose is out of reach; or ``q`` has a wrong shape, NaN or infinity.
        """
        near = finite_array("q", q, (self.dof,))
        branches = self._branches(base_T_flange, float(near[3]))
        nearest: FloatArray = branches[int(np.argmin(np.abs(branches - near).max(axis=1)))]
        return nearest

    def _branches(self, base_T_flange: RigidTransform, free_q4: float) -> FloatArray:
        rotation = base_T_flange.rotation.as_matrix()
        target = np.asarray(base_T_flange.translation, dtype=np.float64)
        found = self._geometry.solutions(rotation, target, free_q4)
        place = np.array2string(target, precision=4, separator=", ")
        if not len(found):
            raise InputError(f"flange pose at {place} m in the base frame: out of the arm's reach")
        turns = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=2))) * 2.0 * np.pi
        shifts = np.zeros((len(turns), 6))
        shifts[:, [3, 5]] = turns
        every = (found[:, None, :] + shifts[None]).reshape(-1, 6)
        low, high = self.joint_range.T
        legal = every[((every >= low) & (every <= high)).all(axis=1)]
        if not len(legal):
            raise InputError(
                f"flange pose at {place} m in the base frame: every branch leaves a joint's range"
            )
        ordered: FloatArray = legal[np.lexsort(legal.T[::-1])]
        return ordered

    def _move(self, q: npt.ArrayLike) -> None:
        self._data.qpos[:] = finite_array("q", q, (self.dof,))
        mujoco.mj_kinematics(self._model, self._data)

    def _numeric(self, name: str) -> FloatArray:
        try:
            values = self._model.numeric(name).data
        except KeyError:
            raise InputError(f"arm {self.path}: no numeric named {name!r}") from None
        return finite_array(f"arm {self.path}: {name}", values, (self.dof,))

    def _read_geometry(self) -> WristGeometry:
        self._move(np.zeros(self.dof))
        axes = np.eye(3)[list(_FORM)]
        if self.dof != 6 or not np.allclose(self._data.xaxis, axes, atol=1e-12):
            raise InputError(f"arm {self.path}: six joints with axes z y y z y z at q = 0 are needed")
        anchors = self._data.xanchor
        flange = self._data.site_xpos[self._site]
        lengths = WristGeometry(
            height=float(anchors[1, 2]),
            upper=float(anchors[2, 2] - anchors[1, 2]),
            offset=float(anchors[2, 1]),
            forearm=float(anchors[4, 2] - anchors[2, 2]),
            flange=float(flange[2] - anchors[4, 2]),
        )
        across = np.array([a[:2] for a in (*anchors, flange)])
        expected = np.array([[0, 0], [0, 0]] + [[0, lengths.offset]] * 5)
        if not np.allclose(across, expected, atol=1e-12):
            raise InputError(
                f"arm {self.path}: joints must lie on the z axis but for the elbow's offset along y"
            )
        return lengths
