"""The benchmark of replanning measures what it says."""

import pytest
from benchmarks.replanning_speed import CHANGES, of_set, row


@pytest.mark.parametrize("change", CHANGES)
def test_one_change_is_made_and_planned_again(change):
    results = list(of_set("fisheye", change, 2))
    found = [r for r in results if r is not None]
    assert found
    assert all(r.found for r in found)
    assert all(0.0 < r.kernel < r.public for r in found)
    assert all(r.in_the_way for r in found) or change != "goal 10 mm"
    assert row("fisheye", change, results).split()[0] == "fisheye"
