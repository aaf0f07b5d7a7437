"""A bystander's image of arm, obstacles and target: ordinary perspective, colour, light and shadow."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import InputError
from omniservo.geometry.arrays import (
    BoolArray,
    ByteArray,
    FloatArray,
    IntArray,
    finite_array,
    finite_number,
)
from omniservo.simulation.arm_pixels import ArmPixels
from omniservo.simulation.panel_pictures import Footprints, PanelPictures
from omniservo.simulation.pixel_edges import differs_from_neighbour, sheared_grid
from omniservo.simulation.ray_caster import MISS, RayCaster
from omniservo.simulation.world import World

_THREADS = 2
_EDGE = 2  # rays per side of a pixel on an edge
_TILES = 2  # per side of a pixel on a panel's picture
_CONTRAST = 0.08  # above a shadow's steps and the floor's tiles
_EVEN = 0.04  # neighbours that differ by less: their mean is as good as a ray between them
_SELF_SHADOW = 0.003  # [m] a surface this close before a point does not shade it
_LAMP_RADIUS = 0.30  # [m]
_LAMP_SHARE = 0.75
_GLOSS, _GLOSS_SHARE = 40.0, 0.18
_TILE = 0.1  # [m] squares of the floor
_TILE_CONTRAST = 0.06
_HAZE = 7.0  # [m] distance at which the floor has half faded into the background
_HORIZON = np.array([0.80, 0.84, 0.88])
_ZENITH = np.array([0.38, 0.50, 0.66])
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
_GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))


@dataclass(frozen=True)
class Viewpoint:
    """Where the bystander stands."""

    eye: tuple[float, float, float]
    """[m] in the world"""
    focus: tuple[float, float, float]
    """[m] the point in the middle of the image"""
    field_of_view: float = math.radians(36.0)
    """upright opening angle [rad]"""

    @classmethod
    def beside(cls, world: World) -> Viewpoint:
        """Return the view from the arm's right that shows arm and target of the world."""
        scene = world.scene
        base_R = scene.world_T_base.rotation
        points = [scene.world_T_base.apply([0.0, 0.0, 0.1]), scene.world_T_base.apply([0.0, 0.0, 0.75])]
        points.append(scene.world_T_camera(scene.start_joints).translation)
        if scene.dots is not None and len(scene.dots.centers):
            points += list(scene.dots.centers)
        points += [corner for panel in scene.panels for corner in panel.corners]
        middle = (np.min(points, axis=0) + np.max(points, axis=0)) / 2.0
        size = float(np.linalg.norm(np.max(points, axis=0) - np.min(points, axis=0)))
        eye = middle + 1.75 * size * base_R.apply(np.array([-0.55, -0.72, 0.42]))
        return cls(tuple(eye.tolist()), tuple(middle.tolist()))


@dataclass(frozen=True)
class _Look:
    """What the pixels' centres meet."""

    image: FloatArray
    """(height, width, 3) linear colours"""
    bodies: IntArray
    """(height, width)"""
    panels: IntArray
    """(height, width) whose image is met, −1 for none"""

    @classmethod
    def empty(cls, shape: tuple[int, int]) -> _Look:
        return cls(np.empty((*shape, 3)), np.empty(shape, dtype=np.int64), np.empty(shape, dtype=np.int64))

    def copied(self) -> _Look:
        return _Look(self.image.copy(), self.bodies.copy(), self.panels.copy())


