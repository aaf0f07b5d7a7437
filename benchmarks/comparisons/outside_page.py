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


def page(scenes: int) -> Iterator[str]:
    """Run everything and yield the page's lines."""
    yield HEAD
    yield where("python -m benchmarks.comparisons.outside_page", LIBRARIES)
    found = ", ".join(map(version, PACKAGES))
    yield f"Debian's packages: {found}. machinevision-toolbox-python was not run.\n"
    yield "## ViSP's AprilTag images\n"
    yield explained(april_tags.__doc__) + "\n"
    yield from april_tags.lines()
    yield "\n## OpenGV, past 90°\n"
    yield explained(past_90.__doc__) + "\n"
    yield from past_90.lines(scenes)
    yield "## mrcal\n"
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
