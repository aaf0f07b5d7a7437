"""How a MuJoCo model's lights shine on its surfaces: as MuJoCo's renderer has it, with exact shadows."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.simulation.model_rays import ModelRays
from omniservo.simulation.model_surfaces import Paint

_DIRECTIONAL = int(mujoco.mjtLightType.mjLIGHT_DIRECTIONAL)
_SPOT, _IMAGE = int(mujoco.mjtLightType.mjLIGHT_SPOT), int(mujoco.mjtLightType.mjLIGHT_IMAGE)

_FAR = 1e3
"""of the scene's size: how far away a lamp stands whose rays are taken as parallel"""

_SELF_SHADOW = 1e-4
"""of the scene's size: what lies this near before a point does not shade it"""


class ModelLight:
    """Shades points.

    The headlight shines from the camera's centre in all directions: along one axis it would leave dark what
    a wide lens sees beside it.
    """

    def __init__(self, model: Any) -> None:
        """Prepare for a model."""
        self._model = model
        self._size = 2.0 * float(model.stat.extent)

    def shaded(
        self,
        rays: ModelRays,
        data: Any,
        eye: FloatArray,
        points: FloatArray,
        normals: FloatArray,
        paint: Paint,
    ) -> FloatArray:
        """Return the colours (n, 3) in [0, 1] of painted points (n, 3) seen from the eye; normals (n, 3)."""
        model = self._model
        to_eye = eye - points
        to_eye /= np.maximum(np.linalg.norm(to_eye, axis=1, keepdims=True), 1e-300)
        colours = paint.emission[:, None] * paint.colours
        head = model.vis.headlight
        if head.active:
            parts = (head.ambient, head.diffuse, head.specular)
            colours += _lit(paint, normals, to_eye, to_eye, parts)
        for light in np.flatnonzero(model.light_active):
            kind = int(model.light_type[light])
            if kind == _IMAGE:
                continue
            to_lamp, share = self._towards(data, int(light), kind, points)
            parts = (model.light_ambient[light], model.light_diffuse[light], model.light_specular[light])
            shone = share[:, None] * _lit(paint, normals, to_lamp, to_eye, parts)
            if model.light_castshadow[light]:
                shone[self._hidden(rays, data, int(light), kind, points)] = 0.0
            colours += shone
        if not head.active and not len(model.light_active):
            colours += _NO_LIGHTS * paint.colours
        return (colours * paint.texture).clip(0.0, 1.0)

    def _towards(self, data: Any, light: int, kind: int, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return directions (n, 3) to a light, and what share (n,) of it arrives."""
        model = self._model
        if kind == _DIRECTIONAL:
            return np.broadcast_to(-data.light_xdir[light], points.shape), np.ones(len(points))
        to_lamp = data.light_xpos[light] - points
        far = np.maximum(np.linalg.norm(to_lamp, axis=1), 1e-300)
        to_lamp = to_lamp / far[:, None]
        fading = model.light_attenuation[light].astype(np.float64)
        share = 1.0 / np.maximum(fading[0] + fading[1] * far + fading[2] * far**2, 1e-300)
        if kind == _SPOT:
            off_axis = (-to_lamp @ data.light_xdir[light]).clip(0.0, 1.0)
            inside = off_axis >= np.cos(np.radians(min(float(model.light_cutoff[light]), 90.0)))
            share = np.where(inside, share * off_axis ** float(model.light_exponent[light]), 0.0)
        return to_lamp, share

    def _hidden(self, rays: ModelRays, data: Any, light: int, kind: int, points: FloatArray) -> BoolArray:
        """Return which points (n,) something hides from a light: rays go from it to them."""
        lamp = np.array(data.light_xpos[light])
        if kind == _DIRECTIONAL:
            lamp = self._model.stat.center - _FAR * self._size * data.light_xdir[light]
        away = points - lamp
        far = np.linalg.norm(away, axis=1)
        met, distances, _ = rays.cast(data, lamp, away / np.maximum(far, 1e-300)[:, None])
        hidden: BoolArray = (met >= 0) & (distances < far - _SELF_SHADOW * self._size)
        return hidden


_NO_LIGHTS = 0.3
"""brightness where a model has no light at all"""


def _lit(
    paint: Paint,
    normals: FloatArray,
    to_lamp: FloatArray,
    to_eye: FloatArray,
    parts: tuple[Any, Any, Any],
) -> FloatArray:
    """Return the light (n, 3) that points send to the eye: ambient, diffuse, specular (Blinn and Phong)."""
    ambient, diffuse, specular = (np.asarray(part, dtype=np.float64) for part in parts)
    falling = np.einsum("ij,ij->i", normals, to_lamp)
    halfway = to_lamp + to_eye
    halfway /= np.maximum(np.linalg.norm(halfway, axis=1, keepdims=True), 1e-300)
    gloss = np.einsum("ij,ij->i", normals, halfway).clip(0.0) ** paint.shininess
    gloss = np.where(falling > 0.0, gloss * paint.specular, 0.0)
    matt = paint.colours * (ambient + falling.clip(0.0)[:, None] * diffuse)
    lit: FloatArray = matt + gloss[:, None] * specular
    return lit
