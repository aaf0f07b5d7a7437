"""The live page: a thread plans, `Playback`'s move and render; the server's loop does none of it."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field, replace
from itertools import count
from typing import Any, TypeAlias

from omniservo.errors import InputError, OmniservoError
from omniservo.planning import plan_path
from omniservo.risk import plan_arm_with_risk, plan_with_risk
from omniservo.viewer.along_path import curves_of
from omniservo.viewer.answer import Answer
from omniservo.viewer.camera_view import CameraView
from omniservo.viewer.edited_task import edited_task
from omniservo.viewer.executed_run import executed_of
from omniservo.viewer.live_servo import servo_live
from omniservo.viewer.moment import Moment
from omniservo.viewer.open_viewed import Viewed, judged_again
from omniservo.viewer.playback import TICK, Playback
from omniservo.viewer.plots import plots_html
from omniservo.viewer.repeating import Repeating
from omniservo.viewer.replay_file import places_of_replay, replay_page
from omniservo.viewer.run_on_page import RunOnPage
from omniservo.viewer.scene_nodes import SceneNodes
from omniservo.viewer.situation import Situation
from omniservo.viewer.status import PLANNING, job_html, refused_html, status_html
from omniservo.viewer.watched_run import WatchedRun
from omniservo.whole_arm import plan_with_arm

Edit: TypeAlias = Callable[[Situation], Situation]

WHILE_DRAGGED = 0.06
"""[s] for the arm's plan while a handle is dragged; the next place is more than the last one's best plan"""

_AT_REST = 0.15
"""[s] without a change after which the arm's plan is searched for to the end"""

_SOON = 0.5
"""[s] after which it is said that a plan is not there yet"""

_KEPT_TIMES = 4096


@dataclass
class Shown:
    """The page's elements that answers are written to."""

    status: Any
    plots: Any
    view: Any
    w: Any
    """slider"""
    job: Any
    """what a run does or did"""
    message: Callable[[str, str], None]
    """shows a title and a text on every window"""


@dataclass
class Timings:
    """How long the parts of updates took [s], the newest of them."""

    plans: deque[float] = field(default_factory=lambda: deque(maxlen=_KEPT_TIMES))
    publishing: deque[float] = field(default_factory=lambda: deque(maxlen=_KEPT_TIMES))


