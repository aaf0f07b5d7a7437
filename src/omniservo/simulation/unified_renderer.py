"""The image of the camera on the flange: one ray per pixel, more on edges, then lens and sensor."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import RigidTransform

from omniservo.cameras.image_mask import distance_beyond
from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray, IntArray
from omniservo.simulation.panel_pictures import Footprints, PanelPictures
from omniservo.simulation.pixel_edges import differs_from_neighbour, fill_between_alike, sheared_grid
from omniservo.simulation.ray_caster import MISS, RayCaster, daylight
from omniservo.simulation.world import World

DARK = 0.012
"""Linear grey outside the image circle, in the dead zone and in the mask."""

BACKGROUND = 0.25
"""Linear grey of rays that meet nothing."""

_THREADS = 2
_DOT_EDGE = 8  # rays per side of a pixel next to a dot: its centre is measured
_PANEL_EDGE = 6  # rays per side of a pixel on the outline of a panel
_OTHER_EDGE = 2  # rays per side of a pixel on any other edge
_TILES = 3  # per side of a pixel that sees nothing but one panel
_CONTRAST = 0.01  # neighbouring greys that differ by more lie on an edge
_CORNERS = np.array([[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5], [0.5, 0.5]])  # [px] of a pixel's square
_BLUR_REACH = 4.0  # standard deviations


class _Sight(NamedTuple):
    """What rays meet."""

    greys: FloatArray
    """(…) linear; of a picture: as if it were white"""
    is_dot: BoolArray
    """(…)"""
    panels: IntArray
    """(…) index of the panel whose picture is met, −1 for none"""


class UnifiedRenderer:
    """Renders a world through its unified camera, exact for every ξ: each ray starts at the camera's centre.

    A pixel shows the mean linear intensity over its square; pixels that the camera cannot unproject
    (outside the image circle or the model's domain), the dead zone and the mask are dark. The camera does
    not see its own housing, but it sees the arm.
    """

    def __init__(self, world: World) -> None:
        """Prepare the rays of all pixels, and two threads."""
        self.world = world
        """as given"""
        self._camera = world.scene.camera
        self._casters = [RayCaster(world, sees_camera=False) for _ in range(_THREADS)]
        self._is_dot = np.zeros(world.model.ngeom + 1, dtype=bool)  # the last entry answers for MISS = -1
        self._is_dot[world.dot_geoms] = True
        self._pool = ThreadPoolExecutor(_THREADS, thread_name_prefix="ray")
        u, v = np.meshgrid(np.arange(self._camera.width), np.arange(self._camera.height))
        pixels = np.stack([u, v], axis=-1).astype(np.float64)
        bearings, self._lit = self._sightlines(pixels)
        self._bearings = bearings.reshape(-1, 3)
        between = self._lit.copy()
        between[::2, ::2] = False
        self._between, self._nodes = between, np.flatnonzero(self._lit & ~between)
        self._rim = differs_from_neighbour(self._lit)
        if world.scene.panels:
            self._pictures = PanelPictures(world.scene.panels)
            self._footprints = Footprints(
                bearings, self._slope(pixels, [0.5, 0.0]), self._slope(pixels, [0.0, 0.5])
            )

    def render(self, q: FloatArray) -> FloatArray:
        """Return the linear intensity (height, width) in [0, 1] on the sensor, without blur and noise.

        Args:
            q: (n,) joints at the exposure [rad].
        """
        for caster in self._casters:
            pose = self.world.world_T_camera(caster.pose_arm(q))
        image, is_dot, panels = self._first_look(pose)
        fine = differs_from_neighbour(is_dot)
        outline = self._outline(pose, panels) if self.world.scene.panels else np.zeros_like(fine)
        printed = (panels >= 0) & ~outline
        edge = (differs_from_neighbour(image, _CONTRAST) | self._rim) & ~printed
        self._refine(image, pose, fine, _DOT_EDGE)
        self._refine(image, pose, outline & ~fine, _PANEL_EDGE)
        self._refine(image, pose, edge & ~outline & ~fine, _OTHER_EDGE)
        if printed.any():
            pixels = self._footprints.at(printed)
            image[printed] *= self._printed(pose, panels[printed], pixels, _TILES)
        return image

    def _first_look(self, pose: RigidTransform) -> _Sight:
        """What the pixels' centres meet, as images (height, width).

        Every second pixel of every second row is cast first: where four neighbours of these meet the same,
        a flat face evenly lit or nothing, so do the pixels between.
        """
        shape = self._lit.shape
        sight = _Sight(np.full(shape, DARK), np.zeros(shape, dtype=bool), np.full(shape, -1))
        self._look_at(sight, pose, self._nodes)
        known = fill_between_alike(sight, self._lit)
        self._look_at(sight, pose, np.flatnonzero(self._between & ~known))
        return sight

    def _look_at(self, sight: _Sight, pose: RigidTransform, chosen: IntArray) -> None:
        """Fill in what the centres of the chosen pixels, counted row by row, meet."""
        for image, met in zip(sight, self._in_parallel(pose, self._bearings[chosen]), strict=True):
            image.reshape(-1)[chosen] = met

    def photograph(self, q: FloatArray, noise: np.random.Generator) -> ByteArray:
        """Return the sensor's grey values (height, width): blurred, with noise, rounded.

        Args:
            q: (n,) joints at the exposure [rad].
            noise: source of the sensor's noise.
        """
        sensor = self.world.scene.sensor
        image = (255.0 * self.render(q)).astype(np.float32)
        if sensor.blur > 0.0:
            image = gaussian_filter(image, sensor.blur, mode="nearest", truncate=_BLUR_REACH)
        if sensor.noise > 0.0:
            image += np.float32(sensor.noise) * noise.standard_normal(image.shape, dtype=np.float32)
        grey_values: ByteArray = np.clip(np.rint(image, out=image), 0.0, 255.0, out=image).astype(np.uint8)
        return grey_values

    def _sightlines(self, pixels: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Bearings (…, 3) of pixels (…, 2), and which of them see the world."""
        bearings, valid = self._camera.unproject(pixels)
        zone = self._camera.dead_zone
        if zone is not None:
            offsets = pixels - np.asarray(zone.center)
            valid = valid & ((offsets**2).sum(axis=-1) > zone.radius**2)
        if self._camera.mask:
            valid = valid & (distance_beyond(self._camera.mask, pixels) > 0.0)
        return bearings, valid

    def _slope(self, pixels: FloatArray, step: list[float]) -> FloatArray:
        """Change of the bearings (…, 3) over twice a step [px]; 0 where one side cannot be unprojected."""
        ahead, ahead_valid = self._camera.unproject(pixels + step)
        behind, behind_valid = self._camera.unproject(pixels - step)
        return np.where((ahead_valid & behind_valid)[..., None], ahead - behind, 0.0)

    def _outline(self, pose: RigidTransform, panels: IntArray) -> BoolArray:
        """Which pixels see a panel (height, width) in a part of their square only."""
        outline = differs_from_neighbour(panels)
        rows, columns = np.nonzero(outline)
        bearings, lit = self._sightlines(np.stack([columns, rows], axis=-1)[:, None, :] + _CORNERS)
        seen = np.full(lit.shape, -1)
        seen[lit] = self._in_parallel(pose, bearings[lit]).panels
        outline[outline] = (seen != panels[outline][:, None]).any(axis=1)
        return outline

    def _refine(self, image: FloatArray, pose: RigidTransform, chosen: BoolArray, per_side: int) -> None:
        """Give the chosen pixels of the image the mean over a grid of rays, in place."""
        rows, columns = np.nonzero(chosen)
        bearings, lit = self._sightlines(
            np.stack([columns, rows], axis=-1)[:, None, :] + sheared_grid(per_side)
        )
        greys = np.full(lit.shape, DARK)
        sight = self._in_parallel(pose, bearings[lit])
        greys[lit] = sight.greys
        if (sight.panels >= 0).any():
            printed = np.flatnonzero(sight.panels >= 0)
            at = np.flatnonzero(lit.ravel())[printed]
            parent = self._footprints.at(chosen).at(at // per_side**2)
            rays = Footprints(bearings[lit][printed], parent.right / per_side, parent.down / per_side)
            greys.ravel()[at] *= self._printed(pose, sight.panels[printed], rays, 1)
        image[chosen] = greys.mean(axis=1)

    def _printed(self, pose: RigidTransform, panels: IntArray, pixels: Footprints, tiles: int) -> FloatArray:
        """Greys (n,) of the pictures that the pixels see, in two threads."""
        parts = np.array_split(np.arange(len(panels)), _THREADS)
        looks = self._pool.map(
            lambda part: self._pictures.greys(pose, panels[part], pixels.at(part), tiles), parts
        )
        return np.concatenate(list(looks))

    def _in_parallel(self, pose: RigidTransform, bearings: FloatArray) -> _Sight:
        """What is seen along the bearings (n, 3) from the camera at ``pose``."""
        world_R_camera = pose.rotation.as_matrix()
        origin = np.array(pose.translation)

        def look(caster: RayCaster, part: FloatArray) -> _Sight:
            geoms, _, normals = caster.cast(origin, np.einsum("ij,kj->ik", part, world_R_camera))
            panels = self.world.panels_at(geoms, normals)
            greys = np.where(panels >= 0, 1.0, self.world.luminance[geoms]) * daylight(normals)
            greys[geoms == MISS] = BACKGROUND
            return _Sight(greys, self._is_dot[geoms], panels)

        parts = list(self._pool.map(look, self._casters, np.array_split(bearings, _THREADS)))
        return _Sight(*(np.concatenate(kind) for kind in zip(*parts, strict=True)))
