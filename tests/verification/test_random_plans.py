"""Random plans against 20 001 samples: nothing false is accepted, nearly everything true is."""

from collections import Counter

import numpy as np
import pytest
from sampled_plans import plan, random_case, slack, true_margins

from omniservo.verification import verify_plan


@pytest.mark.parametrize("seed", range(4))
def test_random_plans_are_judged_as_dense_sampling_judges_them(seed):
    rng = np.random.default_rng(seed)
    seen = Counter()
    for _ in range(40):
        asked, way = random_case(rng)
        truth = true_margins(asked, way)
        lowest = min(m for m, _, _ in truth.values())
        # Claimed: 0 of a constraint that is violated, of the others a little less than the truth.
        margins = {name: m - slack(m) if m > 2 * slack(m) else 0.0 for name, (m, _, _) in truth.items()}
        status = verify_plan(plan(asked, way, margins)).status
        if lowest < 0:
            assert status == "refuted"
            seen["false"] += 1
        elif lowest > 1e-6:
            seen["true"] += 1
            seen["certified"] += status == "certified"
            name = rng.choice(list(truth))
            margin = truth[name][0]
            overstated = {**margins, name: margin + 1e-9 * margin}
            assert verify_plan(plan(asked, way, overstated)).status == "refuted"
    assert seen["certified"] >= 0.99 * seen["true"]
    assert min(seen["true"], seen["false"]) >= 10
