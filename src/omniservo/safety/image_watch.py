"""Whether the points in the image move as the measured joints move the camera."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.cameras.models import CentralModel
from omniservo.errors import InconsistentImage
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.robots import Arm
from omniservo.safety.motion_history import MotionHistory
from omniservo.safety.safety_options import SafetyOptions
from omniservo.safety.seen_points import SeenPoints

BACK = (0.0, 0.1, 0.2, 0.4, 0.8, 1.6)
"""An image is compared with the first, and with the newest that are older than these [s]."""

OFFSETS = 21
"""of the time stamps that are tried"""

MEMORY = 2.0
"""An offset that did not explain the images so long ago [s] is not the offset."""

GROUP = 0.25
"""A larger share of the points must disagree,"""

LEAST_WRONG = 3
"""and so many; fewer are wrong matches, which the tracker's gate leaves out."""

IN_A_ROW = 2
"""so many images"""

TURNED = 0.1
"""Share of a point's motion in the image by which rotation may be off: calibration and mount"""

ASIDE = 0.15
"""Share of the motion that comes of translation by which it may go aside: mount. An axis that is turned by so
much [rad], or a principal point that is as far off, moves all points alike where the camera rolls."""

JITTER = 0.01
"""Time stamps may be off from image to image by this [s]."""

STAMP = 3.0
"""and by so many standard deviations that are stated of them"""

AHEAD = 5.0
"""What errors make of the motion from one image to the next is taken to go on up to so many times as long."""

STILL_PX = 2.0
"""Points of which half moved by less since an image [px] have stood still since then, but for noise. An image
is also compared with the oldest of these: that shows soonest that they should have moved. What rotation and
translation together ask for counts then: errors by which points stand still are not to be expected."""

SAME_PX = 1.0
"""An image whose points do not differ at all from those before is an old one where they should have moved
by this [px]."""


@dataclass(frozen=True, eq=False)
class _Seen:
    """What was seen in one image."""

    time: float
    pixels: FloatArray
    """(n, 2) [px], NaN where a point was not seen"""
    turns: FloatArray
    """(offsets, 3, 3) of initial_T_camera, by the joints"""
    places: FloatArray
    """(offsets, 3) likewise [m]"""
    stamp: float = 0.0
    """standard deviation of the time [s]"""
    known: dict[bytes, FloatArray] = field(default_factory=dict)
    """what `there` found last"""

    def there(self, points: FloatArray, projected: Callable[..., FloatArray]) -> FloatArray:
        """Return where the poses see the points (n, 3) [m], by a function of these and of the poses."""
        key = points.tobytes()
        if key not in self.known:  # it is asked for with every later image
            self.known.clear()
            self.known[key] = projected(points, self.turns, self.places)
        return self.known[key]


