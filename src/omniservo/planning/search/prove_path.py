"""The proof of a whole path at once: every family, cheapest first."""

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel
from omniservo.geometry.polynomial import bernstein_from_power, magnitude
from omniservo.geometry.subdivision import PROVEN
from omniservo.planning.bernstein_path import ROTATION_FLOOR, camera_controls, camera_count, squares
from omniservo.planning.constraints.cloud import prove_clouds_clear
from omniservo.planning.constraints.cloud_sight import prove_unclouded
from omniservo.planning.constraints.collision import prove_collision_free
from omniservo.planning.constraints.demands import Demands
from omniservo.planning.constraints.free_side import prove_free_sides
from omniservo.planning.constraints.image_mask import prove_outside_masks
from omniservo.planning.constraints.least_distance import prove_least_distance
from omniservo.planning.constraints.occlusion import prove_unoccluded
from omniservo.planning.constraints.rotation import prove_rotation
from omniservo.planning.constraints.separation import prove_bodies_clear
from omniservo.planning.constraints.visibility import prove_visible
from omniservo.planning.constraints.workspace import prove_workspace


@kernel
def prove_path(demands: Demands, rotation: FloatArray, translation: FloatArray) -> tuple[int, float]:
    """Decide every constraint of ``demands`` for the path given by powers (4, σ+1), (3, τ+1).

    Returns PROVEN, or REFUTED or UNDECIDED by the first constraint that is not proven, with its w.
    """
    square, raised = squares(translation)
    size = magnitude(translation)
    status, w = prove_collision_free(square, raised, size, demands.obstacles)
    if status != PROVEN:
        return status, w
    controls, errors = camera_controls(rotation, translation, demands.points)
    count = float(camera_count(rotation.shape[1] - 1, translation.shape[1] - 1))
    status, w, _, _ = prove_visible(controls, errors, count, demands.limits, demands.disc)
    if status != PROVEN:
        return status, w
    status, w, _ = prove_outside_masks(controls, errors, count, demands.mask_edges, demands.mask_firsts)
    if status != PROVEN:
        return status, w
    status, w, _ = prove_least_distance(square, raised, size, demands.points, demands.numbers[0])
    if status != PROVEN:
        return status, w
    centre = bernstein_from_power(translation)
    status, w = prove_workspace(centre, size, demands.box)
    if status != PROVEN:
        return status, w
    if demands.planes.shape[0] > 0:
        status, w = prove_free_sides(centre, translation, size, demands.planes, demands.motions)
        if status != PROVEN:
            return status, w
    if demands.bodies.shape[0] > 0:
        hidden = demands.points if demands.numbers[1] > 0.0 else demands.points[:0]
        bodies, hulls, motions = demands.bodies, demands.hulls, demands.motions
        status, w = prove_bodies_clear(centre, translation, size, bodies, hulls, motions, hidden)
        if status != PROVEN:
            return status, w
    if demands.numbers[1] > 0.0:
        status, w = prove_unoccluded(centre, size, demands.points, demands.obstacles)
        if status != PROVEN:
            return status, w
    if demands.clouds.shape[0] > 0:
        status, w = prove_clouds_clear(demands, translation, square, raised, size)
        if status != PROVEN:
            return status, w
        if demands.numbers[1] > 0.0:
            status, w = prove_unclouded(demands, translation, centre, size)
            if status != PROVEN:
                return status, w
    return prove_rotation(rotation, ROTATION_FLOOR)
