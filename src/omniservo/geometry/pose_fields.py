"""A pose as files have it."""

from scipy.spatial.transform import RigidTransform


def pose_fields(pose: RigidTransform) -> dict[str, list[float]]:
    """Return the ``translation`` (3,) [m] and the ``quaternion`` (x, y, z, w), w ≥ 0, of a pose."""
    return {
        "translation": pose.translation.tolist(),
        "quaternion": pose.rotation.as_quat(canonical=True).tolist(),
    }
