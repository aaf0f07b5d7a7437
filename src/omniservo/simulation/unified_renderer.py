"""The image of the camera on the flange: one ray per pixel, more on edges, then lens and sensor."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple, TypeAlias

import mujoco
import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray, IntArray
from omniservo.scenes import Light
from omniservo.simulation.exposure_times import exposure_times
from omniservo.simulation.largest_image import refuse_larger
from omniservo.simulation.panel_pictures import Footprints, PanelPictures
from omniservo.simulation.pixel_edges import differs_from_neighbour, fill_between_alike, sheared_grid
from omniservo.simulation.ray_caster import MISS, RayCaster
from omniservo.simulation.sensor_effects import grey_values
from omniservo.simulation.true_lens import TrueLens
from omniservo.simulation.world import ARM_GROUP, World

DARK = 0.012
"""Linear grey outside the image circle, in the dead zone and in the mask."""

BACKGROUND = 0.25
"""Linear grey of rays that meet nothing, in a light of brightness 1."""

MOVING_STEP = 0.5
"""[px] Images of a moving camera are mixed of sharp ones so far apart."""
STANDS_STILL = 0.1
"""[px] A camera whose image moves by less while it is taken counts as standing still."""

JointsAt: TypeAlias = Callable[[float], FloatArray]
"""From the time since an image's time stamp [s] to the joints (n,) [rad]"""

_THREADS = 2
_DOT_EDGE = 8  # rays per side of a pixel next to a dot: its centre is measured
_PANEL_EDGE = 6  # rays per side of a pixel on the outline of a panel
_OTHER_EDGE = 2  # rays per side of a pixel on any other edge
_TILES = 3  # per side of a pixel that sees nothing but one panel
_CONTRAST = 0.01  # neighbouring greys that differ by more lie on an edge
_CORNERS = np.array([[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5], [0.5, 0.5]])  # [px] of a pixel's square
_LOOKS = 24  # pixels along a side of the image whose motion is asked for
_MOST = 0.9  # share of them that move by less than what counts


class _Sight(NamedTuple):
    """What rays meet."""

    greys: FloatArray
    """(…) linear; of an image: as if it were white"""
    is_dot: BoolArray
    """(…)"""
    panels: IntArray
    """(…) index of the panel whose image is met, −1 for none"""
    meshes: IntArray
    """(…) geom of the arm's mesh that is met, −1 for none"""


