"""Writes docs/outside-suites.md: suites and libraries that Debian packages, run beside ours as they are.

Run: ``make bench-outside``, or ``python -m benchmarks.comparisons.outside_page [--scenes N] [--out FILE]``.
What is not installed is left out with the reason.
"""

from __future__ import annotations

import argparse
import subprocess
from collections.abc import Iterator
from pathlib import Path

from benchmarks.comparisons.estimation_page import explained
from benchmarks.comparisons.machine_vision import compare as machine_vision
from benchmarks.comparisons.mrcal import compare as mrcal
from benchmarks.comparisons.opengv import past_90
from benchmarks.comparisons.planning.report import where
from benchmarks.comparisons.visp import april_tags

from omniservo.files import write_whole

LIBRARIES = ("numpy", "scipy", "numba", "opencv-contrib-python-headless", "pyapriltags")
PACKAGES = (april_tags.PACKAGE, past_90.PACKAGE, mrcal.PACKAGE)

HEAD = """\
# Outside suites

Other people's tests and libraries, run beside ours as they are, on the same images, bearings and corners.
Where ours loses, the tables say so. ViSP's velocities stand in [methods](methods.md), planners in
[planning beside others](benchmark-planning.md), pycolmap, PoseLib and OpenCV in
[motion and pose beside others](benchmark-estimation.md).

    apt-get install visp-images-data libopengv-dev libeigen3-dev mrcal python3-mrcal
    make bench-outside
"""


SEEN = """\
## What they showed on 25 November 2026

Times were taken while the machine's two cores were busy with other work.

- **Tags.** All forty are found, none else, and all forty poses are within ViSP's limits, at most 0.36 of
  them. Corners of 39 are within 0.5 px of the suite's files, those of one `tagCircle49h12` are 0.61 px off.
  These files are what AprilRobotics' library found: of the five AprilTag 3 families ours is nearer to the
  true poses (0.23 to 0.27 px rms against 0.32 to 0.35 px), of `tag36h11` AprilRobotics is (0.20 px against
  0.24 px). Most of it is the suite's camera: corners of both ask for a vertical focal length of 705 px.
  **In the photograph four of twelve tags miss the limits**, by at most 0.06 px and 0.0006; the truth is
  unknown there: the files hold what ViSP's reader once gave.
- **Past 90°.** No median and no 90% quantile of ours is surely larger than one of OpenGV's, at any noise;
  with wrong matches and 0.5 px of noise and more they are at most half as large. From known points ours
  takes half of OpenGV's time or less. **From two images it does not**: the search takes 0.1 to 6 ms, but
  from 0.5 px of noise on `estimate_two_view` takes 25 to 100 ms, looking for a second motion that would
  explain the matches as well, where OpenGV's RANSAC takes 0.5 to 2 ms of matches that are all right. Of
  those answers that it calls ok 0 to 7% are off by more than 10°, without a name.
- **machinevision-toolbox-python.** At 24 000 poses of its own runs its IBVS asks for the twist of our `ibvs`
  to 2·10⁻¹⁴. Its PBVS, which finds the pose from the pixels by OpenCV, for that of our `pbvs` to 10⁻⁶; two of
  its 60 runs do not come to the goal. The ways of both `ibvs` differ, as it moves by a twist's first-order
  matrix. Measured on 26 November 2026.
- **mrcal.** Both project alike, to 1e-12 px. **Of many views of a lens that no formula fits, mrcal's
  splined model leaves 17% less** on corners that it has not seen (camodocal, vinsfusion), dropping 81 and
  34 corners of its own. Of few views it learns too much (fisheye1: 0.99 px, ours 0.41 px), and past 90° it
  finds no camera for the mirror. Ours states more uncertainty than the halves show in three sets of four;
  **of fisheye1's seven and eight views it states a third of it**, as mrcal states a fifth with OPENCV8. On
  drawn corners, where both models hold the truth, both are honest, and mrcal is 17% nearer to it: it has
  fewer parameters to find. mrcal's answers change from run to run where corners are dropped (camodocal with
  OPENCV8 once left 1.08 px).
"""
"""read from the tables below; to be read again when they are written again"""


def page(scenes: int) -> Iterator[str]:
    """Run everything and yield the page's lines."""
    yield HEAD
    yield where("python -m benchmarks.comparisons.outside_page", LIBRARIES)
    found = ", ".join(map(version, PACKAGES))
    yield f"Debian's packages: {found}.\n"
    yield SEEN
    yield "## ViSP's AprilTag images\n"
    yield explained(april_tags.__doc__) + "\n"
    yield from april_tags.lines()
    yield "\n## OpenGV, past 90°\n"
    yield explained(past_90.__doc__) + "\n"
    yield from past_90.lines(scenes)
    yield "## machinevision-toolbox-python\n"
    yield explained(machine_vision.__doc__) + "\n"
    yield from machine_vision.lines()
    yield "\n## mrcal\n"
    yield explained(mrcal.__doc__) + "\n"
    yield from mrcal.lines()


def version(package: str) -> str:
    """Return a Debian package with its version, or that it is absent."""
    asked = ["dpkg-query", "-W", "-f=${Version}", package]
    try:
        found = subprocess.run(asked, capture_output=True, text=True)
    except FileNotFoundError:
        return f"{package} absent"
    return f"{package} {found.stdout.strip()}" if found.returncode == 0 else f"{package} absent"


def main() -> None:
    """Write the page and print it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=100, help="of each case of bearings")
    parser.add_argument("--out", type=Path, default=Path("docs/outside-suites.md"))
    given = parser.parse_args()
    written = "\n".join(page(given.scenes)) + "\n"
    write_whole(given.out, written, force=True)
    print(written)


if __name__ == "__main__":
    main()
