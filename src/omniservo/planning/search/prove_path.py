"""The proof of a whole path at once: every family, cheapest first."""

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.held import held
from omniservo.geometry.kernel import kernel
from omniservo.geometry.subdivision import PROVEN
from omniservo.planning.bernstein_path import ROTATION_FLOOR, camera_controls, camera_count
from omniservo.planning.constraints.cloud import prove_clouds_clear
from omniservo.planning.constraints.cloud_sight import prove_unclouded
from omniservo.planning.constraints.collision import prove_collision_free
from omniservo.planning.constraints.constraints import Constraints
from omniservo.planning.constraints.free_side import prove_free_sides
from omniservo.planning.constraints.image_mask import prove_outside_masks
from omniservo.planning.constraints.least_distance import prove_least_distance
from omniservo.planning.constraints.occlusion import prove_unoccluded
from omniservo.planning.constraints.path_forms import path_forms
from omniservo.planning.constraints.rotation import prove_rotation
from omniservo.planning.constraints.separation import prove_bodies_clear
from omniservo.planning.constraints.visibility import prove_visible
from omniservo.planning.constraints.workspace import prove_workspace


@kernel
def prove_whole_path(
    constraints: Constraints, rotation: FloatArray, translation: FloatArray
) -> tuple[int, float]:
    """Do what `prove_path` does, called from Python."""
    return prove_path(held(constraints), rotation, translation)


@kernel
def prove_path(constraints: Constraints, rotation: FloatArray, translation: FloatArray) -> tuple[int, float]:
    """Decide every constraint of ``constraints`` for the path given by powers (4, σ+1), (3, τ+1).

    Returns PROVEN, or REFUTED or UNDECIDED by the first constraint that is not proven, with its w.
    """
    path = path_forms(rotation, translation)
    square, raised, size = path.square, path.raised, path.size
    status, w = prove_collision_free(square, raised, size, constraints.obstacles)
    if status != PROVEN:
        return status, w
    controls, errors = camera_controls(rotation, translation, constraints.points)
    count = float(camera_count(rotation.shape[1] - 1, translation.shape[1] - 1))
    status, w, _, _ = prove_visible(controls, errors, count, constraints.limits, constraints.disc)
    if status == PROVEN and constraints.mask_edges.shape[0] > 0:
        status, w, _ = prove_outside_masks(
            controls, errors, count, constraints.mask_edges, constraints.mask_firsts
        )
    if status != PROVEN:
        return status, w
    status, w, _ = prove_least_distance(square, raised, size, constraints.points, constraints.least_distance)
    if status != PROVEN:
        return status, w
    status, w = prove_workspace(path.centre, size, constraints.box)
    if status == PROVEN and constraints.planes.shape[0] > 0:
        status, w = prove_free_sides(constraints, path)
    if status == PROVEN and constraints.bodies.shape[0] > 0:
        status, w = prove_bodies_clear(constraints, path)
    if status == PROVEN and constraints.occlusion and constraints.obstacles.shape[0] > 0:
        status, w = prove_unoccluded(constraints, path)
    if status == PROVEN and constraints.clouds.shape[0] > 0:
        status, w = prove_clouds_clear(constraints, path)
        if status == PROVEN and constraints.occlusion:
            status, w = prove_unclouded(constraints, path)
    if status != PROVEN:
        return status, w
    return prove_rotation(rotation, ROTATION_FLOOR)