class _Look(NamedTuple):
    """From where, in what light, and through which rows of pixels is looked."""

    pose: RigidTransform
    light: Light
    rows: slice
    fineness: int
    """rays and tiles per side of a pixel are these many times fewer"""

    def per_side(self, full: int) -> int:
        """Return how many go along a side of a pixel where ``full`` would of a camera that stands still."""
        return max(full // self.fineness, 1)


class UnifiedRenderer:
    """Renders a world through its camera's true lens, exact for every one: each ray starts at its centre.

    A pixel shows the mean linear intensity over its square, one within a mesh of the arm that of its centre;
    pixels that the camera cannot unproject (outside the image circle or the model's domain), the dead zone
    and the mask are dark. The camera does not see its own housing, but it sees the arm.
    """

    def __init__(self, world: World) -> None:
        """Prepare the rays of all pixels, and two threads.

        Raises:
            InputError: the camera has more than 2²⁵ pixels.
        """
        refuse_larger(world.scene.camera)
        self.world = world
        """as given"""
        self._lens = TrueLens(world.scene)
        self._casters = [RayCaster(world, sees_camera=False) for _ in range(_THREADS)]
        self._is_dot = np.zeros(world.model.ngeom + 1, dtype=bool)  # the last entry answers for MISS = -1
        self._is_dot[world.dot_geoms] = True
        model, geoms = world.model, np.arange(world.model.ngeom)
        is_mesh = (model.geom_group == ARM_GROUP) & (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH)
        self._mesh_of = np.append(np.where(is_mesh, geoms, -1), -1)
        self._pool = ThreadPoolExecutor(_THREADS, thread_name_prefix="ray")
        camera = world.scene.camera
        u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
        pixels = np.stack([u, v], axis=-1).astype(np.float64)
        self._bearings, self._lit = self._lens.sightlines(pixels)
        self._between = self._lit.copy()
        self._between[::2, ::2] = False
        self._rim = differs_from_neighbour(self._lit)
        if world.scene.panels:
            self._pictures = PanelPictures(world.scene.panels)
            right, down = (self._lens.slope(pixels, step) for step in ([0.5, 0.0], [0.0, 0.5]))
            self._footprints = Footprints(self._bearings, right, down)

    def render(self, q: FloatArray, light: Light | None = None) -> FloatArray:
        """Return the linear intensity (height, width) on a sensor that stands still, in the lens's focus.

        Args:
            q: (n,) joints at the exposure [rad].
            light: in which the world is seen; None: the scene's first.
        """
        return self._sharp(q, light or self.world.scene.lights[0], slice(0, len(self._lit)), 1)

    def expose(self, joints_at: JointsAt, light: Light | None = None) -> FloatArray:
        """Return the linear intensity (height, width) on the sensor of a camera that may move meanwhile.

        Each row shows the mean over its own exposure (`Sensor`). The image is mixed of sharp ones
        `MOVING_STEP` apart, between which it is taken to change evenly; of one alone where less than
        `STANDS_STILL` changes. By how much it moves is what nine of ten pixels of a grid stay below.

        Args:
            joints_at: at any time from `Sensor.half_span` before the time stamp until that after it.
            light: in which the world is seen; None: the scene's first.
        """
        sensor, light = self.world.scene.sensor, light or self.world.scene.lights[0]
        span = sensor.half_span
        moved = self._motion(joints_at(-span), joints_at(span)) if span > 0.0 else 0.0
        if moved < STANDS_STILL:
            return self.render(joints_at(0.0), light)
        height = len(self._lit)
        image = np.zeros(self._lit.shape)
        times, weights = exposure_times(sensor, height, int(np.ceil(moved / MOVING_STEP)))
        for time, weight in zip(times, weights, strict=True):
            if not weight.any():  # between two rows
                continue
            seeing = np.flatnonzero(weight)
            rows = slice(int(seeing[0]), int(seeing[-1]) + 1)
            image[rows] += weight[rows, None] * self._sharp(joints_at(time), light, rows, 2)
        return image

    def photograph(
        self, joints: FloatArray | JointsAt, noise: np.random.Generator, light: Light | None = None
    ) -> ByteArray:
        """Return the grey values (height, width) that the camera delivers.

        Args:
            joints: (n,) of an arm that stands still [rad], or as `expose` takes them.
            noise: source of the sensor's noise.
            light: in which the world is seen; None: the scene's first.
        """
        image = self.expose(joints, light) if callable(joints) else self.render(joints, light)
        return grey_values(image, self.world.scene.sensor, noise)

    def _motion(self, before: FloatArray, after: FloatArray) -> float:
        """Return by how much most of what stands still moves in the image between two configurations [px]."""
        camera = self.world.scene.camera
        u, v = (np.linspace(0.0, side - 1.0, _LOOKS) for side in (camera.width, camera.height))
        pixels = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
        caster = self._casters[0]
        first, last = (self.world.world_T_camera(caster.pose_arm(q)) for q in (before, after))
        bearings, lit = camera.unproject(pixels)
        directions = last.rotation.apply(bearings[lit])
        geoms, distances, _ = caster.cast(np.array(last.translation), np.ascontiguousarray(directions))
        still = (geoms == MISS) | (self.world.model.geom_group[geoms] != ARM_GROUP)
        distances = np.where(distances >= 0.0, distances, 1e3)[still, None]
        moved, seen = camera.project(first.inv().apply(last.translation + distances * directions[still]))
        lengths = np.linalg.norm((moved - pixels[lit][still])[seen], axis=1)
        return float(np.quantile(lengths, _MOST)) if len(lengths) else 0.0

    def _sharp(self, q: FloatArray, light: Light, rows: slice, fineness: int) -> FloatArray:
        """Return the linear intensity (rows, width) of some rows, as `render` has them."""
        for caster in self._casters:
            pose = self.world.world_T_camera(caster.pose_arm(q))
        first = max(rows.start // 2 * 2 - 2, 0)  # neighbours, and whole squares of four nodes
        look = _Look(pose, light, slice(first, min(rows.stop + 3, len(self._lit))), fineness)
        image, is_dot, panels, meshes = self._first_look(look)
        fine = differs_from_neighbour(is_dot)
        outline = self._outline(look, panels) if self.world.scene.panels else np.zeros_like(fine)
        printed = (panels >= 0) & ~outline
        facets = (meshes >= 0) & ~differs_from_neighbour(meshes)  # a link has thousands, each of its own grey
        edge = (differs_from_neighbour(image, _CONTRAST) & ~facets | self._rim[look.rows]) & ~printed
        wanted = np.zeros_like(fine)
        wanted[rows.start - first : rows.stop - first] = True
        self._refine(image, look, wanted & fine, _DOT_EDGE)
        self._refine(image, look, wanted & outline & ~fine, _PANEL_EDGE)
        self._refine(image, look, wanted & edge & ~outline & ~fine, _OTHER_EDGE)
        printed &= wanted
        if printed.any():
            pixels = self._footprints_of(look).at(printed)
            image[printed] *= self._printed(pose, panels[printed], pixels, look.per_side(_TILES))
        return image[rows.start - first : rows.stop - first]

    def _first_look(self, look: _Look) -> _Sight:
        """What the pixels' centres meet, as images (rows, width).

        Every second pixel of every second row is cast first: where four neighbours of these meet the same,
        a flat face evenly lit or nothing, so do the pixels between.
        """
        lit, between = self._lit[look.rows], self._between[look.rows]
        nothing = np.full(lit.shape, -1)
        sight = _Sight(np.full(lit.shape, DARK), np.zeros(lit.shape, dtype=bool), nothing, nothing.copy())
        self._look_at(sight, look, lit & ~between)
        known = fill_between_alike(sight, lit)
        self._look_at(sight, look, between & ~known)
        return sight

    def _look_at(self, sight: _Sight, look: _Look, chosen: BoolArray) -> None:
        """Fill in what the centres of the chosen pixels (rows, width) meet."""
        for image, met in zip(sight, self._in_parallel(look, self._bearings[look.rows][chosen]), strict=True):
            image[chosen] = met

    def _footprints_of(self, look: _Look) -> Footprints:
        return Footprints(*(part[look.rows] for part in self._footprints))

    def _outline(self, look: _Look, panels: IntArray) -> BoolArray:
        """Which pixels see a panel (rows, width) in a part of their square only."""
        outline = differs_from_neighbour(panels)
        rows, columns = np.nonzero(outline)
        pixels = np.stack([columns, rows + look.rows.start], axis=-1)
        bearings, lit = self._lens.sightlines(pixels[:, None, :] + _CORNERS)
        seen = np.full(lit.shape, -1)
        seen[lit] = self._in_parallel(look, bearings[lit]).panels
        outline[outline] = (seen != panels[outline][:, None]).any(axis=1)
        return outline

    def _refine(self, image: FloatArray, look: _Look, chosen: BoolArray, full: int) -> None:
        """Give the chosen pixels of the image the mean over a grid of rays, in place."""
        per_side = look.per_side(full)
        rows, columns = np.nonzero(chosen)
        pixels = np.stack([columns, rows + look.rows.start], axis=-1)
        bearings, lit = self._lens.sightlines(pixels[:, None, :] + sheared_grid(per_side))
        greys = np.full(lit.shape, DARK)
        sight = self._in_parallel(look, bearings[lit])
        greys[lit] = sight.greys
        if (sight.panels >= 0).any():
            printed = np.flatnonzero(sight.panels >= 0)
            at = np.flatnonzero(lit.ravel())[printed]
            parent = self._footprints_of(look).at(chosen).at(at // per_side**2)
            rays = Footprints(bearings[lit][printed], parent.right / per_side, parent.down / per_side)
            greys.ravel()[at] *= self._printed(look.pose, sight.panels[printed], rays, 1)
        image[chosen] = greys.mean(axis=1)

    def _printed(self, pose: RigidTransform, panels: IntArray, pixels: Footprints, tiles: int) -> FloatArray:
        """Greys (n,) of the images that the pixels see, in two threads."""
        parts = np.array_split(np.arange(len(panels)), _THREADS)
        looks = self._pool.map(
            lambda part: self._pictures.greys(pose, panels[part], pixels.at(part), tiles), parts
        )
        return np.concatenate(list(looks))

    def _in_parallel(self, look: _Look, bearings: FloatArray) -> _Sight:
        """What is seen along the bearings (n, 3)."""
        world_R_camera, light = look.pose.rotation.as_matrix(), look.light
        origin = np.array(look.pose.translation)

        def seen_by(caster: RayCaster, part: FloatArray) -> _Sight:
            geoms, _, normals = caster.cast(origin, np.einsum("ij,kj->ik", part, world_R_camera))
            panels = self.world.panels_at(geoms, normals)
            greys = np.where(panels >= 0, 1.0, self.world.luminance[geoms]) * light.share(normals)
            greys[geoms == MISS] = light.brightness * BACKGROUND
            return _Sight(greys, self._is_dot[geoms], panels, self._mesh_of[geoms])

        parts = list(self._pool.map(seen_by, self._casters, np.array_split(bearings, _THREADS)))
        return _Sight(*(np.concatenate(kind) for kind in zip(*parts, strict=True)))
