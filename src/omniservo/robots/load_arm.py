"""Arms by name or file."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib import resources
from pathlib import Path

from omniservo.errors import InputError, did_you_mean, spelled
from omniservo.files import is_file
from omniservo.renamed import renamed_arguments
from omniservo.robots.arm import Arm


def shipped_arms() -> tuple[str, ...]:
    """Names of the arms that come with the package, sorted."""
    folder = resources.files("omniservo.robots") / "shipped"
    return tuple(sorted(f.name.removesuffix(".xml") for f in folder.iterdir() if f.name.endswith(".xml")))


@renamed_arguments(tool="flange")
def load_arm(
    arm: str | Path, *, flange: str | None = None, packages: Mapping[str, str | Path] | None = None
) -> Arm:
    """Return a shipped arm by its name, or the one of an MJCF or URDF file.

    Args:
        arm: a name of `shipped_arms`, or a file. A name wins over a file of the same name without ending.
        flange: the site or link that carries the camera, see `Arm`.
        packages: folders of ROS packages by name, see `Arm`.

    Raises:
        InputError: neither; or the file is no arm, see `Arm`.
    """
    names = shipped_arms()
    if str(arm) in names:
        return _shipped(str(arm), flange)
    if not is_file(arm):
        raise InputError(
            f"arm {spelled(str(arm))}: neither a file nor one of the shipped arms: {', '.join(names)}"
            f"{did_you_mean(arm, names)}"
        )
    return Arm(arm, flange=flange, packages=packages)


@cache  # arms do not change, and a job asks for its arm several times
def _shipped(name: str, flange: str | None) -> Arm:
    with resources.as_file(resources.files("omniservo.robots") / "shipped" / f"{name}.xml") as path:
        return Arm(path, flange=flange)
