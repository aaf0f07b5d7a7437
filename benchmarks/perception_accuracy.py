"""Perception against exactly rendered pictures and drawn views: the protocols behind the figures in the README.

Run: ``python -m benchmarks.perception_accuracy``. Both protocols are seeded; no draw is thrown away.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from omniservo.cameras import UnifiedCamera
from omniservo.perception import find_dots

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "perception"))

import dot_scenes  # noqa: E402

Array = npt.NDArray[np.float64]


def draw_dot(camera: UnifiedCamera, rng: np.random.Generator) -> tuple[Array, Array, float]:
    """Draw one dot: centre [m], normal, radius [m].

    Distance 0.2–0.6 m, angle from the optical axis 0–80°, tilt of the dot against the line of sight 0–60°, radius 6–10 mm, all
    uniform; the azimuth is uniform over the directions in which the whole dot and 6 px around it are in the image.
    """
    distance, off_axis = rng.uniform(0.2, 0.6), np.deg2rad(rng.uniform(0, 80))
    tilt, spin, radius = np.deg2rad(rng.uniform(0, 60)), rng.uniform(0, 2 * np.pi), rng.uniform(0.006, 0.010)
    azimuths = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    rays = np.stack(
        [
            np.sin(off_axis) * np.cos(azimuths),
            np.sin(off_axis) * np.sin(azimuths),
            np.full(720, np.cos(off_axis)),
        ],
        1,
    )
    reach = 210.0 * radius / distance + 6.0
    pixels, valid = camera.project(rays)
    inside = valid & ((pixels > reach) & (pixels < np.array([camera.width, camera.height]) - reach)).all(1)
    ray = rays[rng.choice(np.flatnonzero(inside))]
    frame = dot_scenes.plane_axes(-ray, spin)
    normal = np.cos(tilt) * frame[:, 2] + np.sin(tilt) * frame[:, 0]
    return distance * ray, normal, radius


def draw_clutter(rng: np.random.Generator) -> list[dot_scenes.Patch]:
    """Draw six rectangles of any grey behind the dot: edges, corners and dark bars that are no dots."""
    clutter = []
    for _ in range(6):
        ray = rng.normal(size=3)
        ray = ray * [1, 1, 0] + [0, 0, abs(ray[2])]
        ray /= np.linalg.norm(ray)
        half = tuple(rng.uniform(0.02, 0.3, 2))
        clutter.append(
            dot_scenes.Patch(ray, dot_scenes.plane_axes(-ray, rng.uniform(0, 3)), half, rng.uniform(10, 240))
        )
    return clutter


def dot_centres(count: int = 500, seed: int = 1) -> dict[str, Any]:
    """Find single dots at random poses: error against the projected centre, dots lost, false dots.

    Grey noise σ = 2 of 255, blur 0.4 px, camera of the paper, plate of 2.2–4 radii round the dot, clutter behind it.
    """
    camera = dot_scenes.paper_camera()
    rng = np.random.default_rng(seed)
    errors, seconds, lost, false, small = [], [], 0, 0, 0
    for _ in range(count):
        centre, normal, radius = draw_dot(camera, rng)
        patches = draw_clutter(rng) + dot_scenes.dot_patches(
            centre[None], normal[None], radius, board=rng.uniform(2.2, 4)
        )
        image = dot_scenes.render(
            camera, dot_scenes.Scene(patches, rng.uniform(40, 200)), noise=2, blur=0.4, rng=rng
        )
        started = time.perf_counter()
        dots = find_dots(image, camera)
        seconds.append(time.perf_counter() - started)
        off = np.linalg.norm(dots.pixels - camera.project(centre)[0], axis=1)
        false += int((off > 2).sum())
        if (off <= 2).any():
            errors.append(off.min())
        elif dot_scenes.image_area(camera, patches[-1]) >= 12:
            lost += 1
        else:
            small += 1
    return {
        "poses": count,
        "found": len(errors),
        "lost_of_12_px_or_more": lost,
        "not_found_below_12_px": small,
        "false_dots": false,
        "error_median_px": float(np.median(errors)),
        "error_p99_px": float(np.quantile(errors, 0.99)),
        "error_max_px": float(np.max(errors)),
        "seconds_median": float(np.median(seconds)),
    }


if __name__ == "__main__":
    print(dot_centres())
