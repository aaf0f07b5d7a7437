"""Planning problems, as the planner's own tests have them."""

from tests.planning.conftest import look, paper, random_problems

__all__ = ["look", "paper", "random_problems"]
