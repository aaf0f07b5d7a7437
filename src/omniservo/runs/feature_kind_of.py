"""Which kind of feature is looked for."""

from __future__ import annotations

from typing import Literal

from omniservo.errors import InputError
from omniservo.perception import DotKind, FeatureKind, NaturalKind, TagKind
from omniservo.perception.feature_kind import LEAST_FEATURES
from omniservo.targets import Target
from omniservo.tasks import Task

KindName = Literal["dots", "tags", "natural"]

LEAST_CORNERS = 4
"""One tag is enough where its size is known."""


_OTHER_FEATURES = "; of a photograph without dots: natural (--features natural), or tags (--features tags)"
_OTHER_TARGETS = "; if the target has none, state target.tags or target.textures in the task"


def feature_kind_of(task: Task) -> FeatureKind:
    """Return the kind of feature that a task's target shows."""
    if task.target.tags is not None:
        return TagKind(task.target.tags.dictionary, LEAST_CORNERS if task.scale.tags else LEAST_FEATURES)
    return NaturalKind() if task.target.textures else DotKind(_OTHER_TARGETS)


def feature_kind(name: KindName, dictionary: str | None, target: Target | None) -> FeatureKind:
    """Return the kind called ``name``; of tags also the dictionary, given or the known target's only one.

    Raises:
        InputError: tags without a dictionary, or a target whose tags are not those.
    """
    if name != "tags":
        if target is not None:
            raise InputError(f"target: it holds tags; features: {name!r} given, 'tags' is needed")
        return NaturalKind() if name == "natural" else DotKind(_OTHER_FEATURES)
    if target is not None:
        target.tag_corners(dictionary)
        dictionary = dictionary or target.dictionaries[0]
    if dictionary is None:
        raise InputError(
            "dictionary: missing; tags need one, as --dictionary tag36h11, or a target file (--target)"
        )
    return TagKind(dictionary, LEAST_FEATURES if target is None else LEAST_CORNERS)