class Page:
    """Holds what is planned for, plans it again when it is changed, and shows the answer.

    Args:
        server: viser's.
        viewed: what the page begins with.
    """

    def __init__(self, server: Any, viewed: Viewed) -> None:
        self.server = server
        self._jobs: deque[Callable[[], None]] = deque()
        self.whole_arm = True
        """whether the arm's plan is searched for, where there is an arm"""
        self.timings = Timings()
        self._answer: Answer | None = None
        self._number, self._request, self._requests = 0, 0, count(1)
        self._changed, self._closed = threading.Condition(), threading.Event()
        self._serving = threading.Lock()
        self.settled = threading.Event()
        """set once the first situation is planned for, or refused"""
        self.playback = Playback(server, lambda: self._answer, self._failed)
        self.shown: Shown
        self.listeners: list[Callable[[Situation], None]] = []
        """called, by the thread that plans, with what an edit or a drag made of the situation"""
        self._watched: WatchedRun | None = None
        self._take(viewed)
        self._planner = Repeating("planner", self._plan, self._refused)
        self._said = threading.Event()
        """whether the sign on the page is that of the situation as it is"""
        self._saying = threading.Lock()
        """of what decides whether the sign becomes that of a search"""
        self._watcher = Repeating("watcher", self._watch, self._failed)

    def begin(self, shown: Shown) -> None:
        """Plan for the first time, and go on until `close`."""
        self.shown = shown
        self.playback.begin(shown.w, shown.view, shown.plots)
        for thread in (self._planner, self._watcher):
            thread.start()
        self.replan()
        self._watch_run()

    def close(self) -> None:
        """End the threads, and what waits for them."""
        self._closed.set()
        self._said.set()
        if self._watched is not None:
            self._watched.close()
        for thread in (self._planner, self._watcher):
            thread.close()
        self.playback.close()

    @property
    def answer(self) -> Answer | None:
        """The newest."""
        return self._answer

    def wait_for(self, holds: Callable[[Answer], bool], seconds: float) -> Answer:
        """Return the first answer from now on, or the newest, of which something holds.

        Raises:
            TimeoutError: there was none within so many seconds.
        """
        end = time.monotonic() + seconds
        with self._changed:
            while True:
                answer = self._answer
                if answer is not None and holds(answer):
                    return answer
                if not self._changed.wait(end - time.monotonic()):
                    raise TimeoutError(f"no such answer within {seconds:g} s")

    def edit(self, change: Edit) -> None:
        """Have the situation changed and planned for; one that is not legal is refused, and said."""

        def change_it() -> None:
            self.nodes.put(change(self.situation))
            self._tell(self.nodes.base)

        self._jobs.append(change_it)
        self.replan()

    def open(self, viewed: Viewed) -> None:
        """Have another task, plan or problem in the place of what is shown."""

        def take_it() -> None:
            goes_on = viewed.watched is not None and viewed.watched is self._watched
            if self._watched is not None and not goes_on:
                self._watched.close()
            with self.playback.moving:
                if not goes_on:
                    self.playback.follow(None)
                self.nodes.end()
                self.server.scene.reset()
                self._take(viewed)
            self._tell(self.nodes.base)
            self._watch_run()

        self._jobs.append(take_it)
        self.replan()

    def _take(self, viewed: Viewed) -> None:
        self.name, self._stated, self._to_watch = viewed.name, viewed.plan, viewed.watched
        self.stated_camera = viewed.situation.camera
        """before it was changed on the page"""
        self.nodes = SceneNodes(self.server, viewed.situation, self.replan)
        self.playback.take(self.nodes, viewed.run)

    def _watch_run(self) -> None:
        """Begin to watch the run that is to be watched, unless that was done."""
        watched = self._to_watch
        if watched is None or watched is self._watched:
            return
        self._watched = watched

        def watch() -> None:
            try:
                watched.watch(RunOnPage(self, watched))
            except Exception as error:
                self._failed(error)

        threading.Thread(target=watch, name="watched run", daemon=True).start()

    def replan(self) -> None:
        """Have it planned for as the handles are now."""
        self._request = next(self._requests)
        self._planner.wake()

    def is_settled(self, answer: Answer) -> bool:
        """Return whether an answer is final, and takes all changes until now into account."""
        return not answer.searching and answer.request == self._request

    @property
    def situation(self) -> Situation:
        """What is planned for, as the handles are now."""
        return self.nodes.situation

    def _watch(self) -> None:
        """Say that it is planned, where that takes a while: the sign of before is none of what is now."""
        if self._said.wait(_SOON):
            return
        with self._saying:  # it may have been said just then
            if not self._said.is_set():
                self.shown.status.content = PLANNING

    def _plan(self) -> None:
        self._said.clear()
        self._watcher.wake()
        request = self._request
        situation = self._edited()
        stated, self._stated = self._stated, None
        plan = plan_path(situation.problem) if stated is None else judged_again(stated)
        self.timings.plans.append(plan.seconds)
        with_arm = self.whole_arm and situation.arm is not None and stated is None
        at_risk = situation.risk > 0.0 and stated is None
        searching = with_arm or at_risk
        self._publish(Answer(self._number + 1, situation, plan, searching=searching, request=request))
        if at_risk:
            if not self._planner.woken_within(_AT_REST):
                self._plan_at_risk()
        elif with_arm and not self._planner.woken:
            final = self._arm_planned(WHILE_DRAGGED)
            if not final and not self._planner.woken_within(_AT_REST):
                self._arm_planned(None)
        if not self._planner.woken:
            self._tell(situation)

    def _edited(self) -> Situation:
        """Return the situation as the handles are, after the jobs that wait."""
        while self._jobs:
            self._jobs.popleft()()
        return self.situation

    def _tell(self, situation: Situation) -> None:
        for listener in self.listeners:
            listener(situation)

    def _arm_planned(self, budget: float | None) -> bool:
        """Publish the arm's plan for the newest answer; return whether a longer search changes nothing."""
        answer = self._answer
        if answer is None or (arm := answer.situation.arm) is None:
            return True
        found = plan_with_arm(answer.situation.problem, arm.setting, time_budget=budget)
        final = budget is None or found.plan.status in ("certified", "infeasible") or found.seconds < budget
        self._publish(replace(answer, number=self._number + 1, arm_plan=found, searching=not final))
        return final

    def _plan_at_risk(self) -> None:
        """Publish the plan at the situation's risk, which takes seconds: a handle that is dragged waits."""
        answer = self._answer
        if answer is None or (uncertain := answer.situation.uncertain) is None:
            return
        situation, estimate, rows = answer.situation, uncertain.estimate, uncertain.rows
        if self.whole_arm and situation.arm is not None:
            found = plan_arm_with_risk(
                situation.problem, situation.arm.setting, estimate, risk=situation.risk, points=rows
            )
        else:
            found = plan_with_risk(situation.problem, estimate, risk=situation.risk, points=rows)
        self._publish(replace(answer, number=self._number + 1, risk_plan=found, searching=False))

    def _publish(self, answer: Answer) -> None:
        begin = time.perf_counter()
        self._number = answer.number
        with self._saying:
            self._said.set()
        with self.server.atomic():
            self.nodes.show(answer)
            self.shown.status.content = status_html(answer)
        self.server.flush()  # it would wait for a sixtieth of a second for more
        with self._changed:
            self._answer = answer
            self._changed.notify_all()
        if not answer.searching:
            self.settled.set()
        worst = answer.worst
        if answer.verdict == "no path" and worst is not None and not self.playback.playing:
            self.shown.w.value = round(worst.w, 2)
        self.timings.publishing.append(time.perf_counter() - begin)
        self.playback.show()

    def servo(self) -> None:
        """Do the whole job in the simulator, watched; then its motion is played. For a thread of its own.

        Raises:
            InputError, NoSolutionError: the situation has no arm, its job is refused, or one is going on.
        """
        if self.playback.moment is not None or not self._serving.acquire(blocking=False):
            raise InputError("a servo is going on")
        try:
            self._do_job()
        finally:
            self._serving.release()

    def _do_job(self) -> None:
        situation, stage, nodes = self.situation, "", self.nodes  # other nodes: something else was opened
        task = edited_task(situation)

        def progress(now: str, done: float) -> None:
            nonlocal stage
            stage = now
            if now == "following the path" and self.nodes is nodes:
                self.shown.w.value = round(min(done, 1.0), 3)
            self.shown.job.content = job_html(f"servo: {now}")

        def watch(moment: Moment) -> None:
            self.shown.job.content = job_html(f"servo: {stage}; {moment.words}; {moment.time:.2f} s")
            with self.playback.moving:
                if self.nodes is nodes:
                    self.playback.follow(moment)

        try:
            result = servo_live(task, watch, progress)
        except Exception as error:
            self.shown.job.content = job_html(f"servo: {error}")
            raise
        finally:
            self.playback.follow(None)
        run = executed_of(result, situation.world_T_initial)
        self.shown.job.content = job_html(f"servo: {'stopped before a step' if run is None else run.ended}")
        if self.nodes is nodes:
            self.playback.take_run(run)
            self.playback.show()

    def replay(self) -> str:
        """Return the page as a file that opens without Python. For a thread of its own.

        Raises:
            InputError: there is no plan yet, or the page is closed.
        """
        done, found = threading.Event(), list[str | Exception]()

        def record() -> None:
            try:
                found.append(self._recorded())
            except Exception as error:
                found.append(error)
            done.set()

        self._jobs.append(record)
        self._planner.wake()
        while not done.wait(_SOON):
            if self._closed.is_set():
                raise InputError("the page is closed")
        if isinstance(found[0], Exception):
            raise found[0]
        return found[0]

    def _recorded(self) -> str:
        """Record the motion along the shown path, by the thread that plans: nothing changes meanwhile."""
        answer, view = self._answer, CameraView()
        if answer is None:
            raise InputError("there is no plan yet")
        with self.playback.moving:  # what is played, or goes on, waits
            serializer = self.server.get_scene_serializer()
            for w in places_of_replay(answer):
                joints = answer.joints(w)
                self.nodes.show_camera(answer.world_T_camera(w))
                if joints is not None:
                    self.nodes.show_arm(joints)
                serializer.insert_sleep(TICK)
            scene = serializer.as_html()
        self.playback.show()
        return replay_page(
            self.name,
            answer,
            scene,
            plots_html(curves_of(answer), 0.0),
            lambda w: view.drawn(
                answer.situation, answer.plan, answer.world_T_camera(w), answer.joints(min(w, answer.end)), w
            ),
        )

    def guarded(self, work: Callable[[Any], None]) -> Callable[[Any], Awaitable[None]]:
        """Return a callback for the server's loop, where events keep their order: it must be quick.

        What it raises is said on the page.
        """

        async def called(event: Any) -> None:
            try:
                work(event)
            except Exception as error:
                self._failed(error)

        return called

    def in_background(self, work: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return a callback for a thread of its own, where it may take its time."""

        def called(event: Any) -> None:
            try:
                work(event)
            except Exception as error:
                self._failed(error)

        return called

    def _refused(self, error: Exception) -> None:
        """Say why what a hand did is not planned for: the last answer is none for it."""
        with self._saying:
            self._said.set()
        with self._changed:
            self.shown.status.content = refused_html(_said(error))
            self._changed.notify_all()
        self.settled.set()
        if self._jobs:  # what was asked for after it
            self._planner.wake()
        if not isinstance(error, OmniservoError):
            self._failed(error)

    def _failed(self, error: Exception) -> None:
        self.shown.message("That did not work", _said(error))


def _said(error: Exception) -> str:
    """Return an error in words: of one that is no fault of the user's, with its name."""
    return str(error) if isinstance(error, OmniservoError) else f"{type(error).__name__}: {error}"
