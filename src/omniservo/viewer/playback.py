"""What the page shows of a motion: of the planned one along its path, of a run, or of what goes on now."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from threading import Lock
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import ByteArray, FloatArray
from omniservo.planning import Plan
from omniservo.viewer.along_path import curves_of
from omniservo.viewer.answer import Answer
from omniservo.viewer.camera_view import CameraView, with_trajectories
from omniservo.viewer.executed_run import ExecutedRun
from omniservo.viewer.moment import Moment
from omniservo.viewer.plots import plots_html
from omniservo.viewer.repeating import Repeating
from omniservo.viewer.scene_nodes import SceneNodes

TICK = 1.0 / 25.0
"""[s] between two places of a path that is played"""

SECONDS = 6.0
"""[s] in which a path is played"""

_PATH_FIRST = 0.08
"""[s] that the view and the curves wait: the path is on the page before they take the processor"""

_BETWEEN_VIEWS = 0.1
"""[s] that are left to the plans and to the browser: what is seen meanwhile is in the next view"""

_KEPT_TIMES = 4096


@dataclass(frozen=True)
class Place:
    """Where camera and arm are shown."""

    camera: RigidTransform
    """in the world"""
    joints: FloatArray | None
    """(n,) [rad]; None: there is no arm, or it does not get there"""
    planned: RigidTransform | None = None
    """of a run: where its plan has the camera then"""


class Playback:
    """Threads that move arm and camera, render the view, and go along the path; each with the newest answer.

    Args:
        server: viser's.
        newest: returns the newest answer.
        failed: called with what a thread raised.
    """

    def __init__(
        self, server: Any, newest: Callable[[], Answer | None], failed: Callable[[Exception], None]
    ) -> None:
        self._server, self._newest = server, newest
        self.playing = False
        self.run: ExecutedRun | None = None
        self.run_shown = True
        """whether what is played is the run, where there is one; the slider then goes along its time"""
        self.moment: Moment | None = None
        """of a servo that goes on"""
        self.view_seconds: deque[float] = deque(maxlen=_KEPT_TIMES)
        """how long views and curves took [s]"""
        self.moving = Lock()
        """held while arm and camera are moved, and while other ones take their place"""
        self._view = CameraView()
        self._nodes: SceneNodes
        self._w: Any
        self._image: Any
        self._plots: Any
        self._mover = Repeating("mover", self._move, failed)
        self._painter = Repeating("painter", self._paint, failed)
        self._player = Repeating("player", self._play, failed)

    def begin(self, w: Any, image: Any, plots: Any) -> None:
        """Show in these elements of the page (slider, image, HTML), until `close`."""
        self._w, self._image, self._plots = w, image, plots
        for thread in (self._mover, self._painter, self._player):
            thread.start()

    def close(self) -> None:
        """End the threads."""
        self.playing = False
        for thread in (self._player, self._mover, self._painter):
            thread.close()

    def take(self, nodes: SceneNodes, run: ExecutedRun | None) -> None:
        """Show in another scene."""
        self._nodes = nodes
        self.take_run(run)

    def take_run(self, run: ExecutedRun | None) -> None:
        """Show a run beside its plan, or none."""
        self.run = run
        if run is not None:
            self._nodes.show_executed(run.world_T_camera.translation)

    @property
    def w(self) -> float:
        """Where the slider is."""
        return float(self._w.value)

    def go_to(self, w: float) -> None:
        """Move the slider."""
        self._w.value = round(min(max(w, 0.0), 1.0), 3)
        self.show()

    def show(self) -> None:
        """Have arm, camera and view shown at the slider's w, or as they are now."""
        self._mover.wake()
        self._painter.wake()

    def follow(self, moment: Moment | None) -> None:
        """Show the arm as it is now, in place of a path; None: that is over."""
        self.moment = moment
        if moment is not None and np.isfinite(moment.w):
            self._w.value = round(min(max(moment.w, 0.0), 1.0), 3)
        self.show()

    def play(self, playing: bool) -> None:
        """Begin or end to go along the path."""
        self.playing = playing
        self._player.wake()

    def place(self, answer: Answer) -> Place:
        """Return where camera and arm are shown."""
        moment, run, arm = self.moment, self.run, answer.situation.arm
        if moment is not None and arm is not None:
            return Place(arm.scene.world_T_camera(moment.joints), moment.joints)
        if run is not None and self.run_shown:
            step = self._step(run)
            return Place(run.world_T_camera[step], run.joints[step], run.world_T_planned(step))
        return Place(answer.world_T_camera(self.w), answer.joints(min(self.w, answer.end)))

    def followed(self, answer: Answer) -> tuple[Plan, float]:
        """Return the plan whose trajectories are drawn, and where on its path that is which is shown."""
        run = self.run
        if run is None or not self.run_shown or run.plan is None or self.moment is not None:
            return answer.plan, self.w
        place = float(run.w[self._step(run)])
        return run.plan, place if np.isfinite(place) else self.w

    def _step(self, run: ExecutedRun) -> int:
        return run.step_at(self.w * float(run.times[-1]))

    def _move(self) -> None:
        answer = self._newest()
        if answer is None:
            return
        place = self.place(answer)
        with self.moving, self._server.atomic():
            self._nodes.show_planned(place.planned)
            self._nodes.show_camera(place.camera)
            if place.joints is not None:
                self._nodes.show_arm(place.joints)

    def _paint(self) -> None:
        time.sleep(_PATH_FIRST)
        answer = self._newest()
        if answer is None:
            return
        begin = time.perf_counter()
        self._plots.content = plots_html(curves_of(answer), self.followed(answer)[1])
        self._image.image = self.seen(answer)
        self.view_seconds.append(time.perf_counter() - begin)
        time.sleep(_BETWEEN_VIEWS)

    def seen(self, answer: Answer) -> ByteArray:
        """Return what the camera sees where it is shown (rows, columns, 3), with the trajectories."""
        plan, w = self.followed(answer)
        moment, place = self.moment, self.place(answer)
        own = answer.situation.camera == plan.problem.camera
        if moment is not None and moment.image is not None and own:
            return with_trajectories(moment.image, plan, w)
        return self._view.drawn(answer.situation, plan, place.camera, place.joints, w)

    def _play(self) -> None:
        """Go along the path again and again until it is ended."""
        last = time.monotonic()
        while self.playing:
            if self._player.woken_within(TICK):
                return
            before, last = last, time.monotonic()
            self.go_to((self.w + (last - before) / SECONDS) % 1.0)