class OutsideView:
    """Renders a world for people: colours, a soft lamp with shadows, smooth edges."""

    def __init__(
        self,
        world: World,
        viewpoint: Viewpoint | None = None,
        *,
        width: int = 640,
        height: int = 480,
        shadow_rays: int = 8,
        shows_camera: bool = True,
        films: bool = False,
    ) -> None:
        """Prepare.

        Args:
            world: what is seen.
            viewpoint: from where; None: `Viewpoint.beside`.
            width: [px]
            height: [px]
            shadow_rays: points of the lamp that each visible point is joined to; 0: no shadows, 1: hard ones.
                Time grows with it.
            shows_camera: whether the camera on the arm's flange is in the image.
            films: whether what stands still is drawn once, and each image anew only where the arm may cover
                or shade it: for many images of one world.

        Raises:
            InputError: eye and focus coincide or stand above each other, or a number is out of range.
        """
        finite_number("width", width, minimum=1)
        finite_number("height", height, minimum=1)
        finite_number("shadow_rays", shadow_rays, minimum=0)
        self._shape = (int(height), int(width))
        self._view = viewpoint or Viewpoint.beside(world)
        self._eye = finite_array("viewpoint.eye", self._view.eye, (3,))
        self._axes = _axes_of(self._view)
        self._focal = 0.5 * height / math.tan(0.5 * self._view.field_of_view)
        self._world = world
        self._pictures = PanelPictures(world.scene.panels)
        self._colours = np.vstack([world.model.geom_rgba[:, :3].astype(np.float64), np.zeros(3)])
        floor = world.model.geom_type == 0
        self._is_floor = np.append(floor, False)
        self._casters = [RayCaster(world, sees_camera=shows_camera) for _ in range(_THREADS)]
        self._pool = ThreadPoolExecutor(_THREADS, thread_name_prefix="view")
        focus = np.asarray(self._view.focus)
        self._lamp = focus + np.linalg.norm(self._eye - focus) * np.array([-0.35, -0.45, 1.15])
        self._lamp_points = _lamp_points(self._lamp, focus, int(shadow_rays))
        self._still = self._without_arm() if films else None

    def render(self, q: npt.ArrayLike) -> ByteArray:
        """Return the image (height, width, 3), 8 bit sRGB, with the arm in the joints ``q`` (n,) [rad].

        Raises:
            InputError: wrong shape, NaN or infinity.
        """
        joints = finite_array("q", q, (self._world.scene.arm.dof,))
        for caster in self._casters:
            caster.pose_arm(joints)
        if self._still is None:
            return self._drawn(self._casters, _Look.empty(self._shape), np.ones(self._shape, dtype=bool))
        look, picture, arm = self._still
        changed, drawn = arm.of(*self._casters[0].balls()), picture.copy()
        drawn[changed] = self._drawn(self._casters, look.copied(), changed)[changed]
        return drawn

    def _without_arm(self) -> tuple[_Look, ByteArray, ArmPixels]:
        """What the pixels meet without the arm, the image of it, and what the arm may change of it."""
        casters = [RayCaster(self._world, sees_camera=False, sees_arm=False) for _ in range(_THREADS)]
        for caster in casters:
            caster.pose_arm(self._world.scene.start_joints)
        look, everywhere = _Look.empty(self._shape), np.ones(self._shape, dtype=bool)
        picture = self._drawn(casters, look, everywhere)
        rays = self._rays(np.argwhere(everywhere)[:, ::-1].astype(np.float64))
        directions = rays / np.linalg.norm(rays, axis=1, keepdims=True) @ self._axes.T
        geoms, distances, _ = casters[0].cast(self._eye, directions)
        points = np.where(geoms[:, None] == MISS, np.nan, self._eye + distances[:, None] * directions)
        lamp = Viewpoint(tuple(self._lamp.tolist()), self._view.focus)
        return (
            look,
            picture,
            ArmPixels(
                (self._eye, self._axes),
                self._focal,
                (self._lamp, _axes_of(lamp)),
                _LAMP_RADIUS if len(self._lamp_points) > 1 else 0.0,
                points.reshape(*self._shape, 3),
            ),
        )

    def _drawn(self, casters: list[RayCaster], look: _Look, chosen: BoolArray) -> ByteArray:
        """Return the image, of which the ``chosen`` pixels are drawn, also in ``look``."""
        self._first_look(casters, look, chosen)
        edge = self._edges(look.image, look.panels) & chosen
        rows, columns = np.nonzero(edge)
        samples = np.stack([columns, rows], axis=-1)[:, None, :] + sheared_grid(_EDGE)
        finer, _, _ = self._colours_at(casters, samples.reshape(-1, 2), 1.0 / _EDGE)
        image = look.image.copy()
        image[edge] = finer.reshape(-1, _EDGE**2, 3).mean(axis=1)
        picture = np.zeros((*self._shape, 3), dtype=np.uint8)
        picture[chosen] = np.rint(255.0 * _srgb(np.clip(image[chosen], 0.0, 1.0)))
        return picture

    def _first_look(self, casters: list[RayCaster], look: _Look, chosen: BoolArray) -> None:
        """Fill in what the centres of the chosen pixels meet.

        Every second pixel of every second row is cast first: where four neighbours of these meet the same
        body in nearly the same light, the pixels between get the mean of theirs.
        """
        image, bodies, panels = look.image, look.bodies, look.panels
        known = np.zeros(self._shape, dtype=bool)
        known[::2, ::2] = True

        def cast(chosen: BoolArray) -> None:
            pixels = np.argwhere(chosen)[:, ::-1].astype(np.float64)
            image[chosen], bodies[chosen], panels[chosen] = self._colours_at(casters, pixels, 1.0)

        cast(known & chosen)
        a, b, c, d = corners = _corners_of_squares(image[::2, ::2])
        light = np.einsum("nijk,k->nij", corners, _LUMINANCE)
        body, panel = _corners_of_squares(bodies[::2, ::2]), _corners_of_squares(panels[::2, ::2])
        alike = (np.ptp(light, axis=0) < _EVEN) & (np.ptp(body, axis=0) == 0) & (panel < 0).all(axis=0)
        means = {(0, 1): (a + b) / 2.0, (1, 0): (a + c) / 2.0, (1, 1): (a + b + c + d) / 4.0}
        for (down, across), mean in means.items():
            at = (slice(down, 2 * len(alike), 2), slice(across, 2 * alike.shape[1], 2))
            image[at][alike], panels[at][alike], known[at] = mean[alike], -1, alike
        cast(~known & chosen)

    def project(self, points: npt.ArrayLike) -> FloatArray:
        """Return where points (…, 3) [m] of the world, before the eye, are in the image: (…, 2) [px]."""
        rays = (finite_array("points", points, (-1, 3)) - self._eye) @ self._axes
        height, width = self._shape
        middle = np.array([(width - 1) / 2.0, (height - 1) / 2.0])
        pixels: FloatArray = self._focal * rays[..., :2] / rays[..., 2:] + middle
        return pixels

    def _edges(self, image: FloatArray, panels: IntArray) -> BoolArray:
        """Where neighbours differ; within a panel its image is averaged over each pixel already."""
        printed = (panels >= 0) & ~differs_from_neighbour(panels)
        return differs_from_neighbour(np.einsum("ijk,k->ij", image, _LUMINANCE), _CONTRAST) & ~printed

    def _colours_at(
        self, casters: list[RayCaster], pixels: FloatArray, side: float
    ) -> tuple[FloatArray, IntArray, IntArray]:
        """Linear colours (n, 3) at pixels (n, 2) of this side [px], and the bodies, panels (n,) met there."""
        halves = np.array_split(pixels, _THREADS)
        looks = self._pool.map(lambda caster, half: self._look(caster, half, side), casters, halves)
        colours, bodies, panels = (np.concatenate(kind) for kind in zip(*looks, strict=True))
        return colours, bodies, panels

    def _look(
        self, caster: RayCaster, pixels: FloatArray, side: float
    ) -> tuple[FloatArray, IntArray, IntArray]:
        rays = self._rays(pixels)
        directions = np.einsum("ij,kj->ik", rays / np.linalg.norm(rays, axis=1, keepdims=True), self._axes)
        geoms, distances, normals = caster.cast(self._eye, directions)
        panels = self._world.panels_at(geoms, normals)
        colours = _sky(directions)
        hit = geoms != MISS
        points = self._eye + distances[hit, None] * directions[hit]
        surface = self._surface(geoms, panels, rays, side)[hit] * self._tiles(geoms[hit], points)[:, None]
        shaded = self._shade(caster, points, directions[hit], normals[hit], surface)
        haze = np.where(self._is_floor[geoms[hit]], 1.0 - np.exp2(-((distances[hit] / _HAZE) ** 2)), 0.0)[
            :, None
        ]
        colours[hit] = (1.0 - haze) * shaded + haze * colours[hit]
        return colours, geoms.astype(np.int64), panels

    def _rays(self, pixels: FloatArray) -> FloatArray:
        """Directions (n, 3) of pixels (n, 2): to the right, down, forward [px]."""
        height, width = self._shape
        rays = np.empty((len(pixels), 3))
        rays[:, 0] = pixels[:, 0] - (width - 1) / 2.0
        rays[:, 1] = pixels[:, 1] - (height - 1) / 2.0
        rays[:, 2] = self._focal
        return rays

    def _surface(
        self, geoms: npt.NDArray[np.int32], panels: IntArray, rays: FloatArray, side: float
    ) -> FloatArray:
        """Colours (n, 3) of what the rays meet, before any light."""
        surface = self._colours[geoms]
        printed = np.flatnonzero(panels >= 0)
        if len(printed):
            world_T_eye = RigidTransform.from_components(self._eye, Rotation.from_matrix(self._axes))
            right, down = (np.tile(side * np.eye(3)[axis], (len(printed), 1)) for axis in (0, 1))
            pixels = Footprints(rays[printed], right, down)
            surface[printed] = self._pictures.greys(world_T_eye, panels[printed], pixels, _TILES)[:, None]
        return surface

    def _tiles(self, geoms: npt.NDArray[np.int32], points: FloatArray) -> FloatArray:
        """Brightness (n,) of a chequered floor; 1 elsewhere."""
        even = np.floor(points[:, 0] / _TILE) + np.floor(points[:, 1] / _TILE)
        tone = np.where(even % 2 == 0, 1.0 + _TILE_CONTRAST, 1.0 - _TILE_CONTRAST)
        return np.where(self._is_floor[geoms], tone, 1.0)

    def _shade(
        self,
        caster: RayCaster,
        points: FloatArray,
        directions: FloatArray,
        normals: FloatArray,
        surface: FloatArray,
    ) -> FloatArray:
        """Colours (n, 3) under the sky's light, the lamp's (where it is not hidden) and its reflection."""
        to_lamp = self._lamp - points
        to_lamp /= np.linalg.norm(to_lamp, axis=1, keepdims=True)
        lamp = np.maximum(np.einsum("ij,ij->i", normals, to_lamp), 0.0)
        halfway = to_lamp - directions
        halfway /= np.linalg.norm(halfway, axis=1, keepdims=True)
        gloss = np.maximum(np.einsum("ij,ij->i", normals, halfway), 0.0) ** _GLOSS
        visible = np.zeros(len(points))
        visible[lamp > 0.0] = self._lamp_visible(caster, points[lamp > 0.0])
        sky = (1.0 - _LAMP_SHARE) * (1.3 + 0.7 * normals[:, 2])
        fill = 0.10 * np.maximum(-np.einsum("ij,ij->i", normals, directions), 0.0)
        matt = sky + fill + _LAMP_SHARE * lamp * visible
        shaded: FloatArray = surface * matt[:, None] + (_GLOSS_SHARE * gloss * visible)[:, None]
        return shaded

    def _lamp_visible(self, caster: RayCaster, points: FloatArray) -> FloatArray:
        """Share (n,) of the lamp that shines on each point: rays go from the lamp's points towards it."""
        if not len(self._lamp_points):
            return np.ones(len(points))
        visible = np.zeros(len(points))
        for lamp in self._lamp_points:
            ways = points - lamp
            lengths = np.linalg.norm(ways, axis=1)
            _, distances, _ = caster.cast(lamp, ways / lengths[:, None])
            visible += (distances < 0.0) | (distances > lengths - _SELF_SHADOW)
        return visible / len(self._lamp_points)


