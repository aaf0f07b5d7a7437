"""Puts compiled kernels into a wheel where OMNISERVO_KERNELS is set, as ``make wheel`` does.

They are compiled by ``omniservo warm-up`` of the package that is installed, for the generic processor of
`omniservo.geometry.kernel_cache.GENERIC`, and belong to this Python, this Numba and this kind of machine:
the wheel's tag says so. Without them a wheel is for every machine and compiles on first use.
"""

import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class KernelsHook(BuildHookInterface):
    """Compiles every kernel and adds what comes of it to the wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile before the wheel is put together."""
        if self.target_name != "wheel" or not os.environ.get("OMNISERVO_KERNELS"):
            return
        from omniservo.geometry.kernel_cache import GENERIC

        level = GENERIC.get(platform.machine().lower(), ("generic", ""))[0]
        caches = Path(self.root) / "build" / "kernels"
        shutil.rmtree(caches, ignore_errors=True)
        own = {"XDG_CACHE_HOME": str(caches), "NUMBA_CPU_NAME": level, "NUMBA_CPU_FEATURES": ""}
        warm_up = [sys.executable, "-m", "omniservo.cli.main", "warm-up"]
        subprocess.run(warm_up, env=os.environ | own, check=True)  # noqa: S603 — our own command
        build_data["force_include"][str(caches / "omniservo")] = "omniservo/kernels"
        build_data["pure_python"], build_data["infer_tag"] = False, True
