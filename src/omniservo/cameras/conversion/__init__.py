"""From one central camera model to another: exactly where that exists, else fitted with its residual."""

from omniservo.cameras.conversion.convert import Conversion, convert, standing_for, to_unified, where_it_ends
from omniservo.cameras.conversion.residual import Residual

__all__ = ["Conversion", "Residual", "convert", "standing_for", "to_unified", "where_it_ends"]
