"""Perception against exactly rendered pictures and drawn views: the protocols behind the stated figures.

Run: ``python -m benchmarks.perception_accuracy``. Both protocols are seeded; no draw is thrown away.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from omniservo.cameras import UnifiedCamera
from omniservo.perception import FoundDots, find_dots, match_dots

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "perception"))

import dot_scenes

Array = npt.NDArray[np.float64]


def draw_dot(camera: UnifiedCamera, rng: np.random.Generator) -> tuple[Array, Array, float]:
    """Draw one dot: centre [m], normal, radius [m].

    Distance 0.2–0.6 m, angle from the optical axis 0–80°, tilt of the dot against the line of sight 0–60°,
    radius 6–10 mm, all uniform; the azimuth is uniform over the directions in which the whole dot and 6 px
    around it are in the image.
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

    Grey noise σ = 2 of 255, blur 0.4 px, camera of the paper, plate of 2.2–4 radii round the dot, clutter
    behind it.
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


def draw_layout(rng: np.random.Generator) -> tuple[Array, Array]:
    """Draw nine dots: centres (9, 3) and normals (9, 3) in the target's frame, normals about -z.

    Half of the draws are 3×3 dots on two boards that meet at a ridge, off the boards by ± 4 mm, as in the
    paper's scenes; half are nine places in a box of 200×160×80 mm, at least 40 mm apart, normals within 25°
    of -z.
    """
    if rng.random() < 0.5:
        i, k = (grid.ravel().astype(float) for grid in np.meshgrid([-1, 0, 1], [-1, 0, 1]))
        step_x, step_y, drop = rng.uniform(0.05, 0.08), rng.uniform(0.05, 0.06), rng.uniform(0.03, 0.07)
        i_, k_ = i + rng.uniform(-0.1, 0.1, 9), k + rng.uniform(-0.1, 0.1, 9)
        off = rng.choice([-0.004, 0.004], 9)
        centres = np.stack([i_ * step_x, k_ * step_y, -np.abs(i_) * drop + off], 1)
        normals = np.stack([-i * drop, 0 * i, np.where(i, -step_x, -1.0)], 1)
    else:
        places: list[Array] = []
        while len(places) < 9:
            place = rng.uniform(-0.5, 0.5, 3) * [0.2, 0.16, 0.08]
            if all(np.linalg.norm(place - other) >= 0.04 for other in places):
                places.append(place)
        centres = np.array(places)
        lean, turn = np.deg2rad(rng.uniform(0, 25, 9)), rng.uniform(0, 2 * np.pi, 9)
        normals = np.stack([np.sin(lean) * np.cos(turn), np.sin(lean) * np.sin(turn), -np.cos(lean)], 1)
    return centres, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def draw_view(
    camera: UnifiedCamera, centres: Array, normals: Array, radius: float, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Draw a view that sees all dots: centres and normals in the camera frame.

    Distance 0.25–0.55 m, line of sight up to 40° from the target's axis, target up to 35° from the optical
    axis, roll ± 180°. A view that does not see all nine dots under 70° at most, 6 px from the border, of 12
    px² or more, is not a view of the target: another is drawn.
    """
    while True:
        lean, turn, roll = np.deg2rad(rng.uniform(0, 40)), *rng.uniform(-np.pi, np.pi, 2)
        aside, where = np.deg2rad(rng.uniform(0, 35)), rng.uniform(-np.pi, np.pi)
        rotation = (
            Rotation.from_rotvec([aside * np.cos(where), aside * np.sin(where), 0])
            * Rotation.from_rotvec([0, 0, roll])
            * Rotation.from_rotvec([lean * np.cos(turn), lean * np.sin(turn), 0])
        )
        sight = Rotation.from_rotvec([aside * np.cos(where), aside * np.sin(where), 0]).apply([0, 0, 1])
        seen = rotation.apply(centres) + rng.uniform(0.25, 0.55) * sight
        faces = rotation.apply(normals)
        facing = -(faces * seen).sum(1) / np.linalg.norm(seen, axis=1)
        pixels, valid = camera.project(seen)
        size = np.array([camera.width, camera.height])
        inside = ((pixels > 6) & (pixels < size - 7)).all()
        if valid.all() and inside and facing.min() > np.cos(np.deg2rad(70)):
            patches = [
                dot_scenes.Patch(c, dot_scenes.plane_axes(f), (radius, radius), 0.0, True)
                for c, f in zip(seen, faces, strict=True)
            ]
            if min(dot_scenes.image_area(camera, patch) for patch in patches) >= 12:
                return seen, faces


def seen_dots(
    camera: UnifiedCamera, centres: Array, normals: Array, radius: float, rng: np.random.Generator
) -> tuple[FoundDots, npt.NDArray[np.int64]]:
    """Dots as `find_dots` would report them, with its errors drawn, in random order; and which is which.

    Errors (σ): centre 0.01 px + 0.2 px³/area; area 0.4 px² (see `dot_centres`).
    """
    ring = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    pixels, covariances, areas = camera.project(centres)[0], [], []
    for centre, normal in zip(centres, normals, strict=True):
        patch = dot_scenes.Patch(centre, dot_scenes.plane_axes(normal), (radius, radius), 0.0, True)
        outline = camera.project(patch.outline(len(ring)))[0]
        off = outline - outline.mean(0)
        area = dot_scenes.image_area(camera, patch)
        areas.append(area)
        # the outline of an ellipse has twice the second moments of its inside
        covariances.append(0.5 * off.T @ off / len(ring) * (1 + rng.normal(0, 0.4) / area))
    sigma = 0.01 + 0.2 / np.array(areas)
    order = rng.permutation(len(centres))
    pixels = pixels + rng.normal(size=pixels.shape) * sigma[:, None]
    return FoundDots(pixels[order], np.array(areas)[order], np.array(covariances)[order]), order


def matching(count: int = 500, seed: int = 2) -> dict[str, Any]:
    """Match nine dots between two drawn views of drawn layouts, without any prior: right, refused, wrong."""
    camera = dot_scenes.paper_camera()
    rng = np.random.default_rng(seed)
    seconds, wrong, refused, right, reasons = [], 0, 0, 0, []
    for _ in range(count):
        centres, normals = draw_layout(rng)
        radius = rng.uniform(0.006, 0.010)
        dots_a, order_a = seen_dots(camera, *draw_view(camera, centres, normals, radius, rng), radius, rng)
        dots_b, order_b = seen_dots(camera, *draw_view(camera, centres, normals, radius, rng), radius, rng)
        started = time.perf_counter()
        match = match_dots(camera, dots_a, dots_b)
        seconds.append(time.perf_counter() - started)
        if match.status != "ok":
            refused += 1
            reasons.append(f"{match.status}: {match.reason}")
        elif (order_a[match.pairs[:, 0]] != order_b[match.pairs[:, 1]]).any():
            wrong += 1
        else:
            right += 1
    return {
        "layouts": count,
        "right": right,
        "refused": refused,
        "wrong": wrong,
        "reasons": reasons,
        "seconds_median": float(np.median(seconds)),
    }


if __name__ == "__main__":
    print(dot_centres())
    print(matching())
