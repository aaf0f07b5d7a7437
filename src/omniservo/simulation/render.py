"""Images of any MuJoCo model through any central camera, with depth and segmentation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError, spelled
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray, IntArray
from omniservo.geometry.single_pose import single_pose
from omniservo.simulation.largest_image import refuse_larger
from omniservo.simulation.model_light import ModelLight
from omniservo.simulation.model_rays import ModelRays
from omniservo.simulation.model_surfaces import ModelSurfaces
from omniservo.simulation.pixel_edges import differs_from_neighbour, sheared_grid

_EDGE = 3
"""rays per side of a pixel whose neighbours differ"""

_CONTRAST = 0.03
"""of colours in [0, 1], from which on neighbours differ"""

_AT_ONCE = 400_000
"""rays"""


@with_field_docs
@dataclass(frozen=True, eq=False)
class Rendering:
    """What a camera sees of a model."""

    image: ByteArray
    """(height, width, 3) colours as MuJoCo's renderer gives them; black where the lens sees nothing"""
    distance: FloatArray
    """(height, width) from the camera's centre along the ray of the pixel's centre [m]; NaN: nothing is met.
    Depth along the axis is distance times the bearing's z, which a wide lens has below 0, too"""
    geoms: IntArray
    """(height, width) number of the geom that the pixel's centre sees, −1: none"""
    valid: BoolArray
    """(height, width) pixels that see the world: inside the lens's domain, outside dead zone and mask"""


class ModelRenderer:
    """Renders a model through a camera, for many moments and poses."""

    def __init__(self, model: Any, camera: CentralModel) -> None:
        """Prepare the rays of all pixels.

        Args:
            model: a MuJoCo model (``mujoco.MjModel``).
            camera: any central camera.

        Raises:
            InputError: not a MuJoCo model, no camera, or one of more than 2²⁵ pixels.
        """
        if not isinstance(model, mujoco.MjModel):
            raise InputError(f"model: {spelled(model)} given; legal: a mujoco.MjModel")
        if not isinstance(camera, CentralModel):
            raise InputError(f"camera: {spelled(camera)} given; legal: a camera, as load_model returns it")
        refuse_larger(camera)
        self._model, self._camera = model, camera
        u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
        self._bearings, self._lit = self._sightlines(np.stack([u, v], axis=-1).astype(np.float64))
        self._rays, self._surfaces = ModelRays(model), ModelSurfaces(model)
        self._light = ModelLight(model)

    def render(self, data: Any, pose: RigidTransform) -> Rendering:
        """Return what the camera sees; see `render`."""
        if not isinstance(data, mujoco.MjData):
            raise InputError(f"data: {spelled(data)} given; legal: a mujoco.MjData of the model")
        if data.qpos.shape != (self._model.nq,) or data.geom_xpos.shape != (self._model.ngeom, 3):
            raise InputError(
                f"data: of another model: {data.qpos.size} positions; {self._model.nq} are legal"
            )
        single_pose("pose", pose)
        shape, lit = self._lit.shape, self._lit
        colours, geoms, distance = np.zeros((*shape, 3)), np.full(shape, -1), np.full(shape, np.nan)
        colours[lit], geoms[lit], distance[lit] = self._look(data, pose, self._bearings[lit])
        edge = differs_from_neighbour(geoms) | differs_from_neighbour(lit)
        for part in range(3):
            edge |= differs_from_neighbour(colours[..., part], _CONTRAST)
        self._refine(colours, data, pose, edge)
        image = np.rint(255.0 * colours).astype(np.uint8)
        return Rendering(image, distance, geoms, lit.copy())

    def _sightlines(self, pixels: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return bearings (…, 3) of pixels (…, 2), and which of them see the world."""
        bearings, valid = self._camera.unproject(pixels)
        return bearings, valid & self._camera.in_image(pixels)

    def _refine(self, colours: FloatArray, data: Any, pose: RigidTransform, edge: BoolArray) -> None:
        """Give pixels of the image (height, width, 3) the mean over a grid of rays, in place."""
        rows, columns = np.nonzero(edge)
        centres = np.stack([columns, rows], axis=-1).astype(np.float64)
        for part in np.array_split(np.arange(len(rows)), 1 + len(rows) * _EDGE**2 // _AT_ONCE):
            bearings, lit = self._sightlines(centres[part][:, None] + sheared_grid(_EDGE))
            finer = np.zeros((*lit.shape, 3))
            finer[lit] = self._look(data, pose, bearings[lit])[0]
            colours[rows[part], columns[part]] = finer.mean(axis=1)

    def _look(
        self, data: Any, pose: RigidTransform, bearings: FloatArray
    ) -> tuple[FloatArray, IntArray, FloatArray]:
        """Return colours (n, 3), geoms (n,) and distances (n,) that bearings (n, 3) see."""
        eye, directions = np.array(pose.translation), pose.rotation.apply(bearings)
        geoms, distances, normals = self._rays.cast(data, eye, directions)
        hit = geoms >= 0
        colours = np.empty(directions.shape)
        colours[~hit] = self._surfaces.sky(directions[~hit])
        points = eye + distances[hit, None] * directions[hit]
        paint = self._surfaces.paint(data, geoms[hit], points, normals[hit])
        colours[hit] = self._light.shaded(self._rays, data, eye, points, normals[hit], paint)
        return colours, geoms, np.where(hit, distances, np.nan)


def render(model: Any, data: Any, camera: CentralModel, pose: RigidTransform) -> Rendering:
    """Return what a camera sees of a MuJoCo model: image, distance and geom of every pixel.

    One ray a pixel, and nine where neighbours differ; each starts at the camera's centre, so that the image
    is exact for every central camera, beyond 90° from the axis, too. Colours, materials, textures, lights and
    shadows are those of MuJoCo's own renderer, but for what its documentation page names.

    Args:
        model: ``mujoco.MjModel``; its geoms of the groups 0, 1 and 2 are seen.
        data: ``mujoco.MjData`` of it, with positions computed (``mujoco.mj_forward``).
        camera: any central camera: a preset, or one that `load_model` or `load_camera` read.
        pose: world_T_camera, of a camera that looks along its z, x to the right, y down.

    Raises:
        InputError: one of them is not what it should be.
    """
    return ModelRenderer(model, camera).render(data, pose)
