"""Pairs of an arm's shapes whose contact says nothing, and pairs that MuJoCo would leave out and say much."""

from __future__ import annotations

from itertools import product
from typing import Any

import mujoco
import numpy as np

_POSTURES = 64

_BEARING = 0.005
"""[m] shapes on both sides of a joint that are nowhere farther apart are its bearing"""

_SAME = 1e-6
"""[m] between distances that a joint does not change"""

_FAR = 100.0
"""[m]"""

Pair = tuple[int, int]
"""of shapes, or of bodies"""


def choose_contacts(spec: Any, model: Any) -> list[str]:
    """State which shapes of an arm are kept off each other, where MuJoCo's own rules say it of whole links.

    MuJoCo leaves out links that carry each other, the base excepted. Here shapes of the base are kept off
    what the first joint carries, and what the last joint carries off the link before it (a gripper and a
    bracket are fixed to the last link), but for the joint's bearing: pairs that are nowhere farther apart
    than 5 mm, or whose distance the joint does not change. Pairs that overlap in every one of 64 random
    configurations are left out as well.

    Returns:
        Notices of the pairs that are left out.
    """
    of_body = _touched(model)
    known = {frozenset((exclude.bodyname1, exclude.bodyname2)) for exclude in spec.excludes}
    bodies = [pair for joint in (0, model.njnt - 1) for pair in _beside(model, joint)]
    bodies = [pair for pair in bodies if frozenset(_names(model, pair)) not in known]
    beside = [pair for each in bodies for pair in product(of_body[each[0]], of_body[each[1]])]
    bearing = {pair for pair in beside if _is_bearing(model, pair)}
    always = _always_touching(model) - set(beside)
    owners = {tuple(model.geom_bodyid[list(pair)].tolist()) for pair in always}
    for pair in sorted(owners | set(bodies)):
        spec.add_exclude(bodyname1=_names(model, pair)[0], bodyname2=_names(model, pair)[1])
    also = {pair for each in owners for pair in product(of_body[each[0]], of_body[each[1]])}
    for first, second in sorted((set(beside) - bearing) | (also - always)):
        spec.add_pair(geomname1=model.geom(first).name, geomname2=model.geom(second).name)
    return _notices(model, bearing, always)


def name_shapes(spec: Any) -> None:
    """Give the shapes that can be touched names, by which contacts are stated."""
    taken = {geom.name for geom in spec.geoms}
    for body in spec.bodies[1:]:
        for number, geom in enumerate(body.geoms, 1):
            name = f"{body.name} shape {number}"
            while not geom.name and name in taken:
                name += "'"
            geom.name = geom.name or name
            taken.add(geom.name)


def _touched(model: Any) -> list[list[int]]:
    """Return the shapes that can be touched of every body."""
    touched = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    return [np.flatnonzero(touched & (model.geom_bodyid == body)).tolist() for body in range(model.nbody)]


def _beside(model: Any, joint: int) -> list[Pair]:
    """Return the pairs of bodies with one joint between them, this one."""
    weld, carrier = model.body_weldid, int(model.jnt_bodyid[joint])
    before = weld[model.body_parentid[carrier]]
    first, second = (np.flatnonzero(weld[1:] == group) + 1 for group in (before, carrier))
    return list(product(first.tolist(), second.tolist()))


def _is_bearing(model: Any, pair: Pair) -> bool:
    """Tell whether two shapes with one joint between them cannot be brought apart, or nearer, by it."""
    data = mujoco.MjData(model)
    joint = int(model.body_jntadr[model.body_weldid[model.geom_bodyid[pair[1]]]])
    low, high = model.jnt_range[joint].tolist()
    gaps = []
    for angle in np.linspace(low, high, _POSTURES):
        data.qpos[joint] = angle
        mujoco.mj_kinematics(model, data)
        gaps.append(mujoco.mj_geomDistance(model, data, *pair, _FAR, None))
        if max(gaps) > _BEARING and np.ptp(gaps) > _SAME:
            return False
    return True


def _always_touching(model: Any) -> set[Pair]:
    data = mujoco.MjData(model)
    random = np.random.default_rng(0)
    pairs: set[Pair] | None = None
    for _ in range(_POSTURES):
        data.qpos[:] = random.uniform(model.jnt_range[:, 0], model.jnt_range[:, 1])
        mujoco.mj_fwdPosition(model, data)
        shapes = np.sort(data.contact.geom[data.contact.dist <= 0.0], axis=1)
        now = {(int(a), int(b)) for a, b in shapes.reshape(-1, 2)}
        pairs = now if pairs is None else pairs & now
        if not pairs:
            break
    return pairs or set()


def _notices(model: Any, bearing: set[Pair], always: set[Pair]) -> list[str]:
    said = (
        ("shapes beside one joint that it neither brings apart nor nearer, not kept off each other", bearing),
        ("shapes that overlap in every posture, not kept off each other", always),
    )
    return [f"{words}: {_spelled(model, pairs)}" for words, pairs in said if pairs]


def _spelled(model: Any, pairs: set[Pair]) -> str:
    owners = [tuple(model.geom_bodyid[list(pair)].tolist()) for pair in sorted(pairs)]
    of_body, spelled = _touched(model), []
    for pair in dict.fromkeys(owners):
        count, every = owners.count(pair), len(of_body[pair[0]]) * len(of_body[pair[1]])
        part = "" if count == every else f" ({count} of {every} pairs)"
        spelled.append(" and ".join(_names(model, pair)) + part)
    return ", ".join(spelled)


def _names(model: Any, bodies: tuple[int, ...]) -> list[str]:
    return [str(model.body(body).name) for body in bodies]
