"""Targets whose geometry is known: named points and tags, and their files."""

from omniservo.targets.tag import Tag
from omniservo.targets.target import Target

__all__ = ["Tag", "Target"]
