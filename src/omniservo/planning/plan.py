"""A plan: the answer to a planning problem, complete by itself."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast, get_args

from omniservo.drawn import drawn
from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.files import read_document, write_whole
from omniservo.geometry.arrays import FloatArray, finite_number
from omniservo.planning.camera_path import CameraPath
from omniservo.planning.certificate.certificate import Certificate, fields_of
from omniservo.planning.obstacles.obstacle_fields import only_fields
from omniservo.planning.planning_problem import PlanningProblem

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMAT = "omniservo.plan/1"

Status = Literal["certified", "refuted", "undecided", "infeasible", "not_found"]
"""certified: proven for all w. refuted: a w shows that the path violates a constraint. undecided: neither.
infeasible: no path exists, because an end pose violates a constraint. not_found: no path was found."""

_REQUIRED = ("format", "problem", "status")
_OPTIONAL = ("path", "certificate", "seconds", "method", "reason", "notices", "risk")
"""The last two stand in what the command prints, and say nothing of the plan itself."""


@with_field_docs
@dataclass(frozen=True, eq=False)
class Plan:
    """What planning found for a problem."""

    problem: PlanningProblem
    status: Status
    path: CameraPath | None
    """None only where infeasible; of a plan that was not found, the best attempt"""
    certificate: Certificate | None
    """None where there is no path"""
    seconds: float
    """time that planning took [s]"""
    method: str
    """"certified" or "paper\""""
    reason: str = ""
    """why the plan is not certified, or what to know of it, in one sentence; else empty"""
    aim: FloatArray | None = None
    """(7,) what an arm of seven joints is led to beside the camera's path, see `follow_path` [rad]; None:
    nothing. Not in files: a plan file knows no arm"""

    def __repr__(self) -> str:
        words: list[str] = [self.status]
        if self.path is not None:
            words.append(f"degrees {self.path.degrees}")
        clearance = self.least_clearance(range(len(self.problem.obstacles)))
        visibility = self.least_visibility()
        words += [] if clearance is None else [f"clearance {clearance:.3g} m"]
        words += [] if visibility is None else [f"visibility {visibility:.3g} px"]
        return f"Plan({', '.join(words)}, {1e3 * self.seconds:.3g} ms)"

    def _repr_html_(self) -> str:
        return str(drawn("value_html", self))

    def plot(self) -> Figure:
        """Return a Matplotlib figure of the moment with the least left, or of the worst violation.

        What the camera sees there, and two views of the path among the obstacles.
        """
        return cast("Figure", drawn("plan_figure", self))

    def least_clearance(self, obstacles: Iterable[int]) -> float | None:
        """Return the path's smallest distance to the surfaces of these obstacles [m], by its certificate.

        Guaranteed where the status is "certified". None: no certificate, or no such obstacle.
        """
        margins, kept = self._margins(), []
        for i in obstacles:
            asked, margin = self.problem.obstacles[i].clearance, margins.get(f"clearance obstacle {i}")
            if margin is not None:
                kept.append(margin + (self.problem.clearance if asked is None else asked))
        return min(kept, default=None)

    def least_visibility(self) -> float | None:
        """Return the points' smallest distance to the image's limits [px], as `least_clearance`."""
        kept = [m for name, m in self._margins().items() if name.startswith(("visibility", "dead_zone"))]
        return self.problem.visibility_margin + min(kept) if kept else None

    def _margins(self) -> dict[str, float]:
        return {} if self.certificate is None else {c.name: c.margin for c in self.certificate.constraints}

    def to_dict(self) -> dict[str, Any]:
        """Return the fields of a plan file; the problem is in it with its camera resolved."""
        path = None
        if self.path is not None:
            path = {
                "rotation": self.path.rotation.tolist(),
                "translation": self.path.translation.tolist(),
            }
        return {
            "format": FORMAT,
            "problem": self.problem.to_dict(),
            "status": self.status,
            "path": path,
            "certificate": None if self.certificate is None else self.certificate.to_dict(),
            "seconds": self.seconds,
            "method": self.method,
            "reason": self.reason,
        }

    def save(self, path: str | Path, *, force: bool = False) -> None:
        """Write the plan as JSON, whole or not at all.

        Raises:
            InputError: the file exists and ``force`` is False, or cannot be written.
        """
        write_whole(path, json.dumps(self.to_dict(), indent=1) + "\n", force=force)

    @classmethod
    def load(cls, path: str | Path) -> Plan:
        """Return the plan of a file. Nothing is judged: that is what verifying is for.

        Raises:
            InputError: not readable, or not a plan.
        """
        try:
            return cls.from_dict(read_document(path))
        except InputError as error:
            message = str(error)
            raise InputError(message if message.startswith(str(path)) else f"{path}: {message}") from None

    @classmethod
    def from_dict(cls, fields: Any) -> Plan:
        """Return the plan of a plan file's fields.

        Raises:
            InputError: a field is missing, unknown or not legal.
        """
        if not isinstance(fields, Mapping) or fields.get("format") != FORMAT:
            raise InputError(f"not a plan: format must be {FORMAT!r}")
        only_fields(fields, _REQUIRED, _OPTIONAL)
        statuses: tuple[Status, ...] = get_args(Status)
        status = next((s for s in statuses if s == fields["status"]), None)
        if status is None:
            raise InputError(f"status: {fields['status']!r:.40} given; legal: {', '.join(statuses)}")
        path, certificate = fields.get("path"), fields.get("certificate")
        return cls(
            problem=PlanningProblem.from_dict(fields["problem"]),
            status=status,
            path=None if path is None else CameraPath(**fields_of("path", path, ("rotation", "translation"))),
            certificate=None if certificate is None else Certificate.from_dict(certificate),
            seconds=finite_number("seconds", fields.get("seconds", 0.0), minimum=0.0),
            method=str(fields.get("method", "")),
            reason=str(fields.get("reason", "")),
        )
