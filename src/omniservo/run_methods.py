"""The methods of a run by name: known without loading what they do, so a wrong name is reported at once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from omniservo.errors import InputError, did_you_mean, spelled

COMPARE = "compare"
"""stands for `COMPARED`"""

COMPARED = ("certified", "paper", "ibvs")
"""in the order of the comparison"""

Planner = Literal["certified", "paper"]


@dataclass(frozen=True)
class RunMethod:
    """How a run gets from the initial image to the goal image."""

    name: str
    """as given to ``--method``; of one from a file ``FILE.CLASS``"""
    title: str
    """in reports"""
    plans: Planner | None = None
    """the planner; None: the goal image is the reference from the start"""
    replans: bool = False
    """whether another way is planned where something has changed on the way"""
    source: str | None = None
    """``FILE.py:CLASS`` of one from a file, whose code is run"""


METHODS = {
    method.name: method
    for method in (
        RunMethod("certified", "Certified plan", plans="certified", replans=True),
        RunMethod("certified-once", "Certified plan, never replanned", plans="certified"),
        RunMethod("paper", "The paper's own search", plans="paper"),
        RunMethod("ibvs", "Classical servo, no plan"),
        RunMethod("ibvs-desired", "Image points, matrix at the goal"),
        RunMethod("ibvs-mean", "Image points, mean matrix"),
        RunMethod("bearing", "Bearings, no plan"),
        RunMethod("spherical", "Decoupled on the sphere, no plan"),
        RunMethod("pbvs", "Position-based, straight in space"),
        RunMethod("pbvs-target", "Position-based, straight in the image"),
        RunMethod("hybrid-2.5d", "2½-D, no plan"),
        RunMethod("switched", "Switched image and pose, no plan"),
    )
}
"""Those of this package."""


def run_method(name: str, besides: tuple[str, ...] = ()) -> RunMethod:
    """Return a method of `METHODS`, or one from a file, ``FILE.py:CLASS``.

    Args:
        name: of the method.
        besides: what the caller takes in place of a method; a refusal names it as legal.

    Raises:
        InputError: neither.
    """
    if name in METHODS:
        return METHODS[name]
    file, _, own = name.rpartition(":")
    if file.endswith(".py") and own.isidentifier():
        called = f"{Path(file).stem}.{own}"
        return RunMethod(called, called, source=name)
    legal = (*METHODS, *besides)
    raise InputError(
        f"method: {spelled(name)} given; legal: {', '.join(legal)}, or FILE.py:CLASS"
        f"{did_you_mean(name, legal)}"
    )


def run_methods(names: Iterable[str]) -> tuple[RunMethod, ...]:
    """Return the methods of these names, each once, in their order; "compare" stands for three.

    Raises:
        InputError: an unknown name, or none.
    """
    every = [each for name in names for each in (COMPARED if name == COMPARE else (name,))]
    found = tuple(
        {method.name: method for method in (run_method(each, (COMPARE,)) for each in every)}.values()
    )
    if not found:
        raise InputError("method: none given; at least one is needed")
    return found
