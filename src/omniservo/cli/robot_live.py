"""``omniservo robot check`` and ``omniservo robot delay``."""

from __future__ import annotations

import math
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from omniservo.cli.grouped import grouped
from omniservo.cli.output import Output, answer_is_no
from omniservo.cli.robot_file import Approval, RobotParts, SpeedOption, YesOption
from omniservo.cli.robot_options import AllowOutsideOption
from omniservo.errors import InputError

if TYPE_CHECKING:
    from omniservo.runs.robot_check import LineClock, RobotCheck, StreamTimes

RobotArgument = Annotated[Path, typer.Argument(help="A robot file (YAML).")]


@grouped
def check(
    robot: RobotArgument,
    *,
    parts: RobotParts,
    yes: YesOption = False,
    allow_outside: AllowOutsideOption = False,
    output: Output,
) -> None:
    """Check a real robot: rates, ages, clocks, where it stands, its joints, and that it stops in silence.

    Every joint moves by half a degree and back. What was found is kept beside the robot file; run --on needs
    it. The newest check counts: one that is not passed leaves none.
    """
    with output.working("loading") as progress:
        from omniservo.runs.open_hardware import open_robot, open_robot_camera
        from omniservo.runs.robot_check import check_robot, rate_notice
        from omniservo.runs.robot_records import forget_check, save_check, stored_delay

        approval = Approval(progress, yes=yes)
        loaded = parts.load(robot, allow_outside=allow_outside)
        arm = loaded.loaded_arm()
        try:
            delay, unmeasured = stored_delay(robot, loaded, parts.driver), None
        except InputError as error:  # run --on refuses it; a robot may be checked before it is measured again
            delay, unmeasured = None, str(error)
        late = None if delay is None else delay.loop
        progress("connecting to arm and camera")
        connection = open_robot(loaded, arm, parts.driver)
        with closing(connection), closing(open_robot_camera(loaded, delay)) as camera:
            progress("listening")
            forget_check(robot)
            found = check_robot(loaded, arm, connection, camera, approval, late)
            slow = rate_notice(found.images, loaded.camera.rate)
            notices = [*getattr(connection, "notices", ()), *filter(None, [camera.notice, slow, unmeasured])]
    output.line(f"{'joints':<16} {_spelled(found.joints)}")
    output.line(f"{'images':<16} {'none' if found.images is None else _spelled(found.images)}")
    output.line(f"{'arm clock':<16} {_spelled_clock(found.arm_clock)}")
    output.line(f"{'camera clock':<16} {_spelled_clock(found.camera_clock)}")
    output.line(f"{'self-clearance':<16} {1e3 * found.self_clearance:.1f} mm")
    for answer in found.answers:
        sent, turned = math.degrees(answer.sent), math.degrees(answer.turned)
        output.line(f"{'joint':<16} {answer.joint}: sent by {sent:+.2f} deg, turned by {turned:+.2f} deg")
    if found.stop_seconds is not None:
        output.line(f"{'watchdog':<16} stands {found.stop_seconds:.3f} s after the last command")
    for notice in notices:
        output.line(f"{'notice':<16} {notice}")
    for finding in found.findings:
        output.line(f"{'to be mended':<16} {finding}")
    output.result(check_fields(found, "; ".join(notices) or None), "robot-check")
    if found.findings:
        raise answer_is_no("; ".join(found.findings))
    output.written(save_check(robot, loaded, parts.driver))


def check_fields(found: RobotCheck, notice: str | None) -> dict[str, Any]:
    """Return what is printed of a check."""
    return {**asdict(found), "fit": not found.findings, "notice": notice}


@grouped
def delay(
    robot: RobotArgument,
    *,
    parts: RobotParts,
    speed: SpeedOption = None,
    yes: YesOption = False,
    allow_outside: AllowOutsideOption = False,
    output: Output,
) -> None:
    """Find how late a real robot's images and motions are: two joints swing for four seconds.

    The camera must see something static with texture. What was found is kept beside the robot file, and
    used by run --on. The newest counts: a robot that is refused leaves none.
    """
    with output.working("loading") as progress:
        from omniservo.runs.open_hardware import open_bare
        from omniservo.runs.robot_delay import measure_delay
        from omniservo.runs.robot_records import forget_delay, save_delay
        from omniservo.safety import SafetyOptions

        approval = Approval(progress, yes=yes)
        loaded = parts.load(robot, speed, allow_outside=allow_outside)
        progress("connecting to arm and camera")
        options = SafetyOptions(image_age=1.0, time_offset=0.5)
        with closing(open_bare(loaded, approval, options, parts.driver)) as cell:
            progress("measuring how late images and motions are")
            forget_delay(robot)
            found = measure_delay(cell, options)
    camera = found.camera
    lag = _spelled_time(found.actuation_lag, found.actuation_sigma)
    output.line(f"{'camera':<16} {_spelled_time(camera.offset, camera.sigma)} from its stamps to the joints'")
    output.line(f"{'actuation':<16} {lag} behind commands")
    output.line(f"{'images':<16} {1e3 * found.image_age:.1f} ms from their stamps until they come (99%)")
    output.line(f"{'residual':<16} {camera.rms_px:.2f} px rms, {found.images} images, {camera.flow:.0f} px/s")
    output.result(
        {
            "camera_offset_s": camera.offset,
            "camera_offset_sigma_s": camera.sigma,
            "actuation_lag_s": found.actuation_lag,
            "actuation_lag_sigma_s": found.actuation_sigma,
            "image_age_s": found.image_age,
            "residual_px": camera.rms_px,
            "images": found.images,
        },
        "robot-delay",
    )
    output.written(save_delay(robot, loaded, found, parts.driver))


def _spelled(times: StreamTimes) -> str:
    age = f"{1e3 * times.age_median:.1f} ms old (99%: {1e3 * times.age_p99:.1f} ms)"
    return f"{times.rate:.1f} a second, {age}, jitter {1e3 * times.jitter:.1f} ms"


def _spelled_clock(clock: LineClock | None) -> str:
    if clock is None:
        return "this machine's, or no stamps"
    from omniservo.runs.robot_check import SECONDS

    drift = f"{1e6 * clock.drift:+.0f} ± {1e6 * clock.spread / SECONDS:.0f} ppm"  # as late as messages may be
    slower = f", the line slower by {1e3 * clock.later:.0f} ms by now" if clock.later > 0.0 else ""
    return (
        f"{clock.offset:+.3f} s from the stamps to this machine's time, least delay included, drift {drift}, "
        f"spread {1e3 * clock.spread:.1f} ms{slower}"
    )


def _spelled_time(value: float, sigma: float) -> str:
    return f"{1e3 * value:+.1f} ± {1e3 * sigma:.1f} ms"
