"""The benchmark's random sets are the published ones, and as hard as they claim."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("benchmarks.comparisons.planning", reason="benchmarks/ is not part of this copy")

from benchmarks.comparisons.planning.random_problems import KINDS
from benchmarks.comparisons.planning.sets import (
    CHECKSUMS,
    FIRST,
    SIZES,
    checksum,
    problem,
    problems,
    straight_is_good,
)

from omniservo.planning.end_poses import violation_at_end


@pytest.mark.parametrize("name", SIZES)
def test_sets_are_the_published_ones_with_good_ends_and_few_straight_solutions(name: str) -> None:
    found = problems(name, FIRST)
    assert checksum(found) == CHECKSUMS[name][0]
    assert not any(violation_at_end(one) for one in found)
    assert np.mean([straight_is_good(one) for one in found]) <= 0.2


def test_a_checksum_notices_one_number() -> None:
    one = problem("fisheye", 0)
    moved = replace(one, clearance=one.clearance + 1e-6)
    assert checksum([one]) == checksum([problem("fisheye", 0)]) != checksum([moved])


def test_a_problem_does_not_depend_on_what_was_drawn_before() -> None:
    assert checksum(problems("wall", 3)[2:]) == checksum([problem("wall", 2)])


def test_past_90_shows_the_target_behind_the_image_plane() -> None:
    for one in problems("past-90", 3):
        seen = np.concatenate([one.points, one.initial_T_goal.inv().apply(one.points)])
        assert seen[:, 2].min() < 0.0


def test_every_random_set_has_a_kind_and_no_other() -> None:
    assert set(KINDS) == set(SIZES) - {"paper"}
