"""Who publishes and subscribes to what in a DDS domain, and why two do not find together."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from omniservo.field_docs import with_field_docs

FOREVER = 2**63 - 1
"""A duration without an end [ns], as DDS has it."""


@with_field_docs
@dataclass(frozen=True)
class Endpoint:
    """A publisher or a subscriber."""

    key: str
    """who it is"""
    topic: str
    """as ROS has it: "/joint_states\""""
    ros_type: str
    """ "sensor_msgs/msg/JointState\""""
    reliable: bool
    """whether it sends lost messages again, or wants them"""
    transient: bool
    """whether it keeps messages for who comes later, or wants them"""
    deadline: int
    """it promises, or wants, a message at least so often [ns]"""
    type_hash: str
    """RIHS01_…; empty before ROS 2 Iron"""

    @property
    def qos(self) -> str:
        """Its quality of service in words."""
        words = [
            "reliable" if self.reliable else "best effort",
            "transient local" if self.transient else "volatile",
        ]
        if self.deadline < FOREVER:
            words.append(f"deadline {self.deadline * 1e-9:g} s")
        return ", ".join(words)


class Endpoints:
    """All endpoints of a participant's domain, its own among them. For one thread at a time."""

    def __init__(self, participant: Any) -> None:
        from cyclonedds.builtin import (
            BuiltinDataReader,
            BuiltinTopicDcpsPublication,
            BuiltinTopicDcpsSubscription,
        )

        self._readers = (
            BuiltinDataReader(participant, BuiltinTopicDcpsPublication),
            BuiltinDataReader(participant, BuiltinTopicDcpsSubscription),
        )
        self._known: tuple[dict[str, Endpoint], dict[str, Endpoint]] = ({}, {})

    def __del__(self) -> None:
        for reader in self._readers:
            reader.__del__()

    def publishers(self, topic: str | None = None) -> list[Endpoint]:
        """Return who publishes to a topic, or to any."""
        return self._of(0, topic)

    def subscribers(self, topic: str | None = None) -> list[Endpoint]:
        """Return who subscribes to a topic, or to any."""
        return self._of(1, topic)

    def _of(self, side: int, topic: str | None) -> list[Endpoint]:
        from cyclonedds.core import InstanceState

        known = self._known[side]
        while samples := self._readers[side].take(N=100):
            for sample in samples:
                # Who came and went between two looks is one sample: its data, and that it is gone.
                state = sample.sample_info
                if state.valid_data and state.instance_state == InstanceState.Alive:
                    known[str(sample.key)] = _endpoint(sample)
                else:
                    known.pop(str(sample.key), None)
        return [each for each in known.values() if topic in (None, each.topic)]


def why_apart(
    topic: str,
    ros_type: str,
    wanted: Endpoint | None,
    found: list[Endpoint],
    all_found: list[Endpoint],
    role: str,
) -> str:
    """Return in words why there is no message, or why no command is heard, on a topic.

    Args:
        topic: the topic.
        ros_type: the type that was wanted.
        wanted: our own endpoint.
        found: the others' endpoints on the topic.
        all_found: theirs on all topics.
        role: what they would do: "publishes" or "subscribes to".
    """
    if not found:
        names = sorted({each.topic for each in all_found if each.ros_type == ros_type})
        rest = (
            f"; topics of {ros_type}: {', '.join(names[:8])}"
            if names
            else "; nobody has a topic of this type"
        )
        return f"nobody {role} {topic}{rest}"
    types = sorted({each.ros_type for each in found})
    if ros_type not in types:
        return f"{topic} is of {' and '.join(types)}, and not of {ros_type}"
    reasons = {
        reason for each in found if each.ros_type == ros_type and (reason := _mismatch(each, wanted, role))
    }
    return f"{topic}: {'; '.join(sorted(reasons))}" if reasons else ""


def _mismatch(their: Endpoint, own: Endpoint | None, role: str) -> str:
    """Return what keeps two apart: another definition of the type, or a quality of service not offered."""
    if own is None:
        return ""
    if their.type_hash and own.type_hash and their.type_hash != own.type_hash:
        theirs, ours = (each.type_hash[:15] for each in (their, own))
        return f"{own.ros_type} is defined otherwise there: {theirs}…, here {ours}…"
    offers, wants = (their, own) if role == "publishes" else (own, their)
    missing = [
        *(["reliable"] if wants.reliable and not offers.reliable else []),
        *(["transient local"] if wants.transient and not offers.transient else []),
        *([f"a deadline of {wants.deadline * 1e-9:g} s"] if wants.deadline < offers.deadline else []),
    ]
    if not missing:
        return ""
    who = "this program requests" if wants is own else "the subscriber requests"
    whose = "this program offers" if offers is own else "the publisher offers"
    return f"incompatible QoS: {who} {' and '.join(missing)}, {whose} {offers.qos}"


def _endpoint(sample: Any) -> Endpoint:
    from cyclonedds.core import Policy

    qos = sample.qos
    reliability, durability = qos[Policy.Reliability], qos[Policy.Durability]
    deadline, data = qos[Policy.Deadline], qos[Policy.Userdata]
    found = re.search(rb"typehash=(RIHS01_[0-9a-f]{64});", data.data) if data is not None else None
    return Endpoint(
        key=str(sample.key),
        topic=sample.topic_name[2:] if sample.topic_name.startswith("rt/") else sample.topic_name,
        ros_type=re.sub(r"^(\w+)::(\w+)::dds_::(\w+)_$", r"\1/\2/\3", sample.type_name),
        reliable=reliability is not None and reliability != Policy.Reliability.BestEffort,
        transient=durability not in (None, Policy.Durability.Volatile),
        deadline=deadline.deadline if deadline is not None else FOREVER,
        type_hash=found[1].decode() if found else "",
    )
