"""Images of a study's scene, ray-cast: what a camera would see of points, balls and walls."""

from __future__ import annotations

import mujoco
import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import ByteArray, FloatArray
from omniservo.planning import Sphere
from omniservo.simulation.render import ModelRenderer
from omniservo.studies.study_scene import StudyScene

_BALL = 0.008
"""[m] radius of the dark ball that stands for a point"""
_LEAST = 1e-5
"""[m] smaller obstacles are not drawn"""
_WALLS = "".join(
    f'<geom type="box" pos="{" ".join(str(4.0 * s * (k == i)) for i in range(3))}" '
    f'size="{" ".join("0.1" if k == i else "4.2" for i in range(3))}" rgba="0.9 0.9 0.9 1"/>'
    for k in range(3)
    for s in (-1, 1)
)


class StudyRenderer:
    """Draws a scene through its stated camera: dark balls at the points, grey obstacles, light walls."""

    def __init__(self, scene: StudyScene) -> None:
        self._model = mujoco.MjModel.from_xml_string(_model_of(scene))
        self._data = mujoco.MjData(self._model)
        mujoco.mj_forward(self._model, self._data)
        self._renderer = ModelRenderer(self._model, scene.camera)

    def render(self, initial_T_camera: RigidTransform) -> ByteArray:
        """Return the image (height, width, 3) from a pose."""
        return self._renderer.render(self._data, initial_T_camera).image


def _model_of(scene: StudyScene) -> str:
    points = "".join(_ball(point, _BALL, 0.02) for point in scene.points)
    others = "".join(_obstacle(ball) for ball in scene.obstacles if ball.radius > _LEAST)
    lights = '<headlight ambient="0.9 0.9 0.9" diffuse="0.1 0.1 0.1" specular="0 0 0"/>'
    return f"<mujoco><visual>{lights}</visual><worldbody>{_WALLS}{points}{others}</worldbody></mujoco>"


def _obstacle(ball: Sphere) -> str:
    return _ball(np.asarray(ball.center), ball.radius, 0.75)


def _ball(place: FloatArray, radius: float, grey: float) -> str:
    at = " ".join(f"{x:.9f}" for x in place)
    return f'<geom type="sphere" pos="{at}" size="{radius:.6f}" rgba="{grey} {grey} {grey} 1"/>'
