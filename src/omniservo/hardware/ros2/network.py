"""Where on a network ROS 2 programs are looked for: domain, interface, peers."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from threading import Lock
from typing import Any

from omniservo.errors import InputError, spelled
from omniservo.field_docs import with_field_docs

MOST_DOMAIN = 232
"""DDS has no port numbers for more."""

_PEER = re.compile(r"[A-Za-z0-9_.:%-]{1,253}")

_held: dict[int, tuple[str, Any]] = {}
"""the configured domains of this process: a domain takes a configuration once"""
_lock = Lock()


@with_field_docs
@dataclass(frozen=True)
class DdsNetwork:
    """The ROS 2 programs with which messages are exchanged.

    With neither ``interface`` nor ``peers`` Cyclone DDS is configured by its own variable CYCLONEDDS_URI, or
    finds everybody by multicast.

    Raises:
        InputError: a field that is not legal, named.
    """

    domain: int | None = None
    """ROS_DOMAIN_ID of the others; None: that variable's, else 0"""
    interface: str = ""
    """network interface by name or address; "" leaves it to Cyclone DDS"""
    peers: tuple[str, ...] = ()
    """hosts that are contacted directly; with any, nothing is sent by multicast"""

    def __post_init__(self) -> None:
        _ = self.domain_id
        for where, name in (("interface", self.interface), *(("peers", peer) for peer in self.peers)):
            if not _PEER.fullmatch(name or "any"):
                raise InputError(
                    f"{where}: {spelled(name)} given; legal: a host's or interface's name or address"
                )

    @classmethod
    def localhost(cls, domain: int | None = None) -> DdsNetwork:
        """Return this machine alone: nothing goes out, nothing comes in."""
        return cls(domain, "127.0.0.1", ("127.0.0.1",))

    @property
    def domain_id(self) -> int:
        """The domain that is meant, the variable ROS_DOMAIN_ID included."""
        where, given = (
            "domain",
            self.domain if self.domain is not None else os.environ.get("ROS_DOMAIN_ID") or 0,
        )
        if self.domain is None:
            where = "ROS_DOMAIN_ID"
        try:
            number = int(given)
        except (TypeError, ValueError):
            number = -1
        if not 0 <= number <= MOST_DOMAIN:
            raise InputError(f"{where}: {spelled(given)} given; legal: 0 to {MOST_DOMAIN}")
        return number

    def __str__(self) -> str:
        where = f"domain {self.domain_id}"
        return f"{where} on {self.interface}" if self.interface else where

    def configure(self) -> None:
        """Give the domain its configuration, once in this process; the domain keeps it till the process ends.

        Raises:
            InputError: this process uses the domain with another configuration already, or Cyclone DDS
                takes none of it.
        """
        if not (self.interface or self.peers):
            return
        with _lock:
            held = _held.get(self.domain_id)
            if held is None:
                _held[self.domain_id] = self._text, _domain(self.domain_id, self._text, str(self))
            elif held[0] != self._text:
                raise InputError(
                    f"{self}: this program uses this domain with another interface or other peers already"
                )

    @property
    def _text(self) -> str:
        """What Cyclone DDS is given, as its XML."""
        kind = "address" if re.fullmatch(r"[0-9.]+", self.interface) or ":" in self.interface else "name"
        inner = "<MaxMessageSize>65500B</MaxMessageSize>"
        if self.interface:
            inner += f'<Interfaces><NetworkInterface {kind}="{self.interface}"/></Interfaces>'
        found = (
            "<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>60</MaxAutoParticipantIndex>"
        )
        if self.peers:
            inner += "<AllowMulticast>false</AllowMulticast>"
            found += "<Peers>" + "".join(f'<Peer Address="{peer}"/>' for peer in self.peers) + "</Peers>"
        return (
            f'<CycloneDDS><Domain Id="any"><General>{inner}</General><Discovery>{found}</Discovery>'
            "</Domain></CycloneDDS>"
        )


def _domain(number: int, text: str, where: str) -> Any:
    from cyclonedds.core import DDSException
    from cyclonedds.domain import Domain

    try:
        return Domain(number, text)
    except DDSException as error:
        raise InputError(f"{where}: Cyclone DDS does not take this network: {error}") from None
