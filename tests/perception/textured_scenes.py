"""Textured rectangles seen through a camera, ray by ray, and where a pixel's point is seen again."""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation


def rough_texture(rng, size=1024, *, power=1.0):
    """Grey values (size, size), of 1/f noise and discs of all sizes: 20…235, periodic."""
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(size), np.fft.fftfreq(size)))
    spectrum = np.fft.fft2(rng.normal(size=(size, size))) / np.maximum(frequency, 2.0 / size) ** power
    noise = np.real(np.fft.ifft2(np.where(frequency > 0.35, 0.0, spectrum)))
    texture = 128.0 + 38.0 * noise / noise.std()
    for _ in range(size // 3):
        radius, around = float(rng.uniform(2.0, 14.0)), 16
        disc = np.zeros((2 * around, 2 * around), dtype=np.float32)
        axes = (int(16 * radius), int(16 * radius * rng.uniform(0.4, 1.0)))
        middle = tuple(int(k) for k in 16 * (around + rng.uniform(-0.5, 0.5, 2)))
        cv2.ellipse(disc, middle, axes, float(rng.uniform(0, 180)), 0, 360, 1.0, -1, cv2.LINE_AA, 4)
        rows, columns = (np.mod(int(k) + np.arange(2 * around), size) for k in rng.integers(0, size, 2))
        np.add.at(texture, np.ix_(rows, columns), int(rng.integers(-70, 70)) * disc)
    return np.clip(cv2.GaussianBlur(texture.astype(np.float32), (0, 0), 0.7), 20.0, 235.0)


@dataclass(frozen=True)
class Plate:
    """A rectangle with a texture that repeats."""

    world_T_plate: RigidTransform
    """its middle; the texture's columns run along x, its rows along y"""
    half_size: tuple[float, float]
    texture: np.ndarray
    texel: float
    """[m]"""

    def hits(self, origin, directions):
        """Distances along ``directions`` (n, 3), infinite where they miss, and places (n, 2) on the plate."""
        start = self.world_T_plate.inv().apply(origin)
        rays = self.world_T_plate.rotation.inv().apply(directions)
        with np.errstate(divide="ignore", invalid="ignore"):
            along = -start[2] / rays[:, 2]
            places = start[:2] + along[:, None] * rays[:, :2]
            on = (along > 1e-9) & (np.abs(places) <= self.half_size).all(1)
        return np.where(on, along, np.inf), places

    def grey(self, places):
        size = self.texture.shape[0]
        maps = np.mod(places / self.texel + size / 2, size).astype(np.float32)
        padded = np.pad(self.texture, ((0, 4), (0, 4)), mode="wrap")
        padded = np.pad(padded, ((4, 0), (4, 0)), mode="wrap")[: size + 8, : size + 8]
        rows = []
        for part in np.array_split(maps, len(maps) // 30_000 + 1):
            rows.append(cv2.remap(padded, part[:, :1] + 4, part[:, 1:] + 4, cv2.INTER_CUBIC)[:, 0])
        return np.concatenate(rows)


def cast(plates, world_T_camera, directions):
    """World points (n, 3), NaN where nothing is hit, and the number of the plate (n,), -1 for none."""
    rays = world_T_camera.rotation.apply(directions)
    distances = np.stack([p.hits(world_T_camera.translation, rays)[0] for p in plates])
    nearest = distances.argmin(0)
    distance = distances.min(0)
    hit = np.isfinite(distance)
    points = world_T_camera.translation + np.where(hit, distance, np.nan)[:, None] * rays
    return points, np.where(hit, nearest, -1)


def picture(camera, plates, world_T_camera, rng=None, *, noise=2.0, rays=3):
    """The camera's picture, each pixel the mean of rays² rays; with an rng, ``noise`` is added."""
    steps = (np.arange(rays) + 0.5) / rays - 0.5
    v, u = np.mgrid[0 : camera.height, 0 : camera.width].astype(float)
    total = np.zeros(u.size)
    for dv in steps:
        for du in steps:
            pixels = np.stack([(u + du).ravel(), (v + dv).ravel()], axis=1)
            bearings, valid = camera.unproject(pixels)
            grey = np.full(len(pixels), 25.0)
            rows = np.flatnonzero(valid)
            points, number = cast(plates, world_T_camera, bearings[rows])
            for k, plate in enumerate(plates):
                here = number == k
                if here.any():
                    grey[rows[here]] = plate.grey(plate.world_T_plate.inv().apply(points[here])[:, :2])
            total += np.where(valid, grey, 0.0)
    total /= rays * rays
    if rng is not None:
        total += rng.normal(0.0, noise, total.shape)
    return np.clip(np.rint(total), 0, 255).astype(np.uint8).reshape(camera.height, camera.width)


def seen_again(camera, plates, world_T_initial, world_T_goal, pixels):
    """Where the surface points of ``pixels`` (n, 2) are seen from the goal, NaN where they are not."""
    bearings, valid = camera.unproject(pixels)
    points, number = cast(plates, world_T_initial, np.where(valid[:, None], bearings, [[0.0, 0.0, 1.0]]))
    inside = world_T_goal.inv().apply(np.where(number[:, None] < 0, 1e3, points))
    distance = np.linalg.norm(inside, axis=1, keepdims=True)
    again, found = camera.project(inside)
    seen, _ = cast(plates, world_T_goal, inside / distance)
    clear = np.linalg.norm(seen - points, axis=1) < 1e-6
    ok = valid & (number >= 0) & found & clear & camera.in_image(np.where(found[:, None], again, -1e6))
    return np.where(ok[:, None], again, np.nan)


def pose(translation, turn_deg=(0.0, 0.0, 0.0)):
    """A pose from a position [m] and a rotation vector [deg]."""
    return RigidTransform.from_components(translation, Rotation.from_rotvec(np.radians(turn_deg)))


def facing_plate(texture, direction_deg, *, distance=0.5, half=0.3, tilt_deg=0.0, azimuth_deg=0.0):
    """A plate in the direction (angle from the axis, azimuth), facing the origin but for a tilt."""
    turn = Rotation.from_euler("ZY", [azimuth_deg, direction_deg], degrees=True)
    tilt = Rotation.from_euler("x", tilt_deg, degrees=True)
    place = RigidTransform.from_components(turn.apply([0.0, 0.0, distance]), turn * tilt)
    return Plate(place, (half, half), texture, 0.004)


def relief(rng):
    """A wall behind two smaller plates, at three depths."""
    return [
        Plate(pose([0.0, 0.0, 0.7], [0, 15, 0]), (0.8, 0.8), rough_texture(rng), 0.004),
        Plate(pose([-0.2, 0.1, 0.5], [20, -20, 0]), (0.15, 0.15), rough_texture(rng), 0.003),
        Plate(pose([0.25, -0.1, 0.45], [0, 25, 10]), (0.12, 0.18), rough_texture(rng), 0.003),
    ]


def corner(rng):
    """Two walls that meet before the camera, and the floor."""
    return [
        Plate(pose([-0.35, 0.0, 0.7], [0, -50, 0]), (0.8, 0.8), rough_texture(rng), 0.004),
        Plate(pose([0.35, 0.0, 0.7], [0, 50, 0]), (0.8, 0.8), rough_texture(rng), 0.004),
        Plate(pose([0.0, 0.4, 0.6], [70, 0, 0]), (0.9, 0.6), rough_texture(rng), 0.004),
    ]


def tiles(rng, period):
    """A texture (1024, 1024) that repeats every ``period`` texels."""
    return np.tile(rough_texture(rng, period, power=0.6), (1024 // period, 1024 // period))
