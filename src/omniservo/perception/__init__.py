"""Images to dots; dots tracked and matched between views."""

from omniservo.perception.dots import DotOptions, Dots
from omniservo.perception.find_dots import find_dots

__all__ = ["DotOptions", "Dots", "find_dots"]
