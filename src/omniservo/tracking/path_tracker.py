"""Following a plan by the image, (41)-(44), and ending on the goal image itself."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from omniservo.cameras import UnifiedCamera
from omniservo.cameras.conversion import unified_image
from omniservo.cameras.models import CentralModel
from omniservo.errors import Divergence, FeatureLoss, InputError, SingularInteraction
from omniservo.estimation.uncertainty.camera_moves import camera_variance
from omniservo.geometry.arrays import BoolArray, FloatArray, finite_array, finite_number
from omniservo.planning import CameraPath, Plan
from omniservo.servoing import MeasuredPose, RestToRestLaw, TimeLaw, feature_named
from omniservo.servoing.control_law import singular_message
from omniservo.tracking import step_kernel as kernel
from omniservo.tracking.gate import GATE
from omniservo.tracking.goal_blend import GoalBlend
from omniservo.tracking.goal_image import GoalImage
from omniservo.tracking.leg import Leg
from omniservo.tracking.pose_filter import covariance_at_start, predict_state
from omniservo.tracking.reference import Reference
from omniservo.tracking.stop_criterion import StopCriterion
from omniservo.tracking.structure_refinement import StructureRefinement
from omniservo.tracking.tracker_options import TrackerOptions
from omniservo.tracking.tracker_report import Phase, TrackerReport

DEFAULT_DURATION = 4.0
"""of the rest-to-rest law that is taken where none is given [s]"""

PLACES_CHECKED = 201
"""At so many places of the path virtual-plane features are checked for Z > 0."""

_Estimate = tuple[FloatArray, FloatArray, FloatArray]  # pose (7,), its covariance (6, 6), residuals (2,)


class PathTracker:
    """Turns images into camera twists that follow a plan and end on the goal image.

    The reference is s*(w) = s_p(w) + β(w) (s_goal − s_p(1)): the planned points' features of (43), blended
    into those of the goal image by a smooth β, 0 up to w = 1/2 and 1 at w = 1 (`GoalBlend`). So the twist
    has no jump between path and goal, and the end is the goal image even where the estimated points disagree.
    Distances are those of the filtered pose (44): the pose that explains the current image, joined with the
    poses before it. A point that this image's pose does not explain is not used; see TrackerOptions.gate_px.

    Args:
        plan: any plan with a path; its points, in the initial camera frame, are what the pixels show.
        camera: the camera that takes the images, of any model; pixels are those of its own images.
        goal_pixels: (n, 2) [px], the points in the goal image; None: where the plan's end sees them.
        initial_pixels: (n, 2) [px], the points in the initial image; with them and goal pixels the points
            are refined on the way, as `StructureRefinement` says. None: the points of a target whose shape
            is known keep it.
        options: see TrackerOptions.
        time_law: w(t); None: rest to rest in 4 s.

    Raises:
        InputError: a plan without a path, fewer points than ``least_features``, goal pixels of another shape,
            not finite, or that the camera cannot unproject; virtual-plane features and a path along which a
            point leaves the half-space Z > 0.
    """

    def __repr__(self) -> str:
        size = f"{self._camera.width} × {self._camera.height} px"
        return f"PathTracker({len(self._points)} points, {len(self._way.legs)} path(s), images of {size})"

    def __init__(
        self,
        plan: Plan,
        camera: CentralModel,
        *,
        goal_pixels: npt.ArrayLike | None = None,
        initial_pixels: npt.ArrayLike | None = None,
        options: TrackerOptions | None = None,
        time_law: TimeLaw | None = None,
    ) -> None:
        self.options = options or TrackerOptions()
        """as given"""
        self.report: TrackerReport | None = None
        """of the last step that gave a twist; None before the first"""
        if plan.path is None:
            raise InputError(f"plan: status {plan.status!r} without a path; a plan with a path is needed")
        self._image = unified_image(camera)
        self._camera = self._image.camera
        self._feature = feature_named(self.options.feature)
        self._points = np.ascontiguousarray(
            finite_array("plan.problem.points", plan.problem.points, (None, 3))
        )
        if len(self._points) < self.options.least_features:
            raise InputError(
                f"plan: {len(self._points)} points; at least {self.options.least_features} are needed"
            )
        self._way = Reference(Leg(plan.path, time_law or RestToRestLaw(DEFAULT_DURATION)))
        self._refuse_points_behind(plan.path)
        wanted = None if goal_pixels is None else self._carried("goal_pixels", goal_pixels)
        self._goal = GoalImage.of(self._camera, self._feature, plan.path, self._points, wanted)
        self._goal_blend = GoalBlend(self._goal.offsets)
        self._settings = _settings(self.options, self._camera, self._goal.pixels)
        self._estimated_pose, self._pose_covariance = np.empty(7), np.empty((6, 6))
        self._residuals = np.zeros(2)
        self._without_image = self._estimated_pose, self._pose_covariance, self._residuals
        """what was estimated for the time of the last image before it"""
        self._where: MeasuredPose | None = None
        self._stop = StopCriterion(self._goal.pose, self.options)
        self._structure = None if wanted is None else self._refinement(initial_pixels)
        nothing = np.zeros((len(self._points), 2)), np.zeros(len(self._points), dtype=np.bool_)
        self._run_kernel(0.0, 0.0, nothing, self._predicted(0.0))

    @property
    def points(self) -> FloatArray:
        """(n, 3) the points in the initial camera frame that are servoed on [m]."""
        return self._points.copy()

    @property
    def done(self) -> bool:
        """Whether the stop criteria of the options held at the last step."""
        return self.report is not None and self.report.phase == "done"

    @property
    def goal(self) -> GoalImage:
        """Where the servo ends."""
        return self._goal

    @property
    def time_law(self) -> TimeLaw:
        """s(t) of the leg that is followed last; of the first leg s is w."""
        return self._way.legs[-1].law

    @property
    def legs(self) -> tuple[Leg, ...]:
        """The ways that were followed, the plan's first, and the one that is followed last."""
        return tuple(self._way.legs)

    def take_up(self, leg: Leg) -> None:
        """Follow another way from ``leg.time`` on; the reference's pose and twist have no jump there.

        A goal that has changed is blended in from there, as `GoalBlend` says.

        Raises:
            InputError: the leg begins elsewhere than the way before is left, or with another twist, or in the
                past; the reference is slowed down; virtual-plane features and a path along which a point
                leaves the half-space Z > 0; or its end does not see the goal image's points.
        """
        if self.report is not None and leg.time <= self.report.time:
            raise InputError(f"leg.time: {leg.time:g} s given; it must be taken up after what was seen last")
        leg = self._way.joined(leg)
        self._refuse_points_behind(leg.path)
        goal = self._goal.beyond(self._feature, leg.path, self._points)
        self._head_for(goal, leg.w(leg.time)[0])
        self._way.legs.append(leg)

    def carried_by(self, where: MeasuredPose) -> None:
        """Carry what was seen along the camera's measured motion from now on, in place of the planned one.

        Args:
            where: the camera's poses by the joints at times as in `step`.
        """
        self._where = where

    def off_path(self, time: float, slowing: float) -> float:
        """Return how far off the path the camera may be once it has slowed down without images [m].

        It moves no farther than the path leads it, wherever to, from where the last image saw it.

        Args:
            time: when it begins to slow down [s].
            slowing: how long that takes [s].
        """
        if self.report is None:
            return 0.0
        seen = self._way.pose(self.report.time)[4:]
        off = float(np.linalg.norm(self._estimated_pose[4:] - seen))
        return off + float(np.linalg.norm(self._way.places(time, slowing) - seen, axis=1).max())

    def distance(self, place: FloatArray) -> float:
        """Return how far a place of the camera is from the way, each leg up to where the next begins [m].

        Args:
            place: (3,) [m] in the frame of the camera as it stood at time 0.
        """
        return self._way.distance(place)

    def slow_down(self, time: float, slowing: float) -> float:
        """Let the reference come to rest on its path, and wait there for `go_on`; return when it stands [s].

        Args:
            time: when it begins to slow down [s].
            slowing: how long that takes [s].
        """
        return self._way.slow_down(time, slowing)

    def coast(self, time: float, acts_at: float) -> FloatArray:
        """Return the twist (6,) of `step` for the points as the last estimate, carried to ``time``, has them.

        Nothing is learnt from it: `report` and the estimate stay those of the last image.

        Raises:
            FeatureLoss: there was no image yet, or too few points are in the camera's domain.
            SingularInteraction, Divergence: as `step`.
        """
        if self.report is None:
            raise FeatureLoss("no image was seen yet")
        pixels, seen = self._predicted_pixels(time)
        status, twist, *_, evidence = self._run_kernel(time, acts_at, (pixels, seen), self._predicted(time))
        if status != kernel.DONE:
            raise self._error(status, pixels, evidence)
        return twist

    def go_on(self, time: float, rising: float) -> None:
        """Let the reference go on from ``time`` [s], as fast as planned after ``rising`` [s]."""
        self._way.go_on(time, rising)

    def step(
        self,
        time: float,
        pixels: npt.ArrayLike,
        valid: npt.ArrayLike | None = None,
        acts_at: float | None = None,
        time_sigma: float = 0.0,
    ) -> FloatArray:
        """Return the camera twist (6,), (linear [m/s], angular [rad/s]), in the camera frame, by (43).

        Args:
            time: exposure of the image [s] since the start of the time law; the reference rests before 0. An
                image of the same time as the last is that one again.
            pixels: (n, 2) [px], row j shows point j; rows of lost points may hold anything.
            valid: (n,) bool, False for lost points; None: all are there. A pixel outside the camera's domain
                counts as lost.
            acts_at: when the twist will act [s], likewise; None: the options' delay after ``time``.
            time_sigma: standard deviation of ``time`` [s]: the faster the camera moves, the less the pose
                in this image counts.

        Raises:
            FeatureLoss: fewer than ``least_features`` points are usable.
            SingularInteraction: the usable points do not determine a twist.
            Divergence: the points are further from their reference than ``divergence_px``, or no pose near
                the last one or the planned one explains the image.
            InputError: wrong shapes, a time before that of the previous image, or a number that is not finite
                in a valid row.
        """
        seen, used = self._checked_image(time, pixels, valid)
        acts = time + self.options.delay if acts_at is None else finite_number("acts_at", acts_at)
        uncertain = finite_number("time_sigma", time_sigma, minimum=0.0)
        again = self.report is not None and time == self.report.time  # the last image: it counts once
        expected = self._without_image if again else self._predicted(time)
        status, twist, reference, pose, filtered, evidence = self._run_kernel(
            time, acts, (seen, used), expected, uncertain
        )
        if status != kernel.DONE:
            raise self._error(status, seen, evidence)
        self._without_image = expected
        estimated, covariance, self._residuals = filtered
        self._estimated_pose, self._pose_covariance = estimated.copy(), covariance.copy()
        _, error, goal_error, rms, conditioning, factor = evidence.tolist()
        phase = self._phase(time, goal_error, pose)
        w, w_dot = self._way.leg(time).w(time)
        own_reference = self._image.returned(reference)
        self.report = TrackerReport(
            time, w, w_dot, phase, used, own_reference, error, goal_error, pose, estimated, covariance, rms,
            conditioning, factor < 1.0,
        )  # fmt: skip
        if self._structure is not None:
            self._adopt(self._structure.look(seen, used, estimated))
        return twist

    def predict(self, time: float) -> tuple[FloatArray, BoolArray]:
        """Return where the points are expected at ``time`` [s]: pixels (n, 2), and which exist (n,).

        The filtered pose of the last step, carried on by the motion since, as the joints were measured where
        `carried_by` says it, else as planned; before the first step the plan's.
        Search windows for points, and the places where lost points are looked for, come from here.
        """
        pixels, seen = self._predicted_pixels(time)
        return self._image.returned(pixels), seen

    def _predicted_pixels(self, time: float) -> tuple[FloatArray, BoolArray]:
        """Return `predict` as the unified camera has it."""
        before = after = pose = self._way.pose(time)
        if self.report is not None:
            pose, (before, after) = self._estimated_pose, self._moved(self.report.time, time)
        pixels = np.empty((len(self._points), 2))
        seen = np.empty(len(self._points), dtype=np.bool_)
        kernel.predict_pixels(self._camera.parameters, self._points, pose, before, after, pixels, seen)
        return pixels, seen

    def _carried_on(self, time: float, acts_at: float, here: FloatArray, then: FloatArray) -> FloatArray:
        """Return poses (4, 7): as measured from the exposure on, then as planned until the twist acts [s].

        The plan has the camera ``here`` and ``then``, (7,), at these times.
        """
        if self._where is None or acts_at <= time:
            return np.array([here, here, here, then])
        known = min(max(self._where.until, time), acts_at)
        return np.array([self._where(time), self._where(known), self._way.pose(known), then])

    def _moved(self, since: float, until: float) -> tuple[FloatArray, FloatArray]:
        """Return the camera's poses (7,) at two times [s] in one frame, as measured or else as planned."""
        if self._where is not None:
            return self._where(since), self._where(until)
        return self._way.pose(since), self._way.pose(until)

    def _carried(self, name: str, pixels: npt.ArrayLike) -> FloatArray:
        """Return given pixels (n, 2) as the unified camera sees them."""
        return self._image.inside(name, finite_array(name, pixels, (len(self._points), 2)))

    def _refinement(self, initial_pixels: npt.ArrayLike | None) -> StructureRefinement | None:
        """Return what refines the points; None where an image is missing."""
        if initial_pixels is None:
            return None
        initial = self._carried("initial_pixels", initial_pixels)
        return StructureRefinement(self._camera, self._points, initial, self._goal.pixels, self._goal.pose)

    def _adopt(self, points: FloatArray | None) -> None:
        """Servo on refined points (n, 3) from the next image on."""
        if points is None:
            return
        path, w = self._way.legs[-1].path, 0.0 if self.report is None else self.report.w
        try:
            goal = GoalImage.of(self._camera, self._feature, path, points, self._goal.pixels)
        except InputError:  # the refined points leave the domain of the features at the plan's end
            return
        self._points = points
        self._head_for(goal, w)

    def _head_for(self, goal: GoalImage, w: float) -> None:
        """End on another goal image, or on the same seen from another path's end, blended in from w on."""
        self._goal = goal
        self._goal_blend.change_to(goal.offsets, w)
        self._stop = StopCriterion(goal.pose, self.options)

    def _run_kernel(
        self,
        time: float,
        acts_at: float,
        image: tuple[FloatArray, BoolArray],
        expected: _Estimate,
        time_sigma: float = 0.0,
    ) -> tuple[int, FloatArray, FloatArray, FloatArray, _Estimate, FloatArray]:
        """Return status, twist, reference pixels (n, 2), this image's pose, estimate, evidence.

        ``image``: pixels (n, 2) and which are used (n,), which changes; ``expected``: as of `_predicted`.

        The constructor calls it once without points, so that compiling does not delay the first twist.
        """
        w, _, plan_seen, twist_seen = self._way.state(time)
        w_now, w_dot_now, plan_now, plan_twist = self._way.state(acts_at)
        now, growth = self._goal_blend.at(w_now)
        offsets = np.array([self._goal_blend.at(w)[0], now])
        (seen, used), (estimated_pose, covariance, residuals) = image, (a.copy() for a in expected)
        carried_on = self._carried_on(time, acts_at, plan_seen, plan_now)
        pose, twist, reference, evidence = np.empty(7), np.empty(6), np.empty((len(used), 2)), np.empty(6)
        status = kernel.track_step(
            self._camera.parameters,
            self._feature.kind,
            self._settings,
            (self._points, seen, used, self._goal.pixels.copy()),
            (plan_seen, plan_now, plan_twist, carried_on, offsets, w_dot_now * growth),
            (estimated_pose, covariance, residuals, time_sigma * twist_seen),
            (pose, twist, reference, evidence),
        )
        return status, twist, reference, pose, (estimated_pose, covariance, residuals), evidence

    def _predicted(self, time: float) -> _Estimate:
        """Return the pose filter's estimate for ``time`` [s]."""
        if self.report is None:
            return self._way.pose(time), covariance_at_start(), self._residuals
        estimated_pose, covariance = self._estimated_pose.copy(), self._pose_covariance.copy()
        since = self.report.time
        predict_state(estimated_pose, covariance, *self._moved(since, time), time - since)
        return estimated_pose, covariance, self._residuals

    def _checked_image(
        self, time: float, pixels: npt.ArrayLike, valid: npt.ArrayLike | None
    ) -> tuple[FloatArray, BoolArray]:
        """Return pixels (n, 2) and a copy of ``valid`` (n,) as the kernel takes them."""
        count = len(self._points)
        if isinstance(pixels, np.ma.MaskedArray) and pixels.mask.any():
            raise InputError(f"pixels: {pixels.mask.sum()} masked entries given; mark a lost point in valid")
        seen = np.ascontiguousarray(pixels, dtype=np.float64)
        if seen.shape != (count, 2):
            raise InputError(
                f"pixels: shape {seen.shape} given; ({count}, 2) is needed, a row for every point"
            )
        used = np.ones(count, dtype=np.bool_) if valid is None else np.array(valid, order="C")
        if used.shape != (count,) or used.dtype != np.bool_:
            raise InputError(f"valid: {used.dtype} {used.shape} given; bool ({count},) is needed")
        if self.report is not None and time < self.report.time:
            raise InputError(
                f"time: {time:g} s given after an image of {self.report.time:g} s; it must not run backwards"
            )
        return self._image.kept(seen, used)

    def _phase(self, time: float, goal_error: float, pose: FloatArray) -> Phase:
        """Return the phase of the step at ``time`` [s]."""
        if self._way.leg(time).law.finished(time):
            return "done" if self._stop.holds(time, goal_error, pose) else "goal"
        self._stop.restart()
        return "path"

    def _error(self, status: int, pixels: FloatArray, evidence: FloatArray) -> Exception:
        """Return the error that a status of the kernel stands for."""
        options = self.options
        if status == kernel.NOT_FINITE:
            j = int(evidence[kernel.COUNT])
            return InputError(f"pixels: row {j}, {pixels[j]}, is not finite; mark a lost point in valid")
        count = int(evidence[kernel.COUNT])
        if status == kernel.FEATURE_LOSS:
            return FeatureLoss(
                f"{count} of {len(pixels)} points are usable; at least {options.least_features} are needed"
            )
        if status == kernel.SINGULAR:
            return SingularInteraction(singular_message(count, float(evidence[kernel.CONDITIONING])))
        if status == kernel.NO_POSE:
            return Divergence("no pose near the last one or the planned one explains the image")
        return Divergence(
            f"the points are {evidence[kernel.ERROR_PX]:.1f} px (rms) from where the plan has them; "
            f"at most {options.divergence_px:g} px is allowed"
        )

    def _refuse_points_behind(self, path: CameraPath) -> None:
        """Raise where virtual-plane features are required and do not exist along the path."""
        if self.options.feature != "virtual-plane":
            return
        for w in np.linspace(0.0, 1.0, PLACES_CHECKED):
            camera_points = path(w).inv().apply(self._points)
            if (camera_points[:, 2] <= 0.0).any():
                j = int(np.argmin(camera_points[:, 2] / np.linalg.norm(camera_points, axis=1)))
                angle = math.degrees(math.acos(camera_points[j, 2] / float(np.linalg.norm(camera_points[j]))))
                raise InputError(
                    f"feature: virtual-plane needs Z > 0, but point {j} is {angle:.1f}° from the optical "
                    f"axis at w = {w:.3f}; use bearing"
                )


def _settings(options: TrackerOptions, camera: UnifiedCamera, pixels: FloatArray) -> FloatArray:
    """Return the options that the kernel reads; what the camera's own error explains is no wrong point."""
    bearings, valid = camera.unproject(pixels)
    error_px = math.sqrt(float(camera_variance(camera, bearings[valid]).max(initial=0.0)))
    settings = np.empty(6)
    settings[kernel.GAIN] = options.gain
    settings[kernel.LEAST_FEATURES] = options.least_features
    settings[kernel.DIVERGENCE_PX] = options.divergence_px
    settings[kernel.MAX_LINEAR] = options.max_linear_speed
    settings[kernel.MAX_ANGULAR] = options.max_angular_speed
    settings[kernel.GATE_PX] = max(options.gate_px, GATE * error_px)
    return settings
