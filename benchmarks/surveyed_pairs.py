"""Two-view motion on photographs whose poses were surveyed: does the stated covariance hold?

Run: ``python -m benchmarks.surveyed_pairs FOLDER [SHARE]``. FOLDER is
``Benchmarking_Camera_Calibration_2008`` of https://github.com/alicevision/SfM_quality_evaluation: the sets of
Strecha, von Hansen, Van Gool, Fua and Thoennessen (CVPR 2008), photographs of facades and of a fountain with
the camera of each in ``gt_dense_cameras``, from a laser scan. Images are reduced to ``SHARE`` of their size
(0.25: 768 × 512). The camera is the stated matrix, with the model error that a file which says nothing of it
is taken to have (`usual_error`).

Pairs are those of images at most five apart. Matches are natural ones, found here. The poses' own error is
not known and not counted. A pair counts as held where the square of (direction, rotation)'s error in the
stated covariance, 5 numbers, is within the 95% quantile of χ²₅.
"""

from __future__ import annotations

import itertools
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from benchmarks.real_coverage import Score, score
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2

from omniservo import UnifiedCamera, estimate_two_view
from omniservo.camera_files.usual_error import usual_error
from omniservo.errors import NoSolutionError
from omniservo.perception.natural_kind import NaturalKind

APART = 5
"""images of a pair, in the order of the set"""

SHARE = 0.25


class Surveyed:
    """Images of one set with their poses."""

    def __init__(self, folder: Path, share: float) -> None:
        """Read the set; images become ``share`` of their size."""
        self.images: list[Any] = []
        self.poses: list[RigidTransform] = []
        for path in sorted((folder / "images").glob("*.jpg")):
            rows = (folder / "gt_dense_cameras" / f"{path.name}.camera").read_text().split()
            numbers = np.array(rows, dtype=np.float64)
            matrix, turn = numbers[:9].reshape(3, 3), numbers[12:21].reshape(3, 3)
            self.poses.append(RigidTransform.from_components(numbers[21:24], Rotation.from_matrix(turn)))
            grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
            self.images.append(cv2.resize(grey, None, fx=share, fy=share, interpolation=cv2.INTER_AREA))
        height, width = self.images[0].shape
        centre = share * (matrix[:2, 2] + 0.5) - 0.5
        camera = UnifiedCamera(share * matrix[0, 0], share * matrix[1, 1], *centre, 0.0, width, height)
        error = usual_error(camera, {}).to_dict()
        self.camera = UnifiedCamera.from_dict({**camera.to_dict(), "model_error": error})

    def pairs(self) -> Iterator[tuple[str, float, Score | None]]:
        """Give (status, turn of the camera [°], score if answered) of every pair."""
        for i, j in itertools.combinations(range(len(self.images)), 2):
            if j - i > APART:
                continue
            true = self.poses[i].inv() * self.poses[j]
            turn = float(np.degrees(true.rotation.magnitude()))
            try:
                matches = NaturalKind().match(self.camera, self.images[i], self.images[j])
            except NoSolutionError:
                yield "not matched", turn, None
                continue
            found = estimate_two_view(
                self.camera, matches.initial, matches.goal, noise=matches.noise, windows=matches.window
            )
            answered = found.status == "ok"
            yield found.status, turn, score(found, (true, np.zeros((6, 6)))) if answered else None


def row(name: str, pairs: list[tuple[str, float, Score | None]]) -> str:
    """Return a set's row of the table."""
    scores = [s for _, _, s in pairs if s is not None]
    others = Counter(status for status, _, s in pairs if s is None)
    why = ", ".join(f"{status} {count}" for status, count in others.most_common()) or "–"
    turned = [turn for _, turn, s in pairs if s is not None]
    lost = [turn for _, turn, s in pairs if s is None]
    turns, swings = ([getattr(s, k) for s in scores] for k in ("rotation_deg", "direction_deg"))
    held = np.mean([s.square <= chi2.ppf(0.95, 5) for s in scores])
    good = sum(s.rotation_deg <= 1.0 and s.direction_deg <= 3.0 for s in scores)
    return (
        f"| {name} | {len(pairs)} | {len(scores)} ({np.median(turned):.0f}°) | {why}"
        f" ({np.median(lost) if lost else 0.0:.0f}°) | {np.median(turns):.2f} / {max(turns):.2f} "
        f"| {np.median(swings):.2f} / {max(swings):.2f} | {good} | {held:.0%} |"
    )


def main() -> None:
    """Print the table as Markdown."""
    folder = Path(sys.argv[1])
    share = float(sys.argv[2]) if len(sys.argv) > 2 else SHARE
    print(
        "| set | pairs | answered (turned by) | refused as (turned by) | rotation median / worst [°] "
        "| direction median / worst [°] | ≤ 1° and ≤ 3° | 95% holds |"
    )
    print("|" + "---|" * 8, flush=True)
    for each in sorted(p for p in folder.iterdir() if (p / "gt_dense_cameras").is_dir()):
        print(row(each.name, list(Surveyed(each, share).pairs())), flush=True)


if __name__ == "__main__":
    main()
