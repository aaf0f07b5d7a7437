"""What a robot file says of an arm under ROS 2, and what is refused of it."""

import pytest

from omniservo.errors import InputError
from omniservo.hardware.ros2 import open_ros2
from omniservo.hardware.ros2.commands import TrajectoryCommands, TwistCommands, VelocityCommands
from omniservo.hardware.ros2.open_ros2 import network_of, open_ros2_arm
from omniservo.robots import load_arm

ARM = load_arm("ur5e")
NAMES = ARM.joint_names


@pytest.fixture
def opened(monkeypatch):
    """Open an arm as far as its connection; return the commands that it is to have."""

    def connect(names, accelerations, commands, **given):
        assert (names, list(accelerations)) == (NAMES, list(ARM.joint_acceleration))
        return commands, given

    monkeypatch.setattr(open_ros2, "Ros2Arm", connect)
    return lambda watchdog=None, **options: open_ros2_arm("3@localhost", NAMES, ARM, watchdog, **options)


def test_trajectories_that_end_at_rest_are_the_default(opened):
    commands, given = opened()
    assert commands == TrajectoryCommands()
    assert given["network"].domain_id == 3


def test_the_velocity_controllers_own_order_of_joints_is_stated_and_never_guessed(opened):
    order = NAMES[::-1]
    commands, _ = opened(0.1, commands=f"velocity:{', '.join(order)}", topic="/v")
    assert commands == VelocityCommands(order, 0.1, topic="/v")
    for wrong in ("velocity", "velocity:", "twist", "trajectory:x", "position", ""):
        with pytest.raises(InputError, match=r"options: commands: .* given; legal: trajectory, velo"):
            opened(0.1, commands=wrong)


def test_what_keeps_its_last_velocity_needs_a_watchdog_of_the_users_own(opened):
    for stated in (f"velocity:{','.join(NAMES)}", "twist:base"):
        commands, _ = opened(None, commands=stated)
        with pytest.raises(InputError, match="watchdog: none given"):
            commands.proven_watchdog(NAMES)
        commands, _ = opened(0.2, commands=stated)
        assert commands.proven_watchdog(NAMES) == 0.2


def test_twists_name_their_frame(opened):
    commands, _ = opened(0.1, commands="twist:base")
    assert isinstance(commands, TwistCommands)
    assert commands.frame == "base"


@pytest.mark.parametrize("address", ["eth0", "1,2", "-1", "0x1@eth0"])
def test_an_address_that_is_none_is_refused(address):
    with pytest.raises(InputError, match="DOMAIN or DOMAIN@INTERFACE"):
        network_of(address)


def test_localhost_is_this_machine_alone():
    assert network_of("7@localhost").peers == ("127.0.0.1",)
    assert network_of("7@eth0").interface == "eth0"
