"""What a path keeps when it is executed on points that are not where the estimate has them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from omniservo.errors import InputError
from omniservo.estimation import EstimateSamples
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray
from omniservo.planning.camera_path import CameraPath
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.planning.problem_arrays import constraint_table_of
from omniservo.risk.checked_places import CheckedPlaces
from omniservo.risk.executed_margins import Drawn, executed_margins
from omniservo.risk.servo_response import ServoResponse, servo_response

EVEN_PLACES = 25
"""Places of the path where samples are checked, besides those of the certificate's smallest margins."""

PILOTS = 100
"""Samples that show where the rest is checked."""

IMAGE = "image"
"""Name of the one constraint that all image limits share: the visibility margin."""


@with_field_docs
@dataclass(frozen=True, eq=False)
class Executions:
    """Samples of the true points and camera, and what a problem requires of each."""

    problem: PlanningProblem
    points: FloatArray
    """(K, n, 3) [m]"""
    camera: FloatArray
    """(K, p) parameters' deviations; p = 0 where the camera is exact"""
    repeats: float = 1.0
    """K/repeats is the effective sample size, see `EstimateSamples`"""

    @classmethod
    def of(
        cls, problem: PlanningProblem, samples: EstimateSamples, rows: IntArray | None = None
    ) -> Executions:
        """Return those of an estimate's samples; the problem's points are these rows of theirs, or all.

        Raises:
            InputError: a distorted camera with a mask, whose pixels are not checked.
        """
        if problem.camera.is_distorted and problem.camera.mask:
            raise InputError("camera: distortion and a mask together; plans with risk take one of them")
        points = samples.points if rows is None else samples.points[:, rows]
        deviations = samples.camera if samples.camera.any() else samples.camera[:, :0]
        return cls(problem, np.ascontiguousarray(points), deviations.copy(), samples.repeats)

    @property
    def constraints(self) -> tuple[str, ...]:
        """Names of what more can be required of: metres by the certificate's names, and `IMAGE`."""
        return constraints_of(self.problem)

    def of_samples(self, rows: IntArray) -> Executions:
        """Return these samples (k,) alone."""
        return replace(self, points=self.points[rows], camera=self.camera[rows])

    def margins(self, path: CameraPath, critical: FloatArray) -> FloatArray:
        """Return the smallest margin (K, d) of each sample and constraint along the executed path [m], [px].

        ``critical`` are more places w to look at. The domain's angle counts in px, by the focal length. A
        constraint is checked only where it is nearly as tight as anywhere, or leaves little.
        """
        return self.margins_at(self.places(path, critical))

    def margins_at(self, places: CheckedPlaces) -> FloatArray:
        """Return the same at places that samples of the same law have shown."""
        active = places.nearly_tightest | places.in_danger
        return self._grouped(self._run(places.response, active, self.points, self.camera, 1)[:, 0])

    def violated_at(self, places: CheckedPlaces) -> BoolArray:
        """Return which samples (K,) leave a constraint unmet: sooner known than all margins."""
        found = self._run(places.response, places.in_danger, self.points, self.camera, 1)
        return np.asarray((self._grouped(found[:, 0]) < 0.0).any(axis=1))

    def places(self, path: CameraPath, critical: FloatArray) -> CheckedPlaces:
        """Return even and ``critical`` places w of a path, and what a few of these samples take there."""
        response = self._response(
            path, np.unique(np.concatenate((np.linspace(0.0, 1.0, EVEN_PLACES), critical)))
        )
        depth, planned = len(response.places), self._planned_at(response)
        everything = np.ones(planned.shape, dtype=np.bool_)
        pilot = self._run(response, everything, self.points[:PILOTS], self.camera[:PILOTS], depth)
        with np.errstate(invalid="ignore"):
            taken = np.where(np.isfinite(planned), planned - pilot.min(axis=0), 0.0)
        return CheckedPlaces(response, planned, taken)

    def planned(self, path: CameraPath, places: FloatArray) -> FloatArray:
        """Return the smallest margin (d,) of each constraint at ``places``, the points being as estimated."""
        found = self._planned_at(self._response(path, places))
        return np.asarray(self._grouped(found.min(axis=0)[None])[0])

    def _response(self, path: CameraPath, places: FloatArray) -> ServoResponse:
        parameters = self.camera.shape[1]
        return servo_response(self.problem.camera, self.problem.points, path, places, parameters)

    def _planned_at(self, response: ServoResponse) -> FloatArray:
        """Return each column's margin (W, e + 2) with the points as estimated."""
        depth, points = len(response.places), self.problem.points[None].copy()
        everything = np.ones((depth, len(_columns(self.problem))), dtype=np.bool_)
        found = self._run(response, everything, points, np.zeros((1, self.camera.shape[1])), depth)
        return np.asarray(found[0])

    def _run(
        self, response: ServoResponse, active: BoolArray, points: FloatArray, camera: FloatArray, depth: int
    ) -> FloatArray:
        """Return the kernel's margins (K, depth, e + 2)."""
        if response.lens.shape[-1] != camera.shape[1]:  # the kernel would read beyond the samples
            raise ValueError(
                f"{camera.shape[1]} parameters of samples, {response.lens.shape[-1]} of the path"
            )
        asked, frame = constraint_table_of(self.problem), _frame(self.problem)
        found = np.full((len(points), depth, len(asked.entries) + 2), math.inf)
        drawn = Drawn(points, camera)
        executed_margins(asked.constraints, asked.optics, asked.table, frame, response, active, drawn, found)
        return found

    def _grouped(self, found: FloatArray) -> FloatArray:
        """Return the smallest of each constraint (K, d) of columns (K, e + 2)."""
        names, result = _columns(self.problem), np.full((len(found), len(self.constraints)), math.inf)
        places_of = {name: g for g, name in enumerate(self.constraints)}
        for column, (name, unit) in enumerate(zip(names, self._units(), strict=True)):
            g = places_of[name]
            result[:, g] = np.minimum(result[:, g], unit * found[:, column])
        return result

    def _units(self) -> list[float]:
        """Return the factor of each column to [m] or [px]; what does not change counts as infinitely far."""
        focal = min(abs(self.problem.camera.fx), abs(self.problem.camera.fy))
        factors = {"m": 1.0, "px": 1.0, "rad": focal, "1": math.inf}
        return [factors[e.unit] for e in constraint_table_of(self.problem).entries] + [1.0, 1.0]


def constraints_of(problem: PlanningProblem) -> tuple[str, ...]:
    """Return names of what more can be required of: metres by the certificate's names, and `IMAGE`."""
    return tuple(dict.fromkeys(_columns(problem)))


def _columns(problem: PlanningProblem) -> list[str]:
    """Return the constraint that each column of the kernel's result belongs to."""
    entries = constraint_table_of(problem).entries
    return [IMAGE if e.unit in ("px", "rad", "1") else e.name for e in entries] + [IMAGE, IMAGE]


def _frame(problem: PlanningProblem) -> FloatArray:
    """Return the ``frame`` of `executed_margins`."""
    camera, zone = problem.camera, problem.camera.dead_zone
    if not camera.is_distorted:
        return np.zeros(0)
    centre = (0.0, 0.0, 0.0) if zone is None else (*zone.center, zone.radius)
    tail = (float(camera.width), float(camera.height), problem.image_margin, *centre)
    return np.concatenate((camera.parameters, tail))
