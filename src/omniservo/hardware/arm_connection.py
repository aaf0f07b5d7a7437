"""The connection to a real arm: an `ArmDriver` on this machine's clock, whose joints are known by name."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from omniservo.robots import ArmDriver


@runtime_checkable
class ArmConnection(ArmDriver, Protocol):
    """An arm behind a line.

    `RobotState.time` is `time.monotonic()` of this machine. `read` returns the newest state, whatever its
    age, and raises `ConnectionLost` once the connection is known to be gone; so do `command` and `stop`. Its
    constructor opens it: it returns once a first state is there, or raises `InputError` or `ConnectionLost`
    with the address and what was heard instead. `close` joins what threads it has.
    """

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The order of the joints in all arrays, matched with the arm's by name."""
        ...

    @property
    def watchdog(self) -> float | None:
        """The arm itself begins to brake so long after the last command [s]; None: it never does."""
        ...
