"""Three photographs and more of one scene, the pose known from a board."""

import numpy as np
import pytest
from benchmarks.many_views import real_scores
from benchmarks.real_coverage import RealSet
from scipy.stats import chi2


@pytest.mark.slow
def test_photographs_in_any_order_give_motions_within_what_is_stated(shared_data):
    data = RealSet.read("vinsfusion_calib")
    joined, scores, _ = real_scores(data, data.calibrated(), 4, np.random.default_rng(3))
    assert joined == 4
    assert max(s.rotation_deg for s in scores) < 0.3
    assert max(s.direction_deg for s in scores) < 3.0
    assert np.mean([s.square <= chi2.ppf(0.95, 5) for s in scores]) >= 0.6
    assert all(s.square < chi2.ppf(0.999, 5) for s in scores)
