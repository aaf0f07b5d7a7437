"""Which shapes of a link are seen and which are touched."""

from __future__ import annotations

from typing import Any

import numpy as np

from omniservo.robots.arm_files.arm_model import HIDDEN_GROUP, SHOWN_GROUP

_UNPAINTED = (0.5, 0.5, 0.5, 1.0)


def paint(spec: Any) -> None:
    """Give each shape the colour of its material: rays know no materials."""
    colours = {material.name: material.rgba for material in spec.materials}
    for geom in spec.geoms:
        if geom.material in colours and np.allclose(geom.rgba, _UNPAINTED):
            geom.rgba = colours[geom.material]


def share_groups(spec: Any) -> list[str]:
    """Let each link be seen by its visual shapes and touched by the others; say what stands for what.

    A link that has only one kind is seen and touched by that: nothing of an arm is without contact.
    """
    stand_in = []
    for body in spec.bodies[1:]:
        touched = [geom for geom in body.geoms if geom.contype or geom.conaffinity]
        visual = [geom for geom in body.geoms if not (geom.contype or geom.conaffinity)]
        if visual and not touched:
            stand_in.append(body.name)
            touched, visual = visual, []
        for geom in touched:
            geom.contype = geom.conaffinity = 1
            geom.group = HIDDEN_GROUP if visual else SHOWN_GROUP
        for geom in visual:
            geom.group, geom.mass = SHOWN_GROUP, 0.0
    if not stand_in:
        return []
    return [f"links without collision shapes, touched by what is seen of them: {', '.join(stand_in)}"]
