"""Images to dots, tags and natural features, tracked and matched between views."""

from omniservo.perception.dot_kind import DotKind
from omniservo.perception.dot_tracker import DotTracker
from omniservo.perception.dots import DotOptions, FoundDots
from omniservo.perception.feature_kind import FeatureKind, FeatureTracker, MatchedPoints
from omniservo.perception.features import Features
from omniservo.perception.find_dots import find_dots
from omniservo.perception.find_features import find_features
from omniservo.perception.find_tags import FoundTags, find_tags
from omniservo.perception.image_points import ImagePoints
from omniservo.perception.join_images import JoinedPoints, join_images
from omniservo.perception.match_dots import DotMatch, match_dots
from omniservo.perception.match_features import FeatureMatch, match_features
from omniservo.perception.match_images import match_images
from omniservo.perception.natural_kind import NaturalKind
from omniservo.perception.patch_tracker import PatchTracker
from omniservo.perception.refine_matches import ImageMatch, refine_matches
from omniservo.perception.tag_kind import TagKind
from omniservo.perception.tag_picture import tag_cells, tag_picture, tag_picture_corners
from omniservo.perception.tag_tracker import TagTracker
from omniservo.renamed import renamed

__all__ = [
    "DotKind",
    "DotMatch",
    "DotOptions",
    "DotTracker",
    "FeatureKind",
    "FeatureMatch",
    "FeatureTracker",
    "Features",
    "FoundDots",
    "FoundTags",
    "ImageMatch",
    "ImagePoints",
    "JoinedPoints",
    "MatchedPoints",
    "NaturalKind",
    "PatchTracker",
    "TagKind",
    "TagTracker",
    "find_dots",
    "find_features",
    "find_tags",
    "join_images",
    "match_dots",
    "match_features",
    "match_images",
    "refine_matches",
    "tag_cells",
    "tag_picture",
    "tag_picture_corners",
]

__getattr__ = renamed(__name__, {"Dots": "FoundDots", "Tags": "FoundTags"})
