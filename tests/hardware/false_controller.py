"""A controller that answers RTDE as a test says: right, where the test says nothing."""

import struct

from omniservo.hardware.listener import Listener
from omniservo.hardware.rtde.packets import PacketBuffer, PacketError, PacketKind, Recipe, packet
from omniservo.hardware.rtde.rtde_arm import OUTPUTS
from omniservo.hardware.rtde.variables import input_type, output_type

STATE = {
    "timestamp": [100.0],
    "actual_q": [0.0] * 6,
    "actual_qd": [0.0] * 6,
    "robot_mode": [7],
    "safety_mode": [1],
    "safety_status_bits": [1],
    "runtime_state": [1],
    "target_speed_fraction": [1.0],
    "output_int_register_24": [0],
    "output_int_register_25": [0],
}


def data(**changes):
    """Return a packet with a state."""
    recipe = Recipe(1, [output_type(name) for name in OUTPUTS])
    state = STATE | {name: value if isinstance(value, list) else [value] for name, value in changes.items()}
    return packet(PacketKind.DATA, recipe.pack([number for name in OUTPUTS for number in state[name]]))


class FalseController:
    """Answers each kind of packet with the bytes of ``answers``, and with what is right for the others."""

    def __init__(self, answers=None, greeting=b""):
        self.answers, self.greeting, self.lines, self.inputs = answers or {}, greeting, [], []
        self.listener = Listener("127.0.0.1", 0, self.serve)
        self.address = f"127.0.0.1:{self.listener.port}"

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.listener.close()

    def say(self, stream):
        """Send bytes to everybody."""
        for line in self.lines:
            line.sendall(stream)

    def serve(self, line):
        self.lines.append(line)
        line.sendall(self.greeting)
        buffer = PacketBuffer()
        try:
            while part := line.recv(4096):
                for kind, body in buffer.feed(part):
                    if kind == PacketKind.DATA:
                        self.inputs.append(body)
                    line.sendall(self.answers.get(kind, self.right(kind, body)))
        except PacketError:
            pass

    def right(self, kind, body):
        if kind == PacketKind.VERSION:
            return packet(kind, b"\1")
        if kind == PacketKind.CONTROLLER:
            return packet(kind, struct.pack(">4I", 5, 12, 0, 0))
        if kind == PacketKind.OUTPUTS:
            types = ",".join(output_type(name) for name in body[8:].decode().split(","))
            return packet(kind, b"\1" + types.encode())
        if kind == PacketKind.INPUTS:
            types = ",".join(input_type(name) for name in body.decode().split(","))
            return packet(kind, b"\1" + types.encode())
        if kind == PacketKind.START:
            return packet(kind, b"\1") + data()
        return b""