class ImageWatch:
    """Compares how points moved in the image with how the joints moved the camera.

    The pose of the first image, carried on by the measured joints, says where every point should be in any
    two images: it should have moved by e = e_t + e_r, e_t what the camera's translation does and e_r the
    rest. The motion seen, m, agrees if along e_t it is off by at most ``image_error`` + ε |e_t| + 0.1 |e_r|
    and across by at most ``image_error`` + 0.15 |e_t| + 0.1 |e_r|, both wider by what 10 ms, half of the step
    between two offsets and three standard deviations of the two time stamps make of it: ε is the share by
    which distances may be wrong. Before, what all points have in common is left out, as far as an axis off by
    0.15 rad explains it where the camera rolls: a principal point that is off moves all points by (I − R)
    times that. Joints and images may
    be off each other in time by any one offset up to ``time_offset``: one for which no more than a quarter of
    the points disagree in any two images in a row of the last `MEMORY`. Where there is none, images or
    joints are wrong. So they are where an image disagrees with the one before, whatever the offset is, and
    the next is off by as much (`_lasts`): two images later a fast motion would explain the jump. What the
    points belong to must stand still.

    Args:
        camera: takes the images.
        arm: carries it.
        flange_T_camera: how it sits there.
        options: image_error, time_offset, structure_error.
    """

    def __init__(
        self, camera: CentralModel, arm: Arm, flange_T_camera: RigidTransform, options: SafetyOptions
    ) -> None:
        self._camera, self._arm, self._options = camera, arm, options
        self._flange_T_camera = flange_T_camera.as_matrix()
        self._offsets = np.linspace(-options.time_offset, options.time_offset, OFFSETS)
        self._initial_T_base: FloatArray | None = None
        self._first: _Seen | None = None
        self._still: _Seen | None = None
        self._seen: deque[_Seen] = deque()
        self._jumped: _Seen | None = None
        """the newest image, where it disagrees with the one before for all offsets"""
        about = camera.project(np.array([[0.0, 0.0, 1.0], [1e-3, 0.0, 1.0]]))[0]
        scale = float(np.linalg.norm(about[1] - about[0])) / 1e-3
        self._axis_px = ASIDE * scale if np.isfinite(scale) else 0.0
        """what an axis that is off shifts the image by [px]; 0 where the camera does not see along its own"""
        self._jitter = JITTER + options.time_offset / (OFFSETS - 1)
        self._wrong = np.zeros(OFFSETS, dtype=np.int64)
        """so many images in a row disagree with each offset"""
        self._refuted = np.full(OFFSETS, -np.inf)
        """when each did for `IN_A_ROW` last [s]"""

    def check(
        self,
        found: SeenPoints,
        history: MotionHistory,
        *,
        alone: bool = False,
    ) -> None:
        """Take an image in.

        Args:
            found: in it; joints carry the pose of the first image on.
            history: the joints up to now.
            alone: this image decides by itself, as after a gap.

        Raises:
            InconsistentImage: points did not move with the camera, whatever the offset is.
        """
        time = found.time
        if self._initial_T_base is None:
            there = self._base_T_camera(history.expected(np.array(time)))
            self._initial_T_base = found.initial_T_camera.as_matrix() @ np.linalg.inv(there)
        joints = history.expected(time + self._offsets)
        poses = self._initial_T_base @ np.array([self._base_T_camera(q) for q in joints])
        seen = np.where(found.valid[:, None], found.pixels, np.nan)
        now = _Seen(time, seen, poses[:, :3, :3], poses[:, :3, 3], found.time_sigma)
        if self._still is None or not _stands_still(self._still, now):
            self._still = next((seen for seen in self._seen if _stands_still(seen, now)), now)
        if self._jumped is not None and self._lasts(self._jumped, now, found.points):
            raise InconsistentImage(
                f"points did not move with the camera: they jumped {time - self._jumped.time:.2f} s ago, and "
                "this image shows them there, too"
            )
        told = {before: self._disagreement(before, now, found.points) for before in self._before(now)}
        self._first = self._first or now
        odd = np.zeros(OFFSETS, dtype=np.bool_)
        for wrong, _ in told.values():
            odd |= wrong
        self._jumped = now if self._jumps(told, time) else None
        if not odd[time - self._refuted > MEMORY].all():  # a single odd image is no reference for the next
            self._seen.append(now)
        self._wrong = np.where(odd, self._wrong + 1, 0)
        refuted = self._wrong >= (1 if alone else IN_A_ROW)
        self._refuted[refuted] = time
        if (time - self._refuted <= MEMORY).all():
            raise InconsistentImage(next(words for wrong, words in told.values() if (wrong & refuted).any()))

    def _jumps(self, told: dict[_Seen, tuple[BoolArray, str]], time: float) -> bool:
        """Return whether an image disagrees with the newest before it, whatever the offset is."""
        if len(self._seen) < 3:
            return False
        possible = time - self._refuted > MEMORY
        return bool(told[self._seen[-1]][0][possible].all())

    def _lasts(self, jumped: _Seen, now: _Seen, points: FloatArray) -> bool:
        """Return whether an image is off by what the one before it jumped by, whatever the offset is.

        How far a point is from where the joints have it changes from image to image by nearly the same: by
        what errors within the bounds make of the motion. Two images tell it; the last before the jump may
        itself be the odd one, and is none of them. From what follows for them the jumped image and this are
        off by r₁ and r₂: by δ and δ where a jump by δ stays, by δ and 0 where the jumped image is odd alone,
        in its points or its stamp, and by 0 and 0 where the one before is. So a point stays where it jumped
        to if r₂ is nearer to r₁ than to 0, and |r₁| is beyond ``image_error``.
        """
        images = (self._seen[-3], self._seen[-2], jumped, now)
        times = [seen.time for seen in images]
        if times[3] - times[1] > AHEAD * (times[1] - times[0]):
            return False
        off = [seen.pixels - seen.there(points, self._projected) for seen in images]
        change = (off[1] - off[0]) / (times[1] - times[0])
        first, second = (off[i] - off[1] - (times[i] - times[1]) * change for i in (2, 3))
        half = 0.5 * np.sum(first * first, axis=2)
        stays = (half > 0.5 * self._options.image_error**2) & (np.sum(second * first, axis=2) > half)
        least = max(LEAST_WRONG, math.floor(GROUP * np.isfinite(half).all(axis=0).sum()) + 1)
        possible = now.time - self._refuted > MEMORY
        return bool((stays.sum(axis=1) >= least)[possible].all())

    def _before(self, now: _Seen) -> list[_Seen]:
        """Return the images to compare with, each once."""
        while len(self._seen) > 1 and self._seen[1].time <= now.time - BACK[-1]:
            self._seen.popleft()
        found = [seen for seen in (self._first, self._still) if seen is not None and seen is not now]
        for back in BACK:
            older = [seen for seen in self._seen if seen.time <= now.time - back]
            found += older[-1:]
        return list(dict.fromkeys(found))

    def _base_T_camera(self, joints: FloatArray) -> FloatArray:
        place = np.zeros((4, 4))
        place[3, 3] = 1.0
        place[:3] = self._arm.locate(joints)[0][:3] @ self._flange_T_camera
        return place

    def _disagreement(self, before: _Seen, now: _Seen, points: FloatArray) -> tuple[BoolArray, str]:
        """Return for which offsets the motion between two images is not the camera's, and how far not."""
        moved = now.pixels - before.pixels
        known = np.isfinite(moved).all(axis=1)
        at_first = before.there(points, self._projected)
        by_place = self._projected(points, before.turns, now.places) - at_first
        expected = now.there(points, self._projected) - at_first
        known = known & np.isfinite(expected).all(axis=(0, 2)) & np.isfinite(by_place).all(axis=(0, 2))
        least = max(LEAST_WRONG, math.floor(GROUP * known.sum()) + 1)
        if known.sum() < least:
            return np.zeros(OFFSETS, dtype=np.bool_), ""
        expected, by_place, moved = expected[:, known], by_place[:, known], moved[known]
        length = _length(expected)
        jitter = self._jitter + STAMP * math.hypot(now.stamp, before.stamp)
        off_px = jitter * length / (now.time - before.time)
        gap = moved - expected
        gap -= self._common(gap, before, now)
        wrong = self._beyond(gap, expected, by_place, off_px)
        if not moved.any():
            wrong |= length > SAME_PX
        if before is self._still:
            free = self._options.image_error + off_px
            wrong |= _length(moved - expected) > free + self._options.structure_error * length
        counts = wrong.sum(axis=1)
        disagree = counts >= least
        best = int(np.argmin(np.where(disagree, counts, len(moved) + 1)))
        if not disagree[best]:
            return disagree, ""
        off = float(np.median(np.linalg.norm(moved - expected[best], axis=1)[wrong[best]]))
        return disagree, (
            f"{counts[best]} of {len(moved)} points did not move with the camera: in "
            f"{now.time - before.time:.2f} s they are {off:.1f} px off where the joints have them"
        )

    def _common(self, gap: FloatArray, before: _Seen, now: _Seen) -> FloatArray:
        """Return what all gaps (offsets, n, 2) [px] have in common, (offsets, 1, 2), as an axis brings it."""
        across = np.eye(2) - np.einsum("oji,ojk->oik", before.turns, now.turns)[:, :2, :2]
        most = self._axis_px * np.sqrt(0.5 * np.square(across).sum(axis=(1, 2)))
        middle = _median(gap)
        length = _length(middle)
        common: FloatArray = (middle * np.minimum(1.0, most / np.maximum(length, 1e-12))[:, None])[:, None]
        return common

    def _beyond(
        self, gap: FloatArray, expected: FloatArray, by_place: FloatArray, off_px: FloatArray
    ) -> BoolArray:
        """Return which gaps (offsets, n) between motion seen and expected no error in the bounds explains.

        Time stamps make ``off_px`` of them.
        """
        options = self._options
        shift = _length(by_place)
        along = by_place / np.maximum(shift, 1e-12)[..., None]
        on = gap[..., 0] * along[..., 0] + gap[..., 1] * along[..., 1]
        aside = _length(gap - on[..., None] * along)
        turn = _length(expected - by_place)
        free = options.image_error + TURNED * turn + off_px
        wrong: BoolArray = (np.abs(on) > free + options.structure_error * shift) | (
            aside > free + ASIDE * shift
        )
        return wrong

    def _projected(self, points: FloatArray, turns: FloatArray, places: FloatArray) -> FloatArray:
        """Return where poses (offsets,) see the points: (offsets, n, 2) [px], NaN where they do not."""
        seen_from = (points - places[:, None]) @ turns  # that of the inverse turn from the left
        pixels, valid = self._camera.project(seen_from)
        return np.where(valid[..., None], pixels, np.nan)


def _length(pixels: FloatArray) -> FloatArray:
    """Return the lengths (…) of (…, 2); of so few NumPy's own norm takes three times as long."""
    length: FloatArray = np.hypot(pixels[..., 0], pixels[..., 1])
    return length


def _median(values: FloatArray) -> FloatArray:
    """Return the median over the second axis of finite numbers, in a part of the time that NumPy's takes."""
    ordered, half = np.sort(values, axis=1), values.shape[1] // 2
    if values.shape[1] % 2:
        return ordered[:, half]
    middle: FloatArray = 0.5 * (ordered[:, half - 1] + ordered[:, half])
    return middle


def _stands_still(before: _Seen, now: _Seen) -> bool:
    """Return whether half of the points seen in both images moved by no more than noise."""
    moved = _length(now.pixels - before.pixels)
    known = moved[np.isfinite(moved)]
    return len(known) > 0 and float(np.median(known)) < STILL_PX
