"""Half-spaces as obstacles: the camera centre stays on the free side, n·(t − m) ≥ b + d, degree max(τ, k)."""

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, late, leaf
from omniservo.geometry.subdivision import PROVEN, prove_nonnegative
from omniservo.planning.constraints.constraints import Constraints
from omniservo.planning.constraints.motion import displacement, seen_from_body
from omniservo.planning.constraints.path_forms import PathForms
from omniservo.planning.constraints.place import AT, TX, TY, TZ
from omniservo.planning.constraints.push import ASLEEP, Samples, push_centre


@leaf
def free_side_gap(x: float, y: float, z: float, plane: FloatArray) -> float:
    """Return n·(x, y, z) − (b + d) of a ``plane`` (6,) (see `Constraints`)."""
    return float(plane[0] * x + plane[1] * y + plane[2] * z - plane[3])


@kernel
def prove_free_side(controls: FloatArray, size: float, plane: FloatArray, margin: float) -> tuple[int, float]:
    """Decide n·t ≥ b + d + margin on [0, 1]; controls of t, or t − m (3, n+1), from `seen_from_body`.

    The normal's length differs from 1 by rounding only; its 1e-15 is among the counts.
    """
    n = controls.shape[1] - 1
    gap = np.empty((1, n + 1))
    for k in range(n + 1):
        gap[0, k] = free_side_gap(controls[0, k], controls[1, k], controls[2, k], plane) - margin
    return prove_nonnegative(gap, n + 24.0, 3.0 * size + abs(plane[3]) + abs(margin))


@late
def prove_free_side_of(
    constraints: Constraints, index: int, margin: float, path: PathForms
) -> tuple[int, float, int]:
    """Decide half-space ``index`` with ``margin`` to spare: status, w, 0."""
    plane = constraints.planes[index]
    centre, size = seen_from_body(path.centre, path.translation, path.size, constraints.motions, plane[5])
    status, w = prove_free_side(centre, size, plane, margin)
    return status, w, 0


@late
def prove_free_sides(constraints: Constraints, path: PathForms) -> tuple[int, float]:
    """Decide every half-space."""
    for i in range(constraints.planes.shape[0]):
        status, w, _ = prove_free_side_of(constraints, i, 0.0, path)
        if status != PROVEN:
            return status, w
    return PROVEN, 0.0


@late
def free_side_margin(constraints: Constraints, index: int, pose: FloatArray) -> float:
    """Return what half-space ``index`` leaves at a pose (14,)."""
    plane = constraints.planes[index]
    mx, my, mz = displacement(constraints.motions, plane[5], pose[AT])
    return free_side_gap(pose[TX] - mx, pose[TY] - my, pose[TZ] - mz, plane)


@late
def push_to_free_side(constraints: Constraints, samples: Samples) -> None:
    """Push the centre out of the solids: g = (n·t − b − d)/max(d, ℓ/20) (see `push`)."""
    planes, motions, ell, first = (
        constraints.planes,
        constraints.motions,
        constraints.ell,
        constraints.slots.planes,
    )
    poses, targets, least = samples.poses, samples.targets, samples.least
    systems, costs = samples.systems, samples.costs
    for i in range(planes.shape[0]):
        group, plane = first + i, planes[i]
        if targets[group] == ASLEEP:
            continue
        f = 1.0 / max(plane[4], 0.05 * ell)
        x, y, z = f * plane[0], f * plane[1], f * plane[2]
        for s in range(poses.shape[0]):
            mx, my, mz = displacement(motions, plane[5], poses[s, AT])
            g = f * free_side_gap(poses[s, TX] - mx, poses[s, TY] - my, poses[s, TZ] - mz, plane)
            least[group] = min(least[group], g)
            if g < targets[group]:
                push_centre(systems, costs, s, poses, x, y, z, targets[group] - g)
