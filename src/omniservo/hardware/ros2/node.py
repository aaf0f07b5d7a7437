"""One participant of a DDS domain: topics in and out, by Cyclone DDS."""

from __future__ import annotations

import types
from collections.abc import Callable
from functools import cache
from typing import Any, Generic, TypeVar

from omniservo.errors import ConnectionLost, InputError
from omniservo.hardware.ros2.endpoints import Endpoint, Endpoints
from omniservo.hardware.ros2.network import DdsNetwork
from omniservo.ros_messages.cdr import decode, encode
from omniservo.ros_messages.messages import Numbers, RosMessage, Scalar

M = TypeVar("M", bound=RosMessage)

_BLOCKING = 100_000_000
"""Longest that a reliable writer waits for a slow reader [ns]."""

_TAKEN = 64


class RosNode:
    """A participant that publishes and subscribes to ROS 2 topics.

    Args:
        network: where the others are.

    Raises:
        InputError: Cyclone DDS is not installed, or the network is not legal.
        ConnectionLost: there is no such network interface.
    """

    def __init__(self, network: DdsNetwork) -> None:
        try:
            from cyclonedds.core import DDSException, Policy, Qos
            from cyclonedds.domain import DomainParticipant
        except ImportError as error:
            raise InputError(f"ROS 2: {error}; pip install omniservo[ros2]") from None
        network.configure()
        self.network = network
        try:
            self._participant = DomainParticipant(network.domain_id, Qos(Policy.Userdata(b"enclave=/;")))
        except DDSException as error:
            raise ConnectionLost(f"{network}: no DDS on this network: {error}") from None
        self._entities: list[Any] = [self._participant]
        self.endpoints = Endpoints(self._participant)
        self._entities.append(self.endpoints)

    def publish(self, topic: str, kind: type[M], *, reliable: bool = True, depth: int = 1) -> Publisher[M]:
        """Return what writes messages of a kind to a topic ("/joint_states").

        Raises:
            InputError: the topic's name is not legal.
        """
        from cyclonedds.pub import DataWriter

        made = self._topic(topic, kind)
        writer = DataWriter(self._participant, made, qos=_qos(kind, reliable=reliable, depth=depth))
        self._entities += [made, writer]
        return Publisher(writer, kind, topic)

    def subscribe(
        self, topic: str, kind: type[M], *, reliable: bool = False, transient: bool = False, depth: int = 16
    ) -> Subscription[M]:
        """Return what takes messages of a kind from a topic.

        Args:
            topic: "/joint_states".
            kind: of the messages.
            reliable: whether lost messages are sent again; a publisher of best effort does not match then.
            transient: whether messages of before are sent; a volatile publisher does not match then.
            depth: messages that wait to be taken; older ones are dropped.

        Raises:
            InputError: the topic's name is not legal.
        """
        from cyclonedds.core import InstanceState, ReadCondition, SampleState, ViewState, WaitSet
        from cyclonedds.sub import DataReader

        made = self._topic(topic, kind)
        qos = _qos(kind, reliable=reliable, transient=transient, depth=depth)
        reader = DataReader(self._participant, made, qos=qos)
        anything = ReadCondition(reader, SampleState.Any | ViewState.Any | InstanceState.Any)
        waiting = WaitSet(self._participant)
        waiting.attach(anything)
        self._entities += [made, reader, anything, waiting]
        return Subscription(reader, waiting, kind, topic)

    def close(self) -> None:
        """Leave the domain; a second call does nothing. No thread may wait for a message any more."""
        while self._entities:
            # Cyclone's Python deletes an entity with its last reference, which a traceback may hold.
            self._entities.pop().__del__()

    def _topic(self, topic: str, kind: type[RosMessage]) -> Any:
        from cyclonedds.topic import Topic

        return Topic(self._participant, dds_topic(topic), _idl(kind))


class Publisher(Generic[M]):
    """Writes messages to one topic."""

    def __init__(self, writer: Any, kind: type[M], topic: str) -> None:
        self._writer, self._carrier, self.topic = writer, _idl(kind), topic
        self.key: str = str(writer.get_guid())
        """this publisher, as others see it"""

    def write(self, message: M) -> None:
        """Send a message.

        Raises:
            InputError: a value does not fit its field.
            ConnectionLost: Cyclone DDS does not take it.
        """
        from cyclonedds.core import DDSException

        carrier = self._carrier.__new__(self._carrier)
        carrier.message = message
        try:
            self._writer.write(carrier)
        except DDSException as error:
            raise ConnectionLost(f"{self.topic}: a message was not sent: {error}") from None

    @property
    def matched(self) -> int:
        """How many subscribers it has."""
        return len(self._writer.get_matched_subscriptions())

    def acknowledged(self, patience: float) -> bool:
        """Say whether within ``patience`` [s] all reliable subscribers have all that was written."""
        try:
            return bool(self._writer.wait_for_acks(round(patience * 1e9)))
        except AttributeError:  # how Cyclone's Python 11.0.1 says that time is up
            return False


