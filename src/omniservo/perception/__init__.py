"""Images to dots and tags, tracked and matched between views."""

from omniservo.perception.dot_kind import DotKind
from omniservo.perception.dot_tracker import DotTracker
from omniservo.perception.dots import DotOptions, Dots
from omniservo.perception.feature_kind import FeatureKind, FeatureTracker, MatchedPoints
from omniservo.perception.find_dots import find_dots
from omniservo.perception.image_points import ImagePoints
from omniservo.perception.match_dots import DotMatch, match_dots
from omniservo.perception.tag_picture import tag_cells, tag_picture, tag_picture_corners

__all__ = [
    "DotKind",
    "DotMatch",
    "DotOptions",
    "DotTracker",
    "Dots",
    "FeatureKind",
    "FeatureTracker",
    "ImagePoints",
    "MatchedPoints",
    "find_dots",
    "match_dots",
    "tag_cells",
    "tag_picture",
    "tag_picture_corners",
]