def _axes_of(view: Viewpoint) -> FloatArray:
    """Columns: right, down, forward in the world, (3, 3)."""
    forward = finite_array("viewpoint.focus", view.focus, (3,)) - np.asarray(view.eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    if np.linalg.norm(right) < 1e-6:
        raise InputError("viewpoint: eye and focus must not stand above each other")
    finite_number("viewpoint.field_of_view", view.field_of_view, above=0.0, maximum=3.0)
    down = np.cross(forward, right)
    return np.stack([axis / np.linalg.norm(axis) for axis in (right, down, forward)], axis=1)


def _corners_of_squares(nodes: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """The corners of each square of neighbours, (4, height − 1, width − 1, …): it, right, below, across."""
    return np.stack([nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, :-1], nodes[1:, 1:]])


def _lamp_points(lamp: FloatArray, focus: FloatArray, count: int) -> FloatArray:
    """Points (count, 3) spread over a disc that faces the focus: a sunflower's spiral; one: its centre."""
    facing = (focus - lamp) / np.linalg.norm(focus - lamp)
    across = np.cross(facing, [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    order = np.arange(count)
    radius = _LAMP_RADIUS * np.sqrt((order + 0.5) / max(count, 1)) * (count > 1)
    angle = order * _GOLDEN_ANGLE
    sideways = np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * np.cross(facing, across)
    points: FloatArray = lamp + radius[:, None] * sideways
    return points


def _sky(directions: FloatArray) -> FloatArray:
    height = np.clip(directions[:, 2], 0.0, 1.0)[:, None] ** 0.6
    sky: FloatArray = (1.0 - height) * _HORIZON + height * _ZENITH
    return sky


def _srgb(linear: FloatArray) -> FloatArray:
    """The transfer curve of IEC 61966-2-1."""
    return np.where(
        linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055
    )
