"""Where a scene's dots are in an image, drawn at once: for tests of time, in the place of rendered images."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.geometry.arrays import ByteArray, FloatArray
from omniservo.scenes import Scene
from omniservo.simulation.largest_image import refuse_larger
from omniservo.simulation.simulated_robot import Exposure

PAPER, DOT = 200, 40
"""grey values"""

_ROUND = 48
"""corners of a dot's outline"""
_FINER = 8
"""so many places along each side of a pixel are sampled"""


class ProjectedDots:
    """Draws the outlines of all dots that face the camera; nothing is in their way, and there is no noise.

    They lie where the true camera's model has them: without the scene's lens error, dead zone and mask.

    Args:
        scene: with dots.

    Raises:
        InputError: it has none, or the camera has more than 2²⁵ pixels.
    """

    def __init__(self, scene: Scene) -> None:
        if scene.dots is None or not len(scene.dots.centers):
            raise InputError("--projected: the target has no dots, which alone are sent in place of pictures")
        refuse_larger(scene.camera)
        self._scene, dots = scene, scene.dots
        self._camera = scene.true_camera or scene.camera
        self._centers, self._normals = dots.centers, dots.normals
        across = np.cross(dots.normals, np.eye(3)[np.abs(dots.normals).argmin(axis=1)])
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        angles = 2.0 * np.pi * np.arange(_ROUND) / _ROUND
        sides = np.stack([across, np.cross(dots.normals, across)], axis=1)
        rings = dots.radius * np.stack([np.cos(angles), np.sin(angles)], axis=1) @ sides
        self._radius = dots.radius
        self._outlines: FloatArray = dots.centers[:, None] + rings
        """(n, _ROUND, 3) [m]"""

    def drawn(self, exposure: Exposure) -> ByteArray:
        """Return the grey values (height, width)."""
        joints = exposure.joints(0.0) if callable(exposure.joints) else exposure.joints
        world_T_camera = self._scene.world_T_camera(joints)
        eye = world_T_camera.translation
        facing = np.einsum("ni,ni->n", self._normals, eye - self._centers) > 0.0
        image = np.full((self._camera.height, self._camera.width), PAPER, dtype=np.uint8)
        for number in np.flatnonzero(facing):
            pixels, valid = self._camera.project(world_T_camera.inv().apply(self._outlines[number]))
            if valid.all():
                self._draw(image, int(number), pixels, world_T_camera)
        return image

    def _draw(
        self, image: ByteArray, number: int, outline: FloatArray, world_T_camera: RigidTransform
    ) -> None:
        """Draw a dot whose outline (k, 2) [px] is in view."""
        size = np.array(image.shape[::-1])
        low = np.floor(outline.min(axis=0)).astype(int).clip(0, size)
        high = (np.ceil(outline.max(axis=0)).astype(int) + 1).clip(0, size)
        if (low >= high).any():
            return
        fine = (np.arange(_FINER) + 0.5) / _FINER - 0.5
        u, v = (np.add.outer(np.arange(low[k], high[k]), fine) for k in range(2))
        pixels = np.stack(np.broadcast_arrays(u[None, None], v[:, :, None, None]), axis=-1)
        bearings, valid = self._camera.unproject(pixels.reshape(-1, 2))
        rays, eye = world_T_camera.rotation.apply(bearings), world_T_camera.translation
        center, normal = self._centers[number], self._normals[number]
        with np.errstate(divide="ignore", invalid="ignore"):
            met = eye + rays * (((center - eye) @ normal) / (rays @ normal))[:, None] - center
            covered = valid & (np.einsum("ni,ni->n", met, met) <= self._radius**2)
        share = covered.reshape(len(v), _FINER, len(u), _FINER).mean(axis=(1, 3))
        part = image[low[1] : high[1], low[0] : high[0]]
        part[:] = np.round(part + (DOT - PAPER) * share).clip(DOT, PAPER)
