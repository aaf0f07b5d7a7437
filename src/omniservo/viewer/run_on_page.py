"""A run that goes on elsewhere, on the page."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import FloatArray
from omniservo.planning import Plan
from omniservo.viewer.executed_run import ExecutedRun
from omniservo.viewer.moment import Moment
from omniservo.viewer.open_viewed import Viewed, situation_of
from omniservo.viewer.status import job_html
from omniservo.viewer.watched_run import WatchedRun

if TYPE_CHECKING:
    from omniservo.viewer.page import Page


class RunOnPage:
    """Shows what a `WatchedRun` tells.

    Args:
        page: on which.
        watched: the run.
    """

    def __init__(self, page: Page, watched: WatchedRun) -> None:
        self._page, self._watched = page, watched
        self._planned: Viewed | None = None

    def planned(self, plan: Plan, world_T_initial: RigidTransform, joints: FloatArray) -> None:
        """Show a plan, and the arm (n,) where it begins."""
        situation = situation_of(self._watched.task, plan.problem, self._watched.scene)
        begun = situation.moved_as_a_whole(world_T_initial, joints)
        self._planned = Viewed(self._page.name, begun, plan, watched=self._watched)
        self._page.open(self._planned)

    def moved(self, moment: Moment) -> None:
        """Show the arm as it is now, unless something else was opened meanwhile."""
        with self._page.playback.moving:
            if self._watched.is_closed:
                return
            self._page.playback.follow(moment)
        self.said(f"{moment.time:.1f} s: {moment.words}")

    def said(self, words: str) -> None:
        """Show what the run says of itself."""
        self._page.shown.job.content = job_html(f"watching a run, nothing is sent to it; {words}")

    def ended(self, words: str, run: ExecutedRun | None) -> None:
        """Show that it is over, and what was done; None: no step."""
        self._page.playback.follow(None)
        if self._planned is not None:
            self._page.open(replace(self._planned, run=run))
        self._page.shown.job.content = job_html(f"the run has ended: {words}")
