"""Where a plan comes nearest to what it must not do, or does it."""

from __future__ import annotations

from omniservo.planning.certificate.certificate import ConstraintMargin
from omniservo.planning.end_poses import violations_at_end
from omniservo.planning.plan import Plan


def worst_moment(plan: Plan) -> ConstraintMargin | None:
    """Return the constraint with the least left, and where; of a problem without a path the end pose's.

    None: nothing of the camera's own constraints speaks against the plan.
    """
    if plan.certificate is not None:
        return plan.certificate.worst
    w, violated = violations_at_end(plan.problem)
    return ConstraintMargin(violated[0][1], violated[0][0], violated[0][2], float(w)) if violated else None
