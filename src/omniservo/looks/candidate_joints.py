"""Joint configurations near that of the arm from which a look may tell more, or a plan may begin."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray
from omniservo.whole_arm import ArmSetting

ASIDE = (0.05, 0.1)
"""[m] how far the camera goes across its line of sight,"""
ALONG = 0.06
"""[m] along it,"""
ROLLED = 0.35
"""[rad] and how far it turns about it."""

FARTHEST = 0.6
"""[rad] No joint turns farther."""

DRAWN, TURNED = 12, 0.15
"""So many drawn configurations, of joints turned by so much, one standard deviation [rad]"""

MORE_THAN_NEEDED = 1.15
"""of the singular value that is needed is gone for"""

_CLIMBS, _CLIMB, _STEP = 24, 0.03, 1e-4


def candidate_joints(
    setting: ArmSetting, start: FloatArray, singular_value: float, middle: FloatArray, seed: int
) -> Iterator[FloatArray]:
    """Yield joints (n,) [rad]: of the camera aside, nearer or rolled, away from singularity, and drawn ones.

    Args:
        setting: the arm,
        start: and where it stands (n,) [rad].
        singular_value: that a plan keeps.
        middle: (3,) of the target, in the camera's frame [m]: checked from aside, too.
        seed: of those drawn.
    """
    for move in _camera_moves(middle):
        try:
            q = setting.arm.inverse_near(setting.base_T_flange(move), start)
        except InputError:  # out of reach
            continue
        if np.abs(q - start).max() <= FARTHEST:
            yield q
    yield from _less_singular(setting, singular_value, start)
    random = np.random.default_rng([seed, 8])
    for _ in range(DRAWN):
        yield start + TURNED * random.standard_normal(len(start)).clip(-2.0, 2.0)


def _camera_moves(middle: FloatArray) -> Iterator[RigidTransform]:
    """Yield begin_T_end of the camera."""
    distance = float(np.linalg.norm(middle))
    ahead = middle / distance
    side = np.cross(ahead, np.eye(3)[np.argmin(np.abs(ahead))])
    side /= np.linalg.norm(side)
    across = np.array([side, np.cross(ahead, side)])
    for length in ASIDE:
        for angle in np.arange(0.0, 2.0 * np.pi, 0.25 * np.pi):
            way = length * (np.cos(angle) * across[0] + np.sin(angle) * across[1])
            turn = _towards(ahead, middle - way)
            for rolled in (0.0, ROLLED):
                # turned after the roll, so that it stays aimed
                yield RigidTransform.from_components(way, turn * Rotation.from_rotvec(rolled * ahead))
    for way in (ALONG * ahead, -ALONG * ahead):
        yield RigidTransform.from_components(way, Rotation.from_rotvec(ROLLED * ahead))


def _towards(ahead: FloatArray, there: FloatArray) -> Rotation:
    """Return the least rotation that turns a unit vector into the direction of another."""
    axis, towards = np.cross(ahead, there), float(ahead @ there)
    length = float(np.linalg.norm(axis))
    return Rotation.from_rotvec(np.arctan2(length, towards) * axis / max(length, 1e-12))


def _less_singular(setting: ArmSetting, needed: float, start: FloatArray) -> Iterator[FloatArray]:
    """Yield where the smallest singular value, climbed from the start, is what is needed, and farther."""
    q = start.copy()
    if _least_value(setting, q) >= MORE_THAN_NEEDED * needed:
        return
    for part in (1.0, MORE_THAN_NEEDED, 1.4):
        for _ in range(_CLIMBS):
            value = _least_value(setting, q)
            if value >= part * needed or np.abs(q - start).max() > FARTHEST:
                break
            moves = _STEP * np.eye(len(q))
            slope = np.array([_least_value(setting, q + move) - value for move in moves])
            if not slope.any():
                return
            q = q + _CLIMB * slope / np.linalg.norm(slope)
        if np.abs(q - start).max() > FARTHEST:
            return
        yield q


def _least_value(setting: ArmSetting, q: FloatArray) -> float:
    jacobian = setting.arm.scaled_camera_jacobian(q, setting.flange_T_camera)
    return float(np.linalg.svd(jacobian, compute_uv=False)[-1])
