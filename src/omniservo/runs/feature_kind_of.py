"""Which kind of feature a task's target shows."""

from __future__ import annotations

from omniservo.perception import DotKind, FeatureKind
from omniservo.tasks import Task


def feature_kind_of(task: Task) -> FeatureKind:
    """Return the kind of feature that is looked for in this task's pictures."""
    del task
    return DotKind()
