"""Pairs of links whose contact says nothing."""

from __future__ import annotations

from itertools import product
from typing import Any

import mujoco
import numpy as np

_POSTURES = 64


def leave_out_housings(spec: Any, model: Any) -> list[str]:
    """Exclude contacts between the base and what its joint carries, and between links that always overlap.

    MuJoCo itself leaves out neighbours that both move. Links that overlap in every one of 64 random
    postures share a housing.
    """
    weld = model.body_weldid
    first = int(weld[model.jnt_bodyid[0]])
    base = [i for i in range(1, model.nbody) if weld[i] == 0]
    foot = set(product(base, [i for i in range(1, model.nbody) if weld[i] == first]))
    always = _always_touching(model) - foot
    known = {frozenset((exclude.bodyname1, exclude.bodyname2)) for exclude in spec.excludes}
    for pair in sorted(foot | always):
        names = [str(model.body(body).name) for body in pair]
        if frozenset(names) not in known:
            spec.add_exclude(bodyname1=names[0], bodyname2=names[1])
    if not always:
        return []
    said = ", ".join(" and ".join(str(model.body(body).name) for body in pair) for pair in sorted(always))
    return [f"links that overlap in every posture, their contact left out: {said}"]


def _always_touching(model: Any) -> set[tuple[int, int]]:
    data = mujoco.MjData(model)
    random = np.random.default_rng(0)
    pairs: set[tuple[int, int]] | None = None
    for _ in range(_POSTURES):
        data.qpos[:] = random.uniform(model.jnt_range[:, 0], model.jnt_range[:, 1])
        mujoco.mj_fwdPosition(model, data)
        bodies = np.sort(model.geom_bodyid[data.contact.geom[data.contact.dist <= 0.0]], axis=1)
        now = {(int(a), int(b)) for a, b in bodies.reshape(-1, 2)}
        pairs = now if pairs is None else pairs & now
        if not pairs:
            break
    return pairs or set()
