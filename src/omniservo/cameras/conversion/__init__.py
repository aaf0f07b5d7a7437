"""From one central camera model to another: exactly where that exists, else fitted with its residual."""

from omniservo.cameras.conversion.convert import Conversion, convert, to_unified
from omniservo.cameras.conversion.residual import Residual

__all__ = ["Conversion", "Residual", "convert", "to_unified"]
