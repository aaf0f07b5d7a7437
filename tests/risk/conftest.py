"""Planning problems, as the planner's own tests have them."""

from tests.planning.conftest import paper

__all__ = ["paper"]
