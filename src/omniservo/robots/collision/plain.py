"""MuJoCo's own defaults: what is put beside an arm takes none of those that the arm's file states."""

from __future__ import annotations

from typing import Any

import mujoco

_OWNER: Any = mujoco.MjSpec()  # kept: they are a part of it

PLAIN: Any = _OWNER.default
"""first argument of ``add_geom`` and ``add_mesh``: else the file's scale of meshes and its contacts count"""
