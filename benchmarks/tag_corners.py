"""Tags in rendered wide-angle pictures: how many are found, how well are their corners located.

Run: ``python -m benchmarks.tag_corners [pictures]``. Pictures of several tags each, by ray casting, with a
mottled ground, blur and noise; the truth is the projection of the corners. A tag is counted where it is
wholly in the picture with its white border. OpenCV's reader sees the raw picture (reflected for a mirror),
without and with its sub-pixel refinement. Times are the least of two passes over each picture, in one thread.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt
from tests.perception import tag_scenes
from tests.perception.tag_scenes import PlacedTag

from omniservo.cameras import UnifiedCamera
from omniservo.perception import find_tags
from omniservo.tag_dictionaries import dictionary, dictionary_size

Array = npt.NDArray[np.float64]
Found = dict[int, Array]
ANGLES = (0, 15, 30, 45, 60, 75, 85)
SIZES = (25.0, 120.0)
LEAN = np.deg2rad(40.0)
TAGS = 5
OTHERS = ("tag16h5", "tag25h9", "tag36h10", "4x4_50", "6x6_250")
NAMES = ("ours", "OpenCV", "OpenCV, sub-pixel")


@dataclass
class Tally:
    """What one way of finding did with the tags of one row."""

    tags: int = 0
    found: int = 0
    wrong: int = 0
    errors: list[float] = field(default_factory=list)

    def spelled(self) -> str:
        """Share found; median and 95% of the corners' errors [px]."""
        if not self.errors:
            return f"{100 * self.found / max(self.tags, 1):.0f}% | – | –"
        median, high = np.percentile(self.errors, [50, 95])
        return f"{100 * self.found / self.tags:.1f}% | {median:.3f} | {high:.3f}"


def draw_tag(camera: UnifiedCamera, name: str, number: int, rng: np.random.Generator) -> PlacedTag:
    """Draw angle from the axis, size in the picture, lean and turn, until the whole tag is in the picture."""
    while True:
        angle, around = np.deg2rad(rng.uniform(ANGLES[0], ANGLES[-1])), rng.uniform(-np.pi, np.pi)
        direction = np.array([np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)])
        lean, spin = rng.uniform(-LEAN, LEAN, 2) / np.sqrt(2.0), rng.uniform(-np.pi, np.pi)
        wanted = np.exp(rng.uniform(*np.log(SIZES)))
        side = wanted / 200.0
        for _ in range(4):
            tag = tag_scenes.facing(name, number, direction, 1.0, side, lean=lean, spin=spin)
            size = size_px(camera, tag)
            if not 0.0 < size < 1e4 or side > 2.0:
                break
            side *= wanted / size
        else:
            if tag_scenes.whole(camera, tag):
                return tag


def size_px(camera: UnifiedCamera, tag: PlacedTag) -> float:
    """Square root of the area of the black square's image [px]; 0 where it is not seen."""
    u, v = np.nan_to_num(tag_scenes.true_pixels(camera, tag)).T
    return float(np.sqrt(0.5 * abs(u @ np.roll(v, -1) - v @ np.roll(u, -1))))


def draw_tags(camera: UnifiedCamera, name: str, rng: np.random.Generator) -> list[PlacedTag]:
    """Draw up to `TAGS` tags, of different ids, that do not hide each other."""
    tags: list[PlacedTag] = []
    for number in rng.permutation(dictionary_size(name))[: 3 * TAGS]:
        tag = draw_tag(camera, name, int(number), rng)
        if len(tags) < TAGS and all(_apart(tag, other) for other in tags):
            tags.append(tag)
    return tags


def _apart(tag: PlacedTag, other: PlacedTag) -> bool:
    reach = [np.arctan(0.5 * t.side * 1.4 * np.sqrt(2.0) / np.linalg.norm(t.centre)) for t in (tag, other)]
    rays = [t.centre / np.linalg.norm(t.centre) for t in (tag, other)]
    return bool(np.arccos(np.clip(rays[0] @ rays[1], -1.0, 1.0)) > sum(reach))


