"""The camera's pose from one image of known points, refined from a good guess (perspective-n-point)."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform

from omniservo.cameras.conversion import unified_image
from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError
from omniservo.estimation.refinement.pose_refinement import pose_covariance, refine_pose_kernel
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import BoolArray, FloatArray, finite_array, owned, refuse_masked
from omniservo.geometry.quaternions import matrix_from_quaternion, quaternion_from_matrix


@with_field_docs
@dataclass(frozen=True, eq=False)
class PoseRefinement:
    """A pose that minimises the reprojection error in px, with its evidence."""

    reference_T_camera: RigidTransform | None
    """The refined pose; None where ``ok`` is False."""
    rms_px: float
    """Root mean square over the valid points of the distance between pixel and projection [px]."""
    covariance: FloatArray
    """(6, 6) of (translation in the reference frame [m], rotation vector applied on the right [rad]) for
    noise of σ² = Σr²/(2n − 6); NaN where ``ok`` is False."""
    ok: bool
    """False: fewer than four valid points, a guess that puts a point outside the camera's domain, points
    that do not determine a pose, or no convergence."""


def refine_pose(
    camera: CentralModel,
    points: npt.ArrayLike,
    pixels: npt.ArrayLike,
    reference_T_camera: RigidTransform,
    valid: npt.ArrayLike | None = None,
) -> PoseRefinement:
    """Return the pose that minimises Σ ‖π(Rᵀ(h − t)) − p‖² [px²], from the guess ``reference_T_camera``.

    Levenberg-Marquardt with analytic Jacobians; a local method, so the guess must lie in the basin: the
    pose of the previous control step does.

    Args:
        camera: the camera that saw ``pixels``; of any model (`UnifiedImage`).
        points: (n, 3) [m], the target in the reference frame.
        pixels: (n, 2) [px]; rows where ``valid`` is False are not read and may be NaN.
        reference_T_camera: the guess.
        valid: (n,) bool; None: all rows.

    Raises:
        InputError: wrong shapes, or a number that is not finite in a row that is valid.
    """
    model = finite_array("points", points, (None, 3))
    refuse_masked("valid", valid)
    use = np.ones(len(model), dtype=np.bool_) if valid is None else np.asarray(valid)
    if use.shape != (len(model),) or use.dtype != np.bool_:
        raise InputError(f"valid: {use.dtype} {use.shape} given; bool ({len(model)},) is needed")
    seen = np.asanyarray(pixels, dtype=np.float64)  # a masked array stays one, and is refused
    if seen.shape != (len(model), 2):
        raise InputError(f"pixels: shape {seen.shape} given; {(len(model), 2)} is needed")
    finite_array("pixels (valid rows)", seen[use], (None, 2))
    matrix, rms, covariance = refined_matrix(
        camera, model, np.asarray(seen), reference_T_camera.as_matrix(), use
    )
    # without SciPy's checks, which take longer than the refinement
    pose = None if matrix is None else RigidTransform(matrix, normalize=False)
    return PoseRefinement(pose, rms, owned(covariance), matrix is not None)


def refined_matrix(
    camera: CentralModel, model: FloatArray, pixels: FloatArray, guess: FloatArray, use: BoolArray
) -> tuple[FloatArray | None, float, FloatArray]:
    """Return what `refine_pose` does of checked arguments: pose (4, 4) or None, rms [px], covariance."""
    image = unified_image(camera)
    seen, use = image.kept(pixels, use)
    seen, parameters = np.ascontiguousarray(seen, dtype=np.float64), image.camera.parameters
    quaternion = quaternion_from_matrix(np.ascontiguousarray(guess[:3, :3]))
    translation = np.ascontiguousarray(guess[:3, 3])
    quaternion, translation, rms, ok = refine_pose_kernel(
        parameters, model, seen, use, quaternion, translation
    )
    covariance = np.full((6, 6), math.nan)
    if ok:
        ok = pose_covariance(parameters, model, seen, use, quaternion, translation, 0.0, covariance)
    return _matrix(quaternion, translation) if ok else None, float(rms), covariance


def _matrix(quaternion: FloatArray, translation: FloatArray) -> FloatArray:
    """Return the pose (4, 4) of a unit quaternion."""
    rotation, matrix = np.empty((3, 3)), np.zeros((4, 4))
    x, y, z, w = quaternion.tolist()
    matrix_from_quaternion(x, y, z, w, rotation)
    matrix[:3, :3], matrix[:3, 3], matrix[3, 3] = rotation, translation, 1.0
    return matrix
