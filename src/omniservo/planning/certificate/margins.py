"""How much of every constraint is left along a path: found by looking, then proven (docs/certificate.md).

An entry is a row of floats, see `margin_kinds`; a margin is in its unit, beyond what the problem asks for.
"""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.held import held
from omniservo.geometry.kernel import inlined, kernel
from omniservo.geometry.polynomial import bernstein_from_power, set_basis
from omniservo.geometry.subdivision import PROVEN, REFUTED, UNDECIDED
from omniservo.planning.bernstein_path import camera_controls, camera_count
from omniservo.planning.certificate.margin_kinds import CLEARANCE, ENTRY_INDEX, ENTRY_KIND, ENTRY_STEP, MASK
from omniservo.planning.certificate.proven_margins import prove_space, prove_view
from omniservo.planning.certificate.seen_margins import smallest_at, sphere_margin
from omniservo.planning.constraints.constraints import Constraints
from omniservo.planning.constraints.path_forms import ViewForms, path_forms
from omniservo.planning.constraints.place import AT, place

MARGIN, AT_W, POINT, STATUS = range(4)
"""The places of a row of the table of margins."""

LOOKS = 32
"""The path is checked so many times, evenly, before every minimum is refined."""

TRIES = 24
"""A margin is proven at most so often, each time a little lower."""

PARABOLAS = 5
"""Parabolas of a refinement; at the last one the places are 1/160 000 of the path apart."""


@kernel
def refine(
    entry: FloatArray,
    constraints: Constraints,
    optics: FloatArray,
    phi: FloatArray,
    t: FloatArray,
    j: int,
    w: float,
) -> tuple[float, float]:
    """Return (margin, w) of the smallest margin of point j near w.

    Three places around the smallest so far give a parabola; its lowest place is checked next, and the
    places move closer together.
    """
    scratch = np.empty((1, phi.shape[1])), np.empty((1, t.shape[1])), np.empty(14), np.empty((1, 4))
    turn, point = np.empty((3, 4)), constraints.points[j : j + 1]
    values, places = np.empty(4), np.empty(4)
    best, at, width = math.inf, w, 0.25 / LOOKS
    for _ in range(PARABOLAS):
        middle = min(max(at, width), 1.0 - width)
        for k in range(4):
            if k < 3:
                places[k] = middle + (k - 1) * width
            else:
                curvature = values[0] - 2.0 * values[1] + values[2]
                shift = 0.5 * (values[0] - values[2]) / curvature if curvature > 0.0 else 0.0
                places[3] = min(max(middle + width * min(max(shift, -8.0), 8.0), 0.0), 1.0)
            set_basis(scratch[0], 0, places[k])
            set_basis(scratch[1], 0, places[k])
            place(phi, t, scratch[0][0], scratch[1][0], point, scratch[2], scratch[3], turn)
            scratch[2][AT] = places[k]
            values[k] = smallest_at(entry, constraints, optics, scratch[2], scratch[3], point)[0]
            if values[k] < best:
                best, at = values[k], places[k]
        width *= 0.2
    return best, at


@inlined
def look(
    constraints: Constraints,
    optics: FloatArray,
    entries: FloatArray,
    phi: FloatArray,
    t: FloatArray,
    table: FloatArray,
) -> None:
    """Write (margin, w, point) of every entry's smallest margin at LOOKS + 1 places into ``table`` (e, 4)."""
    count = entries.shape[0]
    pose, c, turn = np.empty(14), np.empty((constraints.points.shape[0], 4)), np.empty((3, 4))
    rotation_basis, translation_basis = np.empty((1, phi.shape[1])), np.empty((1, t.shape[1]))
    for e in range(count):
        table[e, MARGIN] = math.inf
    for step in range(LOOKS + 1):
        w = step / LOOKS
        set_basis(rotation_basis, 0, w)
        set_basis(translation_basis, 0, w)
        place(phi, t, rotation_basis[0], translation_basis[0], constraints.points, pose, c, turn)
        pose[AT] = w
        for e in range(count):
            if entries[e, ENTRY_KIND] == CLEARANCE:  # there may be thousands
                margin, about = sphere_margin(constraints.obstacles, int(entries[e, ENTRY_INDEX]), pose), 0
            else:
                margin, about = smallest_at(entries[e], constraints, optics, pose, c, constraints.points)
            if not margin >= table[e, MARGIN]:
                table[e, MARGIN], table[e, AT_W], table[e, POINT] = margin, w, about