def by_opencv(image: npt.NDArray[np.uint8], camera: UnifiedCamera, name: str, refinement: int) -> Found:
    """Corners by id as OpenCV's reader gives them."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = refinement
    mirrored = camera.fx * camera.fy < 0
    seen = np.ascontiguousarray(image[:, ::-1]) if mirrored else image
    corners, ids, _ = cv2.aruco.ArucoDetector(dictionary(name), parameters).detectMarkers(seen)
    found = {}
    for number, square in zip([] if ids is None else ids.ravel(), corners, strict=True):
        pixels = square[0].astype(np.float64)
        found[int(number)] = (
            np.stack([image.shape[1] - 1 - pixels[:, 0], pixels[:, 1]], 1) if mirrored else pixels
        )
    return found


def by_us(image: npt.NDArray[np.uint8], camera: UnifiedCamera, name: str) -> Found:
    """Corners by id as `find_tags` gives them."""
    tags = find_tags(image, camera, name)
    return dict(zip(tags.ids.tolist(), tags.corners, strict=True))


def measured(camera: UnifiedCamera, name: str, pictures: int, seed: int) -> tuple[list[list[Tally]], Array]:
    """Tallies [angle][way], and milliseconds (pictures, ways)."""
    ways: tuple[Callable[..., Found], ...] = (
        by_us,
        lambda *a: by_opencv(*a, cv2.aruco.CORNER_REFINE_NONE),
        lambda *a: by_opencv(*a, cv2.aruco.CORNER_REFINE_SUBPIX),
    )
    rows = [[Tally() for _ in ways] for _ in ANGLES[:-1]]
    times = np.zeros((pictures, len(ways)))
    rng = np.random.default_rng(seed)
    for k in range(pictures):
        tags = draw_tags(camera, name, rng)
        blur, noise = rng.uniform(0.5, 1.2), rng.uniform(1.0, 5.0)
        image = tag_scenes.render(camera, tags, blur=blur, noise=noise, seed=seed + k)
        for w, way in enumerate(ways):
            taken = []
            for _ in range(2):
                started = time.perf_counter()
                found = way(image, camera, name)
                taken.append(time.perf_counter() - started)
            times[k, w] = 1e3 * min(taken)
            rows[0][w].wrong += sum(number not in {tag.number for tag in tags} for number in found)
            for tag in tags:
                _count(rows, w, tag, found.get(tag.number), tag_scenes.true_pixels(camera, tag))
    return rows, times


def _count(rows: list[list[Tally]], way: int, tag: PlacedTag, corners: Array | None, true: Array) -> None:
    angle = np.rad2deg(np.arccos(tag.centre[2] / np.linalg.norm(tag.centre)))
    tally = rows[int(np.searchsorted(ANGLES, angle, side="right")) - 1][way]
    tally.tags += 1
    if corners is None:
        return
    errors = np.linalg.norm(corners - true, axis=1)
    # read somewhere else, or turned: not this tag's corners
    if errors.max() > 0.5 * np.linalg.norm(true[0] - true[2]):
        tally.wrong += 1
        return
    tally.found += 1
    tally.errors += errors.tolist()


def _joined(tallies: list[Tally]) -> Tally:
    return Tally(
        sum(t.tags for t in tallies),
        sum(t.found for t in tallies),
        sum(t.wrong for t in tallies),
        [error for t in tallies for error in t.errors],
    )


def camera_rows(pictures: int) -> Iterator[str]:
    """Rows of the first table: each camera by the tag's angle from its axis."""
    for title, camera in tag_scenes.cameras().items():
        rows, times = measured(camera, "tag36h11", pictures, seed=1)
        for low, high, row in zip(ANGLES[:-1], ANGLES[1:], rows, strict=True):
            if row[0].tags:
                yield f"{title} | {low}–{high}° | {row[0].tags} | " + " | ".join(t.spelled() for t in row)
        wrong = "; ".join(f"{name} {_joined([row[w] for row in rows]).wrong}" for w, name in enumerate(NAMES))
        taken = ", ".join(f"{t:.0f}" for t in np.median(times, axis=0))
        print(f"{title}: wrong ids {wrong}; ms a picture {taken}", file=sys.stderr)


def dictionary_rows(pictures: int) -> Iterator[str]:
    """Rows of the second table: other dictionaries, all angles to 75°."""
    for name in OTHERS:
        rows, _ = measured(tag_scenes.cameras()["fe185"], name, pictures, seed=2)
        joined = [_joined([row[w] for row in rows[:5]]) for w in range(len(NAMES))]
        wrong = _joined([row[0] for row in rows]).wrong
        yield f"{name} | {joined[0].tags} | {wrong} | " + " | ".join(t.spelled() for t in joined)


def main() -> None:
    """Print both tables as Markdown; wrong ids and times go to the standard error."""
    cv2.setNumThreads(1)
    pictures = int(sys.argv[1]) if len(sys.argv) > 1 else 60
    heads = " | ".join(f"{name}: found | median [px] | p95" for name in NAMES)
    print(f"| camera | from the axis | tags | {heads} |")
    print("|" + "---|" * 12)
    for row in camera_rows(pictures):
        print(f"| {row} |", flush=True)
    print(f"\n| dictionary | tags to 75° | wrong ids of ours | {heads} |")
    print("|" + "---|" * 12)
    for row in dictionary_rows(max(1, pictures // 3)):
        print(f"| {row} |", flush=True)


if __name__ == "__main__":
    main()
