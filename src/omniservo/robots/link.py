"""What an arm's link is made of."""

from __future__ import annotations

from dataclasses import dataclass

from omniservo.field_docs import with_field_docs


@with_field_docs
@dataclass(frozen=True)
class Shape:
    """One body of a link."""

    kind: str
    """box, sphere, capsule, cylinder, ellipsoid or mesh"""
    extents: tuple[float, float, float]
    """of its bounding box along its own axes [m]"""


@with_field_docs
@dataclass(frozen=True)
class Link:
    """A rigid part of the arm, possibly without any body: a frame."""

    name: str
    joint: str
    """what carries it; empty for the base and for what is fixed to another link"""
    shapes: tuple[Shape, ...]
    """those that can be touched"""