@kernel
def path_margins(
    constraints: Constraints,
    optics: FloatArray,
    entries: FloatArray,
    rotation: FloatArray,
    translation: FloatArray,
) -> FloatArray:
    """Return a row (margin, w, point, status) for every entry (e, 4) on the path given by powers.

    PROVEN: the margin is ≥ 0 and holds for all w. REFUTED: the requirement itself fails at w. Otherwise
    UNDECIDED. Where status is not PROVEN the margin is the smallest one seen.

    Args:
        constraints: the problem.
        optics: see `margin_kinds`.
        entries: (e, 4), see there; their step is the first below the smallest margin seen.
        rotation: (4, σ+1), highest power first.
        translation: (3, τ+1) [m], highest power first.
    """
    constraints = held(constraints)
    table = np.empty((entries.shape[0], 4))
    path, phi = path_forms(rotation, translation), bernstein_from_power(rotation)
    centre = path.centre
    look(constraints, optics, entries, phi, centre, table)
    controls, errors = camera_controls(rotation, translation, constraints.points)
    view = ViewForms(controls, errors, float(camera_count(rotation.shape[1] - 1, translation.shape[1] - 1)))
    for e in range(entries.shape[0]):
        entry, row = entries[e], table[e]
        row[STATUS] = UNDECIDED
        if 0.0 < row[AT_W] < 1.0:
            row[MARGIN], row[AT_W] = refine(
                entry, constraints, optics, phi, centre, int(row[POINT]), row[AT_W]
            )
        step, zero_tried = entry[ENTRY_STEP], False
        for _ in range(TRIES):
            target = row[MARGIN] - step
            if target < 0.0 and not zero_tried:
                target, zero_tried = 0.0, True
            else:
                step *= 4.0
            if entry[ENTRY_KIND] <= MASK:
                status, w, j = prove_view(entry, target, constraints, optics, view)
            else:
                status, w, j = prove_space(entry, target, constraints, path)
            if status == PROVEN:
                row[MARGIN], row[STATUS] = target, (PROVEN if target >= 0.0 else row[STATUS])
                break
            if status == REFUTED:
                seen, w = refine(entry, constraints, optics, phi, centre, j, w)
                if seen < row[MARGIN]:
                    row[MARGIN], row[AT_W], row[POINT] = seen, w, j
                if target == 0.0 and row[MARGIN] < (-1e-9 if entry[ENTRY_KIND] <= MASK else 0.0):
                    row[STATUS] = REFUTED
    return table


@kernel
def pose_margins(
    constraints: Constraints,
    optics: FloatArray,
    entries: FloatArray,
    quaternion: FloatArray,
    translation: FloatArray,
    w: float,
) -> FloatArray:
    """Return a row (margin, point) for every entry at a pose: unit quaternion (4,), t (3,) [m], w."""
    constraints = held(constraints)
    phi, t, one = np.empty((4, 1)), np.empty((3, 1)), np.ones(1)
    for i in range(4):
        phi[i, 0] = quaternion[i]
    for i in range(3):
        t[i, 0] = translation[i]
    pose, c, turn = np.empty(14), np.empty((constraints.points.shape[0], 4)), np.empty((3, 4))
    place(phi, t, one, one, constraints.points, pose, c, turn)
    pose[AT] = w
    table = np.empty((entries.shape[0], 2))
    for e in range(entries.shape[0]):
        margin, about = smallest_at(entries[e], constraints, optics, pose, c, constraints.points)
        table[e, 0], table[e, 1] = margin, about
    return table
