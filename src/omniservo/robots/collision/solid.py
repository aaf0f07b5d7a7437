"""A rigid convex body, or a half-space: what an arm carries, or must not touch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, Self

import mujoco
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.along import along
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number, frozen, frozen_again
from omniservo.geometry.quick_poses import composed
from omniservo.geometry.single_pose import single_pose
from omniservo.robots.collision.exact_vertices import add_hull
from omniservo.robots.collision.plain import PLAIN
from omniservo.short_repr import short_repr

Kind = Literal["sphere", "capsule", "cylinder", "box", "ellipsoid", "hull", "half_space"]

SIZES: dict[Kind, int] = {
    "sphere": 1,
    "capsule": 2,
    "cylinder": 2,
    "box": 3,
    "ellipsoid": 3,
    "hull": 0,
    "half_space": 0,
}

_FEWEST = 3
"""vertices of a hull, which may be flat"""

_NEAR_UNIT = 1e-6

_THINNEST = 1e-6
"""What is thinner is taken to be so thick [m]: MuJoCo knows no body without a size."""


@with_field_docs
@dataclass(frozen=True, eq=False)
class Solid:
    """A convex body in the frame that it is stated in.

    Raises:
        InputError: a size that is negative, not finite, or of another length than the kind has; a hull of
            fewer than 3 vertices.
    """

    name: str
    """what it is called in results"""
    kind: Kind
    size: FloatArray
    """sphere: radius. Capsule, cylinder: radius, half of the axis, which is z. Box: half extents. Ellipsoid:
    radii. Hull, and half-space, which is all of z ≤ 0: none. [m], read-only"""
    pose: RigidTransform
    """its own frame in that one"""
    vertices: FloatArray | None = None
    """(n, 3) of a hull [m], read-only; else None"""

    __repr__ = short_repr
    __setstate__ = frozen_again

    def __post_init__(self) -> None:
        if self.kind not in SIZES:
            raise InputError(f"kind: {self.kind!r} given; legal: {', '.join(SIZES)}")
        single_pose(f"{self.name}: pose", self.pose)
        size = finite_array(f"{self.name}: size", self.size, (SIZES[self.kind],))
        if (size < 0.0).any():
            raise InputError(f"{self.name}: size {size.tolist()} m given; legal: ≥ 0")
        object.__setattr__(self, "size", frozen(np.maximum(size, _THINNEST)))
        if (self.kind == "hull") != (self.vertices is not None):
            raise InputError(f"{self.name}: a hull has vertices, and nothing else has")
        if self.vertices is not None:
            corners = finite_array(f"{self.name}: vertices", self.vertices, (None, 3))
            if len(corners) < _FEWEST:
                raise InputError(f"{self.name}: {len(corners)} vertices given; legal: at least {_FEWEST}")
            object.__setattr__(self, "vertices", frozen(corners))

    @classmethod
    def sphere(cls, name: str, center: npt.ArrayLike, radius: float) -> Self:
        """Return the ball about a point (3,) [m]."""
        place = RigidTransform.from_translation(finite_array("center", center, (3,)))
        return cls(name, "sphere", np.array([radius]), place)

    @classmethod
    def box(cls, name: str, pose: RigidTransform, half_extents: npt.ArrayLike) -> Self:
        """Return the box of half extents (3,) [m] along the axes of ``pose``, about its origin."""
        return cls(name, "box", finite_array("half_extents", half_extents, (3,)), pose)

    @classmethod
    def half_space(cls, name: str, normal: npt.ArrayLike, offset: float) -> Self:
        """Return the solid normal·x ≤ offset [m], normal (3,) a unit vector: free is what it points to.

        Raises:
            InputError: a number that is not finite, or a normal whose length is not 1 within 1e-6.
        """
        upright = finite_array(f"{name}: normal", normal, (3,))
        length = float(np.linalg.norm(upright))
        if abs(length - 1.0) > _NEAR_UNIT:
            raise InputError(f"{name}: normal of length {length:g} given; legal: 1")
        height = finite_number(f"{name}: offset", offset)
        foot = RigidTransform.from_components(height * upright / length**2, along(upright))
        return cls(name, "half_space", np.zeros(0), foot)

    def moved(self, a_T_b: RigidTransform) -> Solid:
        """Return the same body, stated in frame b, in frame a."""
        return Solid(self.name, self.kind, self.size, composed(a_T_b, self.pose), self.vertices)

    @property
    def radius(self) -> float:
        """Of the ball about its own origin that holds it [m]; not of a hull or a half-space."""
        if self.kind in ("sphere", "capsule"):
            return float(self.size.sum())
        if self.kind == "ellipsoid":
            return float(self.size.max())
        return float(np.linalg.norm(self.size))

    @property
    def half_extents(self) -> FloatArray:
        """Of the box along its axes that holds it (3,) [m]; not of a hull or a half-space."""
        if self.kind in ("box", "ellipsoid"):
            return self.size
        across = float(self.size[0])
        half = across if self.kind == "sphere" else float(self.size[1])
        return np.array([across, across, half + across * (self.kind == "capsule")])

    @property
    def mujoco_size(self) -> tuple[float, float, float]:
        """The size as MuJoCo states it."""
        if self.kind == "half_space":
            return 0.0, 0.0, 1.0  # without end; the last one is how it is drawn
        first, second, third = [*self.size.tolist(), 0.0, 0.0, 0.0][:3]
        return first, second, third

    def add_to(self, spec: Any, body: Any) -> Any:
        """Add it to a MuJoCo body of ``spec``, in whose frame it is stated; return the new geom."""
        pose, quaternion = self.pose.as_matrix(), np.empty(4)
        mujoco.mju_mat2Quat(quaternion, pose[:3, :3].ravel())  # SciPy's takes longer than all the rest
        geom = body.add_geom(PLAIN, type=_GEOMS[self.kind], pos=pose[:3, 3], quat=quaternion)
        if self.vertices is None:
            geom.size = self.mujoco_size
        else:
            geom.meshname = f"hull of {self.name} {len(spec.meshes)}"
            add_hull(spec, geom.meshname, self.vertices)
        return geom


_GEOMS: dict[Kind, Any] = {
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "ellipsoid": mujoco.mjtGeom.mjGEOM_ELLIPSOID,
    "hull": mujoco.mjtGeom.mjGEOM_MESH,
    "half_space": mujoco.mjtGeom.mjGEOM_PLANE,
}
