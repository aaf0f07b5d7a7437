"""From one central camera model to another: exactly where that exists, else fitted with its residual."""

from omniservo.cameras.conversion.convert import Conversion, convert, standing_for, to_unified, where_it_ends
from omniservo.cameras.conversion.residual import Residual
from omniservo.cameras.conversion.unified_image import UnifiedImage, unified_image, unified_limits

__all__ = [
    "Conversion",
    "Residual",
    "UnifiedImage",
    "convert",
    "standing_for",
    "to_unified",
    "unified_image",
    "unified_limits",
    "where_it_ends",
]
