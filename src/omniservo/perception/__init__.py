"""Images to dots; dots tracked and matched between views."""

from omniservo.perception.dot_tracker import DotTracker
from omniservo.perception.dots import DotOptions, Dots
from omniservo.perception.find_dots import find_dots
from omniservo.perception.match_dots import DotMatch, match_dots

__all__ = ["DotMatch", "DotOptions", "DotTracker", "Dots", "find_dots", "match_dots"]