class Subscription(Generic[M]):
    """Takes messages from one topic."""

    def __init__(self, reader: Any, waiting: Any, kind: type[M], topic: str) -> None:
        self._reader, self._waiting, self._kind, self.topic = reader, waiting, kind, topic
        self.key: str = str(reader.get_guid())
        """this subscriber, as others see it"""
        self.refused = 0
        """messages that could not be read"""
        self.refusal = ""
        """why the last one could not"""

    def wait(self, patience: float) -> None:
        """Return when there is something to take, or after ``patience`` [s]."""
        self._waiting.wait(round(patience * 1e9))

    def take(self) -> list[M]:
        """Return the messages that came since, the oldest first; those that cannot be read are counted."""
        taken: list[M] = []
        for sample in self._reader.take(N=_TAKEN):
            message = getattr(sample, "message", None)
            if isinstance(message, self._kind):
                taken.append(message)
            elif isinstance(message, InputError):
                self.refused, self.refusal = self.refused + 1, str(message)
        return taken

    @property
    def matched(self) -> int:
        """How many publishers it has."""
        return len(self._reader.get_matched_publications())


def dds_topic(topic: str) -> str:
    """Return a ROS topic's name as DDS has it.

    Raises:
        InputError: not a full name, "/camera/image_raw".
    """
    parts = topic.split("/") if isinstance(topic, str) else []
    if len(parts) < 2 or parts[0] or not all(p.isidentifier() and p.isascii() for p in parts[1:]):
        raise InputError(f"topic: {topic!r} given; legal: a full name such as '/camera/image_raw'")
    return "rt" + topic


def dds_type(ros_type: str) -> str:
    """Return a ROS type's name as DDS has it."""
    package, middle, name = ros_type.split("/")
    return f"{package}::{middle}::dds_::{name}_"


def _qos(kind: type[RosMessage], *, reliable: bool, depth: int, transient: bool = False) -> Any:
    from cyclonedds.core import Policy, Qos

    return Qos(
        Policy.Reliability.Reliable(_BLOCKING) if reliable else Policy.Reliability.BestEffort,
        Policy.Durability.TransientLocal if transient else Policy.Durability.Volatile,
        Policy.History.KeepLast(depth),
        Policy.Userdata(f"typehash={kind.type_hash};".encode()),
    )


def _idl(kind: Any) -> Any:
    return _idl_of(kind)


@cache
def _idl_of(kind: Any) -> Any:
    """Return the class that tells Cyclone DDS a message's type, and carries one whose bytes are ours."""
    from dataclasses import dataclass

    from cyclonedds.idl import IdlStruct

    def fill(space: dict[str, Any]) -> None:
        space["__annotations__"] = {name: _idl_field(of, many) for name, of, many in kind.wire_fields()}
        space["serialize"] = _serialize
        space["deserialize"] = classmethod(_deserializer(kind))
        space["__module__"] = __name__

    made = types.new_class(kind.__name__, (IdlStruct,), {"typename": dds_type(kind.ros_type)}, fill)
    return dataclass(made)


def _serialize(carrier: Any, buffer: Any = None, endianness: Any = None, use_version_2: Any = None) -> bytes:
    return encode(carrier.message)


def _deserializer(kind: type[RosMessage]) -> Callable[..., Any]:
    def deserialize(cls: Any, data: bytes, has_header: bool = True, use_version_2: Any = None) -> Any:
        carrier = cls.__new__(cls)
        try:
            carrier.message = decode(kind, data)
        except InputError as error:  # one message that cannot be read must not cost those beside it
            carrier.message = error
        return carrier

    return deserialize


def _idl_field(kind: Any, many: bool) -> Any:
    from cyclonedds.idl import types as idl

    plain = {"i": idl.int32, "I": idl.uint32, "B": idl.uint8, "?": bool, "d": idl.float64}
    if isinstance(kind, Scalar):
        return plain[kind.code]
    if isinstance(kind, Numbers):
        of = idl.uint8 if kind.dtype == "u1" else idl.float64
        return idl.sequence[of] if kind.count is None else idl.array[of, kind.count]
    inner = str if kind is str else _idl(kind)
    return idl.sequence[inner] if many else inner


__all__ = ["Endpoint", "Publisher", "RosNode", "Subscription", "dds_topic", "dds_type"]
