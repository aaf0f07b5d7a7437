"""The compiled peer is the paper's search: same G, same path as in NumPy."""

from dataclasses import replace

import numpy as np
import pytest

from omniservo.planning import Degrees
from omniservo.planning.paper_search import paper_path

pytest.importorskip("benchmarks.comparisons.planning", reason="benchmarks/ is not part of this copy")

from benchmarks.comparisons.planning.neutral import neutral_of
from benchmarks.comparisons.planning.peers.paper_compiled import sampled_value, solve
from benchmarks.comparisons.planning.sets import problem

CASES = [("paper", 0), ("paper", 2), ("fisheye", 2), ("perspective", 4), ("catadioptric", 3), ("past-90", 5)]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "index"), CASES)
def test_it_finds_the_path_that_numpy_finds(name: str, index: int) -> None:
    one = problem(name, index)
    attempt = solve(one, neutral_of(one), 1.0)
    path, _ = paper_path(replace(one, degrees=Degrees(2, 2)))
    np.testing.assert_allclose(attempt.path.rotation, path.rotation, atol=1e-9)
    np.testing.assert_allclose(attempt.path.translation, path.translation, atol=1e-9)
    assert attempt.claimed == (sampled_value(one, path) > 0.0)


@pytest.mark.slow
def test_it_stops_where_g_is_positive_and_claims_no_more() -> None:
    claims = {solve(one, neutral_of(one), 1.0).claimed for one in (problem("fisheye", 0), problem("wall", 0))}
    assert claims == {True, False}
