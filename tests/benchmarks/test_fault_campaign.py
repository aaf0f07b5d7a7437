"""Every kind of fault ends at the goal or in a named safe stop; what would not is found out."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("benchmarks.fault_campaign", reason="benchmarks/ is not part of this copy")

from benchmarks.fault_campaign import KINDS, SAFE, Row, ended, rows_of, run_rows, table
from benchmarks.free_camera import FreeBody, FreeJob, free_job
from benchmarks.motion_faults import SOUND, Outcome, outcome

from benchmarks import fault_campaign, motion_faults, planted_faults
from omniservo.planning import Sphere
from omniservo.safety import SafetyOptions
from omniservo.safety.image_watch import ImageWatch

FAULTS = {fault.name: fault for fault in KINDS if fault is not None}
ISSUE = {  # what may break, and what it is to be called
    "no image": {"stale_image"},
    "an old image again, 30%": {"inconsistent_image", "divergence"},
    "images 0.2 s later": {"stale_image"},
    "corrupted images": {"divergence", "inconsistent_image"},
    "all points occluded": {"feature_loss"},
    "50% false features": {"divergence", "inconsistent_image"},
    "target nudged by 100 mm": {"inconsistent_image", "divergence"},
    "target nudged by 30 mm": {"inconsistent_image", "off_path"},
    "dead joint": {"not_following"},
    "NaN joint": {"not_finite"},
    "NaN in a valid row": {"not_finite"},
}


@pytest.fixture(scope="module")
def job():
    """A scene whose path is short and passes a ball nearby."""
    return free_job(5)


def run(job, name):
    safety = SafetyOptions(path_room=job.room, patience=0.5)
    return outcome(job, SOUND[0], FAULTS.get(name), (0, 0), safety)


@pytest.mark.slow
def test_a_run_without_a_fault_reaches_the_goal(job):
    assert ended(run(job, "none")) == ("success", "")


@pytest.mark.parametrize("name", ISSUE)
def test_a_fault_ends_in_a_stop_of_its_name_without_contact(job, name):
    found = run(job, name)
    assert ended(found) == ("named stop", found.reason)
    assert found.reason in ISSUE[name]


@pytest.mark.slow
def test_all_points_that_jump_in_a_fast_turn_are_told_and_are_no_false_goal(monkeypatch):
    assert fault_campaign.run_row(284).reason == "inconsistent_image"
    monkeypatch.setattr(ImageWatch, "_lasts", lambda *args: False)
    assert fault_campaign.run_row(284).end == "untold"


@pytest.mark.slow
def test_without_the_watch_over_images_a_false_goal_is_found_out(job, monkeypatch):
    monkeypatch.setattr(ImageWatch, "check", lambda *args, **kwargs: None)
    assert ended(run(job, "all points off by 20 px"))[0] == "untold"


def test_a_supervisor_that_sends_nan_is_found_out(job, monkeypatch):
    class Careless(motion_faults.Timed):
        def stop(self, reason=None):
            super().stop(reason)
            self._robot.command(np.full(6, np.nan))

        def __init__(self, clock, robot, arm, mount, options):
            super().__init__(clock, robot, arm, mount, options)
            self._robot = robot

    monkeypatch.setattr(motion_faults, "Timed", Careless)
    monkeypatch.setattr(motion_faults, "DrivenArm", Deaf)
    assert ended(run(job, "no image"))[0] == "NaN"


class Deaf(motion_faults.DrivenArm):
    """Notes what it is sent, and follows only what is finite."""

    def command(self, joint_velocities):
        sent = np.array(joint_velocities, dtype=np.float64)
        super().command(np.nan_to_num(sent))
        self.commands[-1] = (self.time, sent)


def test_a_contact_is_found_out(job):
    start = np.array(job.plan.path(0.05).translation)
    inside = replace(job.scene, obstacles=(Sphere(start, 0.02),))
    touched = FreeJob(job.truth, job.plan, job.branch, job.law, inside)
    assert ended(run(touched, "no image"))[0] == "contact"


def test_ends_are_told_apart_the_worst_first():
    good = Outcome("", np.nan, 0.01, 0.02, finite=True, goal_px=0.1)
    assert ended(good)[0] == "success"
    assert ended(replace(good, reason="divergence", goal_px=90.0))[0] == "named stop"
    assert ended(replace(good, goal_px=9.0))[0] == "untold"
    assert ended(replace(good, goal_px=np.nan))[0] == "untold"
    assert ended(replace(good, finite=False))[0] == "NaN"
    assert ended(replace(good, distance=0.0, reason="divergence"))[0] == "contact"


def test_an_interrupted_file_goes_on_with_the_rows_that_it_lacks(tmp_path, monkeypatch):
    done = []

    def row(number):
        done.append(number)
        return Row(number, "arm", "dead joint", "named stop", "not_following", 0.01)

    monkeypatch.setattr(fault_campaign, "run_row", row)
    file = tmp_path / "runs" / "faults.jsonl"
    run_rows(range(3), file)
    whole = file.read_text()
    file.write_text(whole[:-9])  # killed in the middle of a line
    run_rows(range(4), file)
    assert done == [0, 1, 2, 2, 3]
    assert [found.row for found in rows_of(file)] == [0, 1, 2, 3]
    assert file.read_text().startswith(whole)
    assert "| dead joint | 4 | 0 | `not_following` 4 | 0 | 0 | 0 | 0 | 10.0 |" in list(table(rows_of(file)))


def test_an_exception_is_a_row_that_is_not_safe(job, monkeypatch):
    def broken(*args):
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr(fault_campaign, "free_job", lambda index: job)
    monkeypatch.setattr(fault_campaign, "outcome", broken)
    row = fault_campaign.run_row(2)
    assert (row.end, row.reason) == ("error", "ZeroDivisionError: by nothing")
    assert row.end not in SAFE


def test_every_kind_of_fault_has_a_name_of_its_own():
    names = [fault.name for fault in (*planted_faults.FAULTS, *planted_faults.BORNE)]
    assert len(set(names)) == len(names) == len(KINDS) - 1


def test_a_free_body_moves_as_its_jacobian_says():
    body, random, step = FreeBody(), np.random.default_rng(0), 1e-6
    for q, change in random.normal(size=(6, 2, 6)):
        before, after = (body.base_T_flange(q + h * change) for h in (-step, step))
        moved = before.inv() * after
        twist = np.concatenate([moved.translation, moved.rotation.as_rotvec()]) / (2.0 * step)
        np.testing.assert_allclose(body.flange_jacobian(q) @ change, twist, atol=1e-5)
    pose = body.base_T_flange([0.1, 0.2, 0.3, 0.0, 0.0, 0.5])
    assert (pose.rotation * Rotation.from_rotvec([0.0, 0.0, -0.5])).magnitude() < 1e-12
