"""Images that are missing for a while: the arm slows down on its path, stands, and goes on."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.safety.conftest import START, WrittenDown
from tests.safety.test_closed_loop import Points

from omniservo.planning import CameraPath
from omniservo.robots import ArmMode
from omniservo.safety import SafetyOptions, Supervisor, VisibilityFilter, servo
from omniservo.safety.camera_motion import CameraMotion
from omniservo.scenes import Sensor
from omniservo.servoing import RestToRestLaw, servo_method
from omniservo.simulation import SimulatedRobot
from omniservo.tracking import GoalServo, PathTracker, TrackerOptions

ROOM = 0.01
"""[m] that the path keeps for tracking"""
SILENT = (1.5, 2.5)
"""[s] in mid motion"""
PERIOD = 1.0 / 30.0


def bent_path():
    turn = Rotation.from_rotvec([0.05, -0.12, 0.1]).as_quat()
    still = np.array([0.0, 0.0, 0.0, 1.0])
    bend = np.array([0.03, 0.03, 0.01])
    rotation = np.column_stack((np.zeros(4), turn - still, still))
    return CameraPath(rotation, np.column_stack((bend, np.array([0.06, -0.08, 0.1]) - bend, np.zeros(3))))


class Silent:
    """The line to the arm; its camera gives nothing new in some spans of time."""

    def __init__(self, written, *spans):
        self._written, self.spans, self._held = written, spans, None

    def __getattr__(self, name):
        return getattr(self._written, name)

    def image(self):
        time = self._written.robot.time
        if not any(begin <= time < end for begin, end in self.spans):
            self._held = self._written.image()
        return self._held


class Seen(Points):
    """The true points, of the image that the loop was given."""

    def __init__(self, line, scene):
        super().__init__(line._written, scene)
        self._line, self.shift = line, np.zeros(2)
        self.lost = ()
        self.looked = []

    def update(self, image, predicted):
        time = self._line._held.time
        place = self._robot.world_T_camera(time)
        pixels, _ = self._scene.camera.project(place.inv().apply(self._scene.dots.centers))
        few = any(begin <= time < end for begin, end in self.lost)
        seen = np.arange(9) < 3 if few else np.ones(9, dtype=bool)
        self.looked.append((time, np.abs(predicted - pixels).max()))
        return np.where(seen[:, None], pixels + self.shift, np.nan), seen


class Drive:
    """One servo along the path; what came of it."""

    def __init__(
        self, written, scene, *spans, prepare=lambda drive: None, servoed="path", seconds=4.0, until=12.0,
        **options,
    ):  # fmt: skip
        self.written, self.scene = written, scene
        written.robot.place(START)
        written.commands, written.joints, written.broken = [(0.0, np.zeros(6))], [], {}
        self.line = Silent(written, *spans)
        self.features = Seen(self.line, scene)
        self.options = {"image_age": 0.25, "blind_room": ROOM, "patience": 2.0} | options
        self.start = scene.world_T_camera(scene.start_joints)
        points = self.start.inv().apply(scene.dots.centers)
        if servoed == "path":
            plan = SimpleNamespace(
                path=bent_path(), problem=SimpleNamespace(points=points), status="certified"
            )
            delay = TrackerOptions(delay=0.02 + 0.5 * PERIOD)
            self.controller = PathTracker(plan, scene.camera, options=delay, time_law=RestToRestLaw(seconds))
        else:
            goal, _ = scene.camera.project(bent_path()(0.5).inv().apply(points))
            self.controller = GoalServo(scene.camera, points, goal, method=servo_method("ibvs", 2.0))
        self.supervisor = Supervisor(
            written, scene.arm, scene.flange_T_camera, camera=self.line, wait=written.advance,
            options=SafetyOptions(**self.options),
        )  # fmt: skip
        self.steps, self.waits, self.moved = [], [], []
        self.hooks = []
        advance = written.robot.advance

        def watched(duration):
            for _ in range(round(duration / 1e-3)):
                advance(1e-3)
                self.moved.append((written.robot.time, written.robot.read().joint_velocities))
                for hook in self.hooks:
                    hook(written.robot.time)

        written.robot.advance = watched
        prepare(self)
        try:
            self.stop = servo(
                self.supervisor, self.controller, self.features,
                VisibilityFilter(scene.camera, delay=0.02, options=SafetyOptions(**self.options)),
                on_step=self.steps.append, on_wait=self.waits.append, time_limit=until,
            )  # fmt: skip
        finally:
            written.robot.advance = advance

    @property
    def goes_on(self):
        """Whether it was still on its way when its time was over."""
        return self.stop.reason == "time_limit"

    def speed(self, begin, end):
        """The fastest that a joint turned in a span [rad/s]."""
        return max(np.abs(v).max() for t, v in self.moved if begin <= t <= end)

    def off_path(self):
        """How far the true camera was from the path at most [m]."""
        line = bent_path()(np.linspace(0.0, 1.0, 2001)).translation
        places = [
            (self.start.inv() * self.scene.world_T_camera(q)).translation for q in self.written.joints[::20]
        ]
        return max(np.linalg.norm(line - place, axis=1).min() for place in places)


@pytest.fixture(scope="module")
def blind(scene):
    return SimulatedRobot(scene, rendered=False)


@pytest.fixture
def written(blind):
    return WrittenDown(blind)


@pytest.fixture
def drive(written, scene):
    return lambda *spans, **others: Drive(written, scene, *spans, **others)


@pytest.fixture(scope="module")
def silent(scene):
    """A drive with a second of silence in mid motion."""
    return Drive(WrittenDown(SimulatedRobot(scene, rendered=False)), scene, SILENT)


def test_a_second_of_silence_in_mid_motion_is_waited_for_and_the_goal_is_reached(silent):
    run = silent
    assert run.stop is None
    stands, waited = run.waits
    assert SILENT[0] < stands.since < SILENT[0] + 0.15
    assert np.isnan(stands.until)
    assert stands.why.startswith("no new image for 0.")
    assert stands.stands_at < stands.since + 0.2
    assert run.speed(stands.stands_at + 0.15, waited.until - 0.01) < 1e-3
    assert run.speed(1.0, 1.4) > 0.02
    assert SILENT[1] <= waited.until < SILENT[1] + 0.1
    assert run.off_path() < 2e-3 < ROOM
    assert run.controller.report.w == pytest.approx(1.0, abs=1e-6)


def late(drive):
    """Let images come every 0.08 s, 0.14 s after their exposure; every fifth is lost."""
    kept, line = [], drive.line

    def image():
        newest = line._written.image()
        if newest is not None and (not kept or newest.time > kept[-1].time + 0.08 - 1e-6):
            kept.append(newest)
        shown = [
            each for k, each in enumerate(kept) if k % 5 != 4 and each.time <= line._written.robot.time - 0.14
        ]
        line._held = shown[-1] if shown else None
        return line._held

    line.image = image


def test_an_image_too_old_before_a_late_one_would_be_missing_is_waited_for_and_ends_nothing(drive):
    run = drive(prepare=late, until=40.0)
    assert run.stop is None
    assert len(run.waits) > 5
    assert run.off_path() < ROOM


def test_an_arm_stands_whatever_is_raised_by_who_is_told_that_it_waits(drive, written):
    def told(run):
        run.waits = SimpleNamespace(append=lambda waiting: 1 / 0)

    with pytest.raises(ZeroDivisionError):
        drive(SILENT, prepare=told)
    assert not written.commands[-1][1].any()
    written.robot.advance(0.1)
    assert np.abs(written.robot.read().joint_velocities).max() < 1e-2


@pytest.mark.slow
def test_it_takes_as_much_longer_as_it_was_silent_and_slowed(drive, silent):
    whole = drive()
    assert (whole.stop, whole.waits) == (None, [])
    longer = silent.steps[-1].time - whole.steps[-1].time
    assert 1.0 < longer < 1.5


def test_an_image_that_comes_just_after_it_began_to_slow_down_does_not_make_it_stand(drive):
    run = drive((1.5, 1.58), blind_room=0.0, until=2.0)
    stands, waited = run.waits
    assert stands.since < waited.until < stands.stands_at
    before = run.speed(stands.since - 0.02, stands.since)
    after = [np.abs(v).max() for t, v in run.moved if stands.since < t < waited.until + 0.1]
    assert min(after) > 0.5 * before
    assert run.goes_on


@pytest.mark.parametrize("age", [0.25, 5.0])  # of an image; it stands where the reference does
def test_standing_is_commanded_again_and_again(drive, silent, age):
    run = silent if age == silent.options["image_age"] else drive(SILENT, image_age=age, until=2.7)
    stands, waited = run.waits
    later = [v for t, v in run.written.commands if stands.stands_at + 0.1 < t < waited.until]
    assert not np.any(later)
    times = [t for t, v in run.written.commands if stands.stands_at + 0.1 < t < waited.until and not v.any()]
    assert len(times) > 40
    assert np.diff(times).max() < 0.03


def test_while_it_slows_down_and_rises_again_the_joints_keep_their_accelerations(silent, arm):
    run = silent
    times = np.array([t for t, _ in run.moved])
    speeds = np.array([v for _, v in run.moved])
    change = np.abs(speeds[20:] - speeds[:-20]) / (times[20:] - times[:-20])[:, None]
    assert (change.max(axis=0) < arm.joint_acceleration).all()
    stands = run.waits[0]
    slowing = (times > stands.since - 0.03) & (times < stands.stands_at + 0.05)
    assert (np.abs(np.diff(speeds[slowing], axis=0)).max(axis=0) / 1e-3 < arm.joint_acceleration).all()


@pytest.mark.slow
def test_what_moves_fast_takes_longer_to_slow_down(drive, arm):
    run = drive((0.7, 1.7), seconds=1.4, blind_room=0.0)
    assert run.stop is None
    stands = run.waits[0]
    before = next(v for t, v in run.moved if t > stands.since - 0.03)
    braking = np.abs(before / arm.joint_acceleration).max()
    assert 1.6 * braking < stands.stands_at - stands.since < 2.4 * braking
    assert stands.stands_at - stands.since > 0.05
    slowing = [v for t, v in run.moved if stands.since < t < stands.stands_at]
    share = np.abs(slowing[30] - slowing[-30]) / (1e-3 * (len(slowing) - 60)) / arm.joint_acceleration
    assert share.max() < 0.95


def moved_blind(run, scene):
    """How far the true camera is, while it waits, from where the last image saw it [m]."""
    stands, waited = run.waits[:2]
    last = max(step.image.time for step in run.steps if step.time < stands.since)
    seen = scene.world_T_camera(run.written.robot.exposure(last)[0]).translation
    joints = run.written.robot.exposure(
        min(t for t in run.written.robot._exposed if t > waited.until - 0.05)
    )[0]
    return float(np.linalg.norm(scene.world_T_camera(joints).translation - seen))


@pytest.mark.slow
def test_it_stands_within_the_room_that_it_has(drive, silent, scene):
    at_once = moved_blind(drive(SILENT, blind_room=0.0, until=2.7), scene)
    smaller = drive(SILENT, blind_room=0.006, until=2.7)
    assert smaller.goes_on
    for room, run in ((ROOM, silent), (0.006, smaller)):
        assert 0.9 * room < moved_blind(run, scene) < room
    assert 0.006 < at_once < 0.01  # the smaller room made it slow down earlier, the larger one more gently


@pytest.mark.slow
def test_where_room_is_too_small_it_still_moves_on_until_an_image_is_missing(drive, scene):
    run = drive(SILENT, blind_room=0.001, until=2.7)
    assert run.goes_on
    assert [np.isnan(wait.until) for wait in run.waits] == [True, False]
    assert run.waits[0].since > SILENT[0] + 1.4 * PERIOD - PERIOD


@pytest.mark.slow
def test_longer_than_the_patience_is_a_stop_by_the_name_of_stale_images(drive):
    run = drive((1.5, 9.0), patience=1.0)
    assert run.stop.reason == "stale_image"
    assert str(run.stop).startswith("no new image for 1.00")
    assert "at most 1 s is waited" in str(run.stop)
    end = run.moved[-1][0]
    assert 2.4 < run.waits[-1].until < 2.6
    assert run.speed(end - 0.1, end) < 1e-3
    assert run.supervisor.stopped is run.stop


@pytest.mark.slow
def test_an_image_of_another_place_ends_the_run_by_name_before_it_moves(drive):
    def prepare(run):
        def shift(time):
            run.features.shift = np.array([12.0, 9.0]) if time > 1.6 else np.zeros(2)

        run.hooks.append(shift)

    run = drive(SILENT, prepare=prepare)
    assert run.stop.reason == "inconsistent_image"
    assert run.speed(run.waits[0].stands_at + 0.15, run.moved[-1][0]) < 1e-3


def test_a_second_image_is_not_waited_for_to_tell_that(drive):
    run = drive(
        SILENT,
        prepare=lambda run: run.hooks.append(lambda t: setattr(run.features, "shift", 15.0 * (t > 2.0))),
    )
    assert run.stop.reason == "inconsistent_image"
    assert max(time for time, _ in run.features.looked) < SILENT[1] + 0.02
    assert len([time for time, _ in run.features.looked if time > SILENT[0]]) == 1


@pytest.mark.parametrize(
    ("mode", "reason"),
    [(ArmMode.PROTECTIVE_STOP, "protective_stop"), (ArmMode.NOT_IN_CONTROL, "not_in_control")],
)
def test_what_stops_it_while_it_waits_stays_though_images_are_back(drive, written, mode, reason):
    def prepare(run):
        run.hooks.append(lambda t: setattr(written, "broken", {"mode": mode} if 2.0 < t < 2.2 else {}))

    run = drive(SILENT, prepare=prepare)
    assert run.stop.reason == reason
    assert run.steps[-1].time < SILENT[0]
    assert not np.isnan(run.waits[-1].until)
    assert run.supervisor.stopped is run.stop


def test_points_that_are_lost_for_a_moment_are_waited_for_too(drive):
    def prepare(run):
        run.features.lost = (SILENT,)

    run = drive(prepare=prepare, until=2.9)
    assert run.goes_on
    stands, waited = run.waits
    assert stands.why == "3 of 9 points are usable; at least 4 are needed"
    assert run.speed(stands.stands_at + 0.15, waited.until - 0.01) < 1e-3
    assert not any(SILENT[0] < step.time < SILENT[1] - 0.02 for step in run.steps)


@pytest.mark.slow
def test_points_that_stay_lost_are_a_stop_by_their_own_name(drive):
    def prepare(run):
        run.features.lost = ((1.5, 99.0),)

    run = drive(prepare=prepare, patience=1.0)
    assert run.stop.reason == "feature_loss"
    assert 2.4 < run.waits[-1].until < 2.7


@pytest.mark.slow
def test_a_frame_lost_and_a_late_one_do_not_slow_it_down(drive):
    """Nor do they with a patience shorter than the age allowed, which counts as that."""
    run = drive((1.5, 1.5 + 1.9 * PERIOD), patience=0.04)
    assert (run.stop, run.waits) == (None, [])


@pytest.mark.slow
def test_a_slow_camera_is_no_gap(scene):
    slow = replace(scene, sensor=Sensor(rate=6.0, latency=0.02))
    run = Drive(WrittenDown(SimulatedRobot(slow, rendered=False)), slow)
    assert run.stop is None
    assert run.waits == []


@pytest.mark.slow
def test_old_images_are_not_acted_on_and_fresh_ones_after_them_are(drive):
    def prepare(run):
        plain = run.line.image
        kept = {}

        def old(*_):
            if 1.9 < run.written.robot.time < SILENT[1]:  # a line that delivers what it kept, late
                image = kept.setdefault("image", run.written.robot.image())
                run.line._held = image if run.written.robot.time > image.time + 0.4 else run.line._held
                return run.line._held
            return plain()

        run.line.image = old

    run = drive(SILENT, prepare=prepare, until=3.0)
    assert run.goes_on
    assert not any(SILENT[0] + 0.02 < step.image.time < SILENT[1] - 0.05 for step in run.steps)


@pytest.mark.slow
def test_without_a_path_it_is_braked_at_once_and_goes_on_all_the_same(drive, scene):
    run = drive((0.5, 1.5), servoed="goal")
    assert run.stop is None
    stands, waited = run.waits
    assert stands.stands_at == stands.since
    assert run.speed(stands.since + 0.25, waited.until - 0.01) < 1e-3
    after = [off for time, off in run.features.looked if time > 1.45]
    assert (
        after[0] < 0.01
    )  # where it is looked for is where joints have the camera, not where the last twist led


def test_points_are_looked_for_after_the_gap_where_the_joints_have_the_camera(silent):
    first = next(off for time, off in silent.features.looked if time > SILENT[0] + 0.02)
    assert first < 0.01


@pytest.mark.slow
def test_several_gaps_are_several_waits(drive):
    run = drive((0.8, 1.2), (1.35, 1.8), (3.0, 4.5))
    assert run.stop is None
    assert [np.isnan(wait.until) for wait in run.waits] == [True, False] * 3
    assert run.off_path() < 2e-3


@pytest.mark.slow
def test_a_gap_at_the_goal_is_waited_for(drive):
    run = drive((4.0, 5.0))
    assert run.stop is None
    assert len(run.waits) == 2
    assert run.steps[-1].time > 5.0


def test_what_was_seen_is_carried_by_what_the_joints_did_and_not_by_what_they_were_commanded(
    drive, monkeypatch
):
    """Drives that turn three quarters of what they are sent."""
    seen = []
    plain = VisibilityFilter.step

    def watched(self, points, pixels, valid, wanted, delay=None, carried=None):
        seen.append((delay, carried))
        return plain(self, points, pixels, valid, wanted, delay, carried)

    def prepare(run):
        sound = run.written.robot.command
        run.written.robot.command = lambda velocities: sound(0.75 * np.asarray(velocities))

    monkeypatch.setattr(VisibilityFilter, "step", watched)
    run = drive(prepare=prepare, until=3.1)
    del run.written.robot.command
    assert run.goes_on
    off = [off for time, off in run.features.looked if 1.0 < time < 3.0]
    assert max(off) < 1e-3  # [px]; 0.05 by the plan
    behind = [step for step in run.steps if 1.5 < step.time < 2.5]
    for step in behind:
        delay, carried = seen[run.steps.index(step)]
        truth = [run.written.robot.exposure(time)[0] for time in nearest(run.written.robot, step.image.time)]
        before, after = (run.scene.world_T_camera(q) for q in truth)
        turn_and_shift = (before.inv() * after).as_exp_coords() / PERIOD
        np.testing.assert_allclose(carried, np.roll(turn_and_shift, 3), atol=0.02)
        assert delay == pytest.approx(0.02, abs=5e-3)
        assert np.linalg.norm(carried[:3]) < 0.85 * np.linalg.norm(step.filtered.twist[:3])


def nearest(robot, time):
    """The times of an exposure and of the next one."""
    return sorted(t for t in robot._exposed if t >= time)[:2]


@pytest.mark.slow
@pytest.mark.parametrize("age", [0.13, 0.085])  # of the younger it has to brake at once
def test_where_images_may_hardly_grow_old_it_slows_down_earlier(drive, age):
    run = drive(SILENT, image_age=age, until=2.7)
    assert run.goes_on
    stands, _ = run.waits
    assert stands.since < SILENT[0] + 1.8 * PERIOD  # the last image came up to a period before the gap


def test_the_reference_goes_on_when_the_first_twist_acts_and_not_at_once_as_fast_as_planned(drive):
    run = drive(SILENT, command_lag=0.03, until=2.8)
    _, waited = run.waits
    assert waited.resumed == pytest.approx(waited.until + 0.03)
    assert waited.rising >= 0.3
    assert run.speed(waited.until, waited.until + 0.05) < 0.25 * run.speed(1.3, 1.5)


def test_points_that_were_lost_and_found_are_not_the_reason_of_a_later_silence(drive):
    def prepare(run):
        run.features.lost = ((1.0, 1.2),)

    run = drive((1.8, 9.0), prepare=prepare, patience=1.0)
    assert run.stop.reason == "stale_image"
    assert [wait.why[:6] for wait in run.waits[::2]] == ["3 of 9", "no new"]


def test_the_tracker_is_given_how_uncertain_a_stamp_is(drive, monkeypatch):
    sigmas = set()
    plain = PathTracker.step

    def watched(self, time, pixels, valid, acts_at=None, time_sigma=0.0):
        sigmas.add(time_sigma)
        return plain(self, time, pixels, valid, acts_at, time_sigma)

    def prepare(run):
        sound = run.line.image

        def uncertain():
            image = sound()
            return None if image is None else replace(image, time_sigma=0.002)

        run.line.image = uncertain

    monkeypatch.setattr(PathTracker, "step", watched)
    assert drive(prepare=prepare, until=0.5).goes_on
    assert sigmas == {0.002}


@pytest.mark.slow
def test_a_gap_is_no_period_of_the_camera(drive, monkeypatch):
    delays = []
    plain = PathTracker.step

    def watched(self, time, pixels, valid, acts_at=None, time_sigma=0.0):
        delays.append((time, acts_at - time))
        return plain(self, time, pixels, valid, acts_at, time_sigma)

    monkeypatch.setattr(PathTracker, "step", watched)
    run = drive((0.04, 1.04), until=2.0)  # after the first image
    assert run.goes_on
    assert max(delay for time, delay in delays if time > 1.0) < 0.1


def test_where_the_joints_have_the_camera_is_known_for_the_lag_of_a_command_after_the_last_reading(
    written, scene, arm
):
    written.robot.place(START)
    options = SafetyOptions(image_age=1e6, command_lag=0.04)
    supervisor = Supervisor(
        written, arm, scene.flange_T_camera, camera=written, wait=written.advance, options=options
    )
    turning = np.array([0.1, -0.05, 0.08, 0.1, -0.1, 0.2])
    supervisor.command(turning)
    supervisor.wait(0.5)
    where = CameraMotion(supervisor, 0.2)
    assert where.until == pytest.approx(0.5 - 0.2 + 0.04)
    exposed = next(time for time in sorted(written.robot._exposed) if time > 0.3)
    truth = arm.base_T_flange(written.robot.exposure(exposed)[0]) * scene.flange_T_camera
    np.testing.assert_allclose(where(exposed - 0.2)[4:], truth.translation, atol=1e-5)
    ahead = arm.base_T_flange(written.robot.read().joint_positions + 0.04 * turning) * scene.flange_T_camera
    np.testing.assert_allclose(where(where.until)[4:], ahead.translation, atol=1e-5)
    assert not where.mean_twist(0.1, 0.1).any()
    jacobian = arm.camera_jacobian(written.robot.read().joint_positions, scene.flange_T_camera)
    np.testing.assert_allclose(where.mean_twist(0.28, where.until), jacobian @ turning, atol=5e-3)
