"""How far an arm that follows a path by its camera deviates from it: measured on runs, not assumed."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from omniservo.errors import InputError, did_you_mean, spelled, spelled_name
from omniservo.field_docs import with_field_docs
from omniservo.files import read_document, write_whole
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number, frozen

FORMAT = "omniservo.tracking-tube/2"

_SHAPING = 3
"""One of so many runs, the first ones, shapes the tube."""

_THINNEST = 0.5
"""of the largest joint, or link: what hardly deviated in a few runs may in the next, and one part that
deviates three times its share makes all of the tube three times as thick"""

_THINNEST_PAIR = 0.3
"""of the largest link, for pairs of links"""

_IMAGE_ROOM = 2.0
"""What points deviated in the image counts so many times: a pixel more is cheap."""

_LEAST = 1e-9
"""[rad], [m], [px] no part of a tube is thinner"""

PARTS = ("position", "image")
"""of the camera: its centre [m], the points in its image [px]"""


@with_field_docs
@dataclass(frozen=True, eq=False)
class Tube:
    """What a run keeps within, but for a share of all runs: each against one place of the planned path."""

    joints: FloatArray
    """(n,) every joint [rad]"""
    links: dict[str, float]
    """by link, and "camera" for what the flange carries: any of its points; by pair of links, "camera &
    forearm" and the like: how much nearer they are to each other [m]"""
    position: float
    """the camera's centre [m]"""
    image: float
    """any point in the image [px]"""
    singular_value: float
    """of the paths that it holds for, see `TrackingTube`"""
    share: float
    """of runs that may leave it, as required"""


