"""ViSP's AprilTag suite, as it is: eight families of five tags, and a photograph of twelve.

Run: ``python -m benchmarks.comparisons.visp.april_tags``; it needs Debian's visp-images-data. Limits, sizes
and camera are those of ViSP's catchAprilTag.cpp, without the seven cases that it leaves out: corners within
0.5 px in u and v of those in the suite's files; poses within a limit of the tag's own, from corners that
are its own measure √(Σe²/3) of the translation and of the rotation vector; in the photograph 0.5 px, and
0.005 m or rad in each coordinate of the pose. Beside the limits stands how far corners lie from where the
suite's true poses and camera put them: the files of corners are what a detector found, and the poses are
what was rendered.

Two conventions differ, and are carried over: the suite's pixel coordinates begin at the first pixel's outer
corner, ours at its centre; and its tag frame has y up and z towards the viewer (of tag16h5, tag25h9 and
tag36h11 as AprilRobotics prints them, upside down beside ours). AprilRobotics' library, which ViSP reads
tags with, is run beside ours where pyapriltags is installed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from benchmarks.comparisons.libraries import peer
from scipy.spatial.transform import RigidTransform

from omniservo import UnifiedCamera, estimate_pose
from omniservo.geometry.arrays import ByteArray, FloatArray
from omniservo.perception import find_tags

DATA = Path("/usr/share/visp-images-data/ViSP-images/AprilTag")
PACKAGE = "visp-images-data"
PIXEL_ORIGIN = 0.5
"""The centre of the first pixel in the suite's coordinates [px]; in ours it is 0."""

FAMILIES = {
    "tag16h5": ("tag16_05", 6 / 8),
    "tag25h9": ("tag25_09", 7 / 9),
    "tag36h11": ("tag36_11", 8 / 10),
    "tagCircle21h7": ("tag21_07", 5 / 9),
    "tagCircle49h12": ("tag49_12", 5 / 11),
    "tagCustom48h12": ("tag48_12", 6 / 10),
    "tagStandard41h12": ("tag41_12", 5 / 9),
    "tagStandard52h13": ("tag52_13", 6 / 10),
}
"""family → (name in the suite's files, edge of the square whose corners count over that of the print)"""

PRINT = (0.25, 0.25, 0.25, 0.125, 0.125)
"""edge of the print of tag 0 … 4 [m]"""

CORNER_PX = 0.5
TRANSLATION = (0.025, 0.09, 0.05, 0.13, 0.09)
ROTATION = (0.04, 0.075, 0.07, 0.18, 0.13)
"""limits of tag 0 … 4 [m], [rad]"""

PHOTO_EDGE, PHOTO_LIMIT = 0.053, 0.005
CORNERS = 0.5 * np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])
"""ours, top left first and clockwise, in the suite's tag frame, of a square of edge 1"""


def camera(*, focal: float = 700.0, centre: tuple[float, float] = (320.0, 240.0)) -> UnifiedCamera:
    """Return the suite's perspective camera, in our pixel coordinates."""
    cx, cy = (c - PIXEL_ORIGIN for c in centre)
    return UnifiedCamera(focal, focal, cx, cy, 0.0, 640, 480)


PHOTO_CAMERA = camera(focal=615.1675, centre=(312.1889954, 243.4373779))


@dataclass(frozen=True)
class Family:
    """What is known of a family's image."""

    name: str
    image: ByteArray
    square: FloatArray
    """(4, 3) our corners in the suite's tag frame, of edge 1"""
    share: float
    """of the square's edge in the print's"""
    listed: dict[int, FloatArray]
    """corners (4, 2) by id, in our order and coordinates, as the suite's file has them"""

    def points(self, number: int) -> FloatArray:
        """Return the corners of a tag in its frame, (4, 3) [m]."""
        return PRINT[number] * self.share * self.square

    def shown(self, number: int) -> FloatArray:
        """Return where the tag's true pose puts its corners, (4, 2) [px]."""
        pixels, _ = camera().project(true_pose(number).apply(self.points(number)))
        return pixels


@dataclass
class Count:
    """What a reader did with one family."""

    tags: int = 0
    false: int = 0
    corners: int = 0
    """tags whose corners are within the limit"""
    poses: int = 0
    """tags whose pose is within its limits"""
    listed: list[float] = field(default_factory=list)
    """coordinates' distances to the suite's files [px]"""
    shown: list[float] = field(default_factory=list)
    """and to the true poses' projections [px]"""
    translation: list[float] = field(default_factory=list)
    rotation: list[float] = field(default_factory=list)
    """over their limits"""


