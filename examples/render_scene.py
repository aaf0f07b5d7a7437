"""Draw a MuJoCo scene through three lenses, with depth and segmentation of every pixel.

Prints for each lens what share of the image sees the world, the nearest thing and its distance, and the
angle from the axis at which the outermost thing is seen; writes the images.
"""

import math
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image
from scipy.spatial.transform import RigidTransform, Rotation

import omniservo

SCENE = Path(__file__).parent / "scene.xml"


def main() -> None:
    folder = Path("out")
    folder.mkdir(exist_ok=True)
    model = mujoco.MjModel.from_xml_path(str(SCENE))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)

    # A camera looks along its z, with x to the right and y down: here level, and 10 degrees downwards.
    world_T_camera = RigidTransform.from_components(
        [0.0, -0.9, 0.5], Rotation.from_euler("x", -100, degrees=True)
    )
    for name in ("perspective", "fe185", "hyper-catadioptric"):
        camera = omniservo.preset(name)
        seen = omniservo.render(model, data, camera, world_T_camera)
        Image.fromarray(seen.image).save(folder / f"{name}.png")

        row, column = np.unravel_index(np.nanargmin(seen.distance), seen.distance.shape)
        nearest = model.geom(seen.geoms[row, column]).name
        rows, columns = np.nonzero(seen.geoms >= 0)
        bearings, _ = camera.unproject(np.stack([columns, rows], axis=-1).astype(float))
        outermost = math.degrees(math.acos(bearings[:, 2].min()))
        print(
            f"{name}: {100 * seen.valid.mean():.0f}% of the image sees the world; {nearest} is nearest, "
            f"{1e3 * seen.distance[row, column]:.0f} mm; things up to {outermost:.0f} deg from the axis"
        )


if __name__ == "__main__":
    main()