@with_field_docs
@dataclass(frozen=True, eq=False)
class TrackingTube:
    """Runs of one arm, each with the most that it deviated: quantiles of it are tubes.

    The first third of the runs gives the shape s (k,) of joints, links and camera: the most that they
    deviated; of joints and links at least half of the largest, of pairs of links 0.3 of the largest link's,
    of points in the image twice. Each of the other N, which deviated by d_i, needs the tube ρ_i s, with
    ρ_i = max d_i/s. The tube of a share p is ρ s with ρ the (j + 1)-th largest of the N, j as large as
    (j + 1)/(N + 1) ≤ p allows: one more run like these is as likely to take any place among them, so it
    exceeds that ρ with that probability at most, whatever the distribution is (split conformal prediction;
    Vovk, Gammerman, Shafer, *Algorithmic learning in a random world*, 2005).

    Raises:
        InputError: shapes, numbers that are not finite or negative.
    """

    arm: str
    """its name"""
    links: tuple[str, ...]
    """`ArmBodies.tube_parts`: links, then pairs of links"""
    shape: FloatArray
    """(n + links + 2,) s: joints [rad], links [m], `PARTS` of the camera, read-only"""
    ratios: FloatArray
    """(N,) ρ of every run that had no part in the shape, ascending, read-only"""
    singular_value: float
    """the paths' configurations had at least this smallest singular value, and so must those of a path that
    the tube is used for: what the camera deviates makes joints and links deviate by its inverse"""
    source: str
    """what was run, in words"""

    def __post_init__(self) -> None:
        for name, given in (("shape", self.shape), ("ratios", self.ratios)):
            values = finite_array(name, given, (None,))
            if not len(values) or values.min() < 0.0:
                raise InputError(f"{name}: legal: numbers ≥ 0, at least one")
            object.__setattr__(self, name, frozen(np.sort(values) if name == "ratios" else values))
        finite_number("singular_value", self.singular_value, minimum=0.0)
        if len(self.shape) <= len(self.links) + len(PARTS):
            raise InputError(f"shape: {len(self.shape)} numbers given; joints, links and camera need more")

    @classmethod
    def of(
        cls,
        arm: str,
        links: tuple[str, ...],
        strayed: npt.ArrayLike,
        singular_value: float,
        source: str,
    ) -> Self:
        """Return the tube of runs that deviated by (N, k), as `strayed` finds it of each.

        Their paths had at least this singular value. The order of the runs must not depend on what they did.

        Raises:
            InputError: wrong shape, not finite, or negative.
        """
        most = finite_array("strayed", strayed, (None, None))
        if len(most) < 2 or most.min() < 0.0:
            raise InputError("strayed: at least two runs, and no negative number, are needed")
        shaping = max(1, len(most) // _SHAPING)
        shape = most[:shaping].max(axis=0)
        dof = len(shape) - len(links) - len(PARTS)
        single = sum("&" not in name for name in links)
        joints, alone, pairs = np.split(shape[: -len(PARTS)], [dof, dof + single])
        for part in (joints, alone):
            np.maximum(part, _THINNEST * part.max(initial=0.0), out=part)
        np.maximum(pairs, _THINNEST_PAIR * alone.max(initial=0.0), out=pairs)
        shape[-1] *= _IMAGE_ROOM
        shape = np.maximum(shape, _LEAST)
        return cls(arm, links, shape, (most[shaping:] / shape).max(axis=1), singular_value, source)

    @property
    def runs(self) -> int:
        """How many were measured beside those that shaped it."""
        return len(self.ratios)

    def at(self, share: float) -> Tube:
        """Return the tube that a run leaves with probability ``share`` at most, as far as the runs can tell.

        Raises:
            InputError: illegal, or too small for so few runs; the message says how many are needed.
        """
        finite_number("share", share, above=0.0, maximum=0.5)
        beyond = math.floor(share * (self.runs + 1) + 1e-9) - 1
        if beyond < 0:
            raise InputError(
                f"tracking_tube: {self.runs} runs of {spelled(self.arm)}, beside those that shaped it, tell "
                f"nothing of the worst {100 * share:.3g}%; {math.ceil(1.0 / share) - 1} are needed"
            )
        size = float(self.ratios[self.runs - 1 - beyond]) * self.shape
        links = size[len(size) - len(self.links) - len(PARTS) : -len(PARTS)]
        camera = [float(part) for part in size[-len(PARTS) :]]
        return Tube(
            frozen(size[: len(size) - len(self.links) - len(PARTS)]),
            dict(zip(self.links, links.tolist(), strict=True)),
            position=camera[0],
            image=camera[1],
            singular_value=self.singular_value,
            share=share,
        )

    def save(self, path: str | Path, *, force: bool = False) -> None:
        """Write it as JSON.

        Raises:
            InputError: the file exists and ``force`` does not say to replace it.
        """
        document = {
            "format": FORMAT,
            "arm": self.arm,
            "links": list(self.links),
            "source": self.source,
            "singular_value": self.singular_value,
            "shape": [float(f"{x:.6g}") for x in self.shape],
            "ratios": [float(f"{x:.6g}") for x in self.ratios],
        }
        write_whole(Path(path), json.dumps(document, allow_nan=False) + "\n", force=force)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote.

        Raises:
            InputError: another file.
        """
        document: Any = read_document(Path(path))
        known = ("format", "arm", "links", "source", "singular_value", "shape", "ratios")
        if not isinstance(document, dict) or document.get("format") != FORMAT:
            raise InputError(f"{path}: no tracking tube: format {FORMAT!r} with {', '.join(known)}")
        for name in document:
            if name not in known:
                raise InputError(
                    f"{path}: {spelled_name(name)}: no such field; legal: {', '.join(known)}"
                    f"{did_you_mean(name, known)}"
                )
        for name in known:
            if name not in document:
                raise InputError(f"{path}: {name}: missing; needed: {', '.join(known)}")
        arm, links, source = (document[name] for name in ("arm", "links", "source"))
        if not isinstance(links, list) or not all(isinstance(x, str) for x in (arm, source, *links)):
            raise InputError(f"{path}: arm, links, source: text is needed")
        try:
            return cls(
                arm, tuple(links), document["shape"], document["ratios"], document["singular_value"], source
            )
        except InputError as error:
            raise InputError(f"{path}: {error}") from None


def shipped_tube(arm: str) -> TrackingTube:
    """Return the tube that was measured in the simulator for a shipped arm.

    Raises:
        InputError: there is none.
    """
    with resources.as_file(resources.files("omniservo.robots") / "shipped" / f"{arm}.tube.json") as path:
        if not path.is_file():
            raise InputError(f"tracking_tube: none is shipped for arm {spelled(arm)}; measure one")
        return TrackingTube.load(path)