def true_pose(number: int) -> RigidTransform:
    """Return camera_T_tag as the suite states it."""
    return RigidTransform.from_matrix(np.loadtxt(DATA / f"benchmark/640x480/cMo_{number}.txt"))


def load_family(name: str) -> Family:
    """Return a family's image and its listed corners."""
    short, share = FAMILIES[name]
    folder = DATA / "benchmark/640x480"
    image = _grey(folder / f"{short}_640x480.png")
    numbers = (folder / f"corners_{short}.txt").read_text().split()
    upside_down = name in ("tag16h5", "tag25h9", "tag36h11")
    listed = {}
    for k in range(0, len(numbers), 9):
        corners = np.array(numbers[k + 1 : k + 9], dtype=np.float64).reshape(4, 2)
        listed[int(numbers[k])] = _our_order(corners, upside_down) - PIXEL_ORIGIN
    return Family(name, image, -CORNERS if upside_down else CORNERS, share, listed)


def _our_order(corners: FloatArray, upside_down: bool) -> FloatArray:
    """Return corners from the bottom left, anticlockwise, as ours: from the top left, clockwise."""
    return np.roll(corners[::-1], 2 if upside_down else 0, axis=0)


def _grey(path: Path) -> ByteArray:
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise FileNotFoundError(path)
    return np.asarray(image, dtype=np.uint8)


def by_us(image: ByteArray, name: str, model: UnifiedCamera) -> dict[int, FloatArray]:
    """Return the corners (4, 2) that `find_tags` gives, by id."""
    tags = find_tags(image, model, name)
    return dict(zip(tags.ids.tolist(), tags.corners, strict=True))


def by_april_robotics(pyapriltags: Any, image: ByteArray, name: str) -> dict[int, FloatArray]:
    """Return what AprilRobotics' library gives, at full resolution."""
    found = pyapriltags.Detector(families=name, nthreads=1, quad_decimate=1.0).detect(image)
    upside_down = name in ("tag16h5", "tag25h9", "tag36h11")
    return {tag.tag_id: _our_order(np.array(tag.corners), upside_down) - PIXEL_ORIGIN for tag in found}


def pose_errors(found: FloatArray, points: FloatArray, model: UnifiedCamera) -> RigidTransform | None:
    """Return camera_T_tag of four corners, the likelier of a plane's two."""
    estimate = estimate_pose(model, points, found)
    return estimate.poses[0].inv() if estimate.poses else None


def counted(family: Family, found: dict[int, FloatArray]) -> Count:
    """Return how a reader's corners, and the pose from them, stand against the suite's limits."""
    count = Count(tags=len(found), false=len(set(found) - set(family.listed)))
    for number in sorted(set(found) & set(family.listed)):
        off = np.abs(found[number] - family.listed[number])
        count.corners += bool((off < CORNER_PX).all())
        count.listed += off.ravel().tolist()
        count.shown += np.abs(found[number] - family.shown(number)).ravel().tolist()
        pose, true = pose_errors(found[number], family.points(number), camera()), true_pose(number)
        if pose is None:
            continue
        turn = pose.rotation.as_rotvec() - true.rotation.as_rotvec()
        share = np.array([_measure(pose.translation - true.translation) / TRANSLATION[number],
                          _measure(turn) / ROTATION[number]])  # fmt: skip
        count.translation.append(share[0])
        count.rotation.append(share[1])
        count.poses += bool((share < 1.0).all())
    return count


def _measure(errors: FloatArray) -> float:
    return math.sqrt(float(np.square(errors).sum()) / 3.0)


def refitted(found: dict[str, dict[int, FloatArray]]) -> tuple[FloatArray, float]:
    """Return the fx, fy, cx, cy [px] that explain corners at the true poses best, and what is left, rms [px].

    Of corners by family and number.
    """
    rows, values = [], []
    for name, tags in found.items():
        family = load_family(name)
        for number, corners in tags.items():
            x, y, z = true_pose(number).apply(family.points(number)).T
            zero, one = np.zeros(4), np.ones(4)
            rows += [np.stack([x / z, zero, one, zero], 1), np.stack([zero, y / z, zero, one], 1)]
            values += [corners[:, 0], corners[:, 1]]
    matrix, pixels = np.concatenate(rows), np.concatenate(values)
    best = np.linalg.lstsq(matrix, pixels)[0]
    return best, float(np.sqrt(np.mean((matrix @ best - pixels) ** 2)))


