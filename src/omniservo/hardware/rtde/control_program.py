"""The program that a Universal Robots controller runs for us: joint speeds out of RTDE's registers."""

from __future__ import annotations

import re
import socket
import time

from omniservo.errors import InputError

NUMBER, VELOCITIES = "input_int_register_24", tuple(f"input_double_register_{k}" for k in range(24, 30))
"""what is written: the command's number (0: stand, −1: end the program), and the joints' speeds [rad/s]"""

ECHO, BEAT = "output_int_register_24", "output_int_register_25"
"""what is read: the number that the program acts on, and its steps so far"""

_PROGRAM = """\
def omniservo():
  old = read_input_integer_register(24)
  n = old
  watched = False
  beat = 0
  while n >= 0 or n == old:
    if n != old:
      old = -2
    end
    qd = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    if n > 0 and old == -2:
      qd[0] = read_input_float_register(24)
      qd[1] = read_input_float_register(25)
      qd[2] = read_input_float_register(26)
      qd[3] = read_input_float_register(27)
      qd[4] = read_input_float_register(28)
      qd[5] = read_input_float_register(29)
      if not watched:
        rtde_set_watchdog("input_int_register_24", {frequency:.3f}, "stop")
        watched = True
      end
    elif watched:
      rtde_set_watchdog("input_int_register_24", {frequency:.3f}, "ignore")
      watched = False
    end
    beat = beat + 1
    write_output_integer_register(24, n)
    write_output_integer_register(25, beat)
    speedj(qd, {acceleration:.3f}, get_steptime())
    n = read_input_integer_register(24)
  end
end
"""


def control_program(watchdog: float, acceleration: float) -> str:
    """Return the URScript that moves the arm as the registers say.

    A number that the register had before the program began moves and ends nothing. Once a command came, the
    controller stops the program, and with it the arm, when the register is not written for ``watchdog``.

    Args:
        watchdog: the longest silence [s].
        acceleration: of the leading joint [rad/s²].
    """
    return _PROGRAM.format(frequency=1.0 / watchdog, acceleration=acceleration)


def limits_of_program(text: str) -> tuple[float, float] | None:
    """Return watchdog [s] and acceleration [rad/s²] of a text that `control_program` made, else None."""
    found = re.search(r'_register_24", ([\d.]+), "stop".*speedj\(qd, ([\d.]+), ', text, re.DOTALL)
    if found is None or float(found[1]) == 0.0:
        return None
    watchdog, acceleration = 1.0 / float(found[1]), float(found[2])
    is_ours = text.strip() == control_program(watchdog, acceleration).strip()
    return (watchdog, acceleration) if is_ours else None


class ProgramSender:
    """Sends a program to the controller's secondary interface, whose connection stays open until `close`.

    Raises:
        InputError: no one is there.
    """

    def __init__(self, host: str, port: int, program: str, patience: float) -> None:
        try:
            self._socket = socket.create_connection((host, port), timeout=patience)
            self._socket.sendall(program.encode())
        except OSError as error:
            raise InputError(f"{host}:{port}: the program cannot be sent: {error}") from None

    def close(self) -> None:
        """Close the connection; the program goes on."""
        self._socket.close()


def remote_control(host: str, port: int, patience: float = 1.0) -> bool | None:
    """Return whether the pendant lets other computers send programs, as the dashboard server says.

    None: there is no dashboard server (PolyScope X), or it does not know (software before 5.6).
    """
    end = time.monotonic() + patience
    try:
        with socket.create_connection((host, port), timeout=patience) as line:
            line.sendall(b"is in remote control\n")
            heard = b""
            while time.monotonic() < end and len(heard) < 4096:
                line.settimeout(max(end - time.monotonic(), 1e-3))
                part = line.recv(1024)
                heard += part
                answers = re.findall(rb"(?m)^(true|false)\r?\n", heard)
                if answers or not part:
                    return answers[0] == b"true" if answers else None
    except OSError:
        pass
    return None