def photograph() -> tuple[int, int, int, float, float]:
    """Return tags listed, found by us, within both limits; the worst corner [px] and pose coordinate."""
    listed = (DATA / "ground_truth_detection.txt").read_text().split()
    poses = (DATA / "ground_truth_pose.txt").read_text().split()
    reference = {entry: np.array(poses[k + 1 : k + 7], dtype=np.float64)
                 for k, entry in enumerate(poses) if entry.startswith("36h11")}  # fmt: skip
    found = by_us(_grey(DATA / "AprilTag.pgm"), "tag36h11", PHOTO_CAMERA)
    within, corner, coordinate, tags = 0, 0.0, 0.0, len(listed) // 9
    for k in range(0, len(listed), 9):
        name, number = listed[k], int(listed[k].rsplit("_", 1)[1])
        if number not in found:
            continue
        rows_first = np.array(listed[k + 1 : k + 9], dtype=np.float64).reshape(4, 2)
        off = np.abs(found[number] + PIXEL_ORIGIN - _our_order(rows_first[:, ::-1], True)).max()
        pose = pose_errors(found[number], -PHOTO_EDGE * CORNERS, PHOTO_CAMERA)
        if pose is None:
            continue
        numbers = np.concatenate([pose.translation, pose.rotation.as_rotvec()])
        apart = float(np.abs(numbers - reference[name]).max())
        corner, coordinate = max(corner, float(off)), max(coordinate, apart)
        within += bool(off < CORNER_PX and apart < PHOTO_LIMIT)
    return tags, len(found), within, corner, coordinate


def lines() -> Iterator[str]:
    """Yield the tables; or why there are none."""
    if not DATA.is_dir():
        yield f"Not run: Debian's {PACKAGE} is not installed ({DATA} is not there)."
        return
    pyapriltags = peer("pyapriltags")
    yield "| family | reader | found of 5 | false | corners within 0.5 px | pose within its limits |" \
        " worst of the limits: translation / rotation | to the suite's corners, rms / most [px] |" \
        " to the true poses' [px] |"  # fmt: skip
    yield "|---" * 9 + "|"
    corners: dict[str, dict[str, dict[int, FloatArray]]] = {}
    for name in FAMILIES:
        family = load_family(name)
        found_by = {"omniservo": by_us(family.image, name, camera())}
        if pyapriltags is not None:
            found_by["AprilRobotics"] = by_april_robotics(pyapriltags, family.image, name)
        for reader, found in found_by.items():
            corners.setdefault(reader, {})[name] = found
            yield _row(name, reader, counted(family, found))
    yield ""
    for reader, all_found in corners.items():
        whose = f"{reader}'" if reader.endswith("s") else f"{reader}'s"
        (fx, fy, _, _), left = refitted(all_found)
        yield (
            f"The camera that explains {whose} corners at the true poses best has focal lengths of"
            f" {fx:.1f} and {fy:.1f} px in place of 700, and leaves {left:.2f} px rms."
        )
    tags, seen, within, corner, coordinate = photograph()
    yield ""
    yield (
        f"The photograph: {seen} of {tags} tags are found, {within} of them within 0.5 px and 0.005 of the"
        f" stated corners and pose; the farthest are {corner:.2f} px and {coordinate:.4f} off."
    )


def _row(family: str, reader: str, count: Count) -> str:
    def px(values: list[float]) -> str:
        errors = np.array(values)
        return f"{np.sqrt((errors**2).mean()):.2f} / {errors.max():.2f}" if values else "–"

    worst = f"{max(count.translation):.2f} / {max(count.rotation):.2f}" if count.rotation else "–"
    cells = [family, reader, count.tags - count.false, count.false, count.corners, count.poses, worst,
             px(count.listed), px(count.shown)]  # fmt: skip
    return "| " + " | ".join(map(str, cells)) + " |"


def main() -> None:
    """Print the tables."""
    for line in lines():
        print(line, flush=True)


if __name__ == "__main__":
    main()
