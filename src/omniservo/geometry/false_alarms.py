"""How often chance gathers as many: the expected number of false alarms of a model that was found in data."""

from __future__ import annotations

import math

from scipy.special import gammaln


def false_alarms(n: int, k: int, sampled: int, share: float, models: float) -> float:
    """Return how many models agree with k of n data by chance, to be expected where all are wrong.

    ``models`` · C(n, k) C(k, s) p^(k − s): a model is made of ``sampled`` s data, ``share`` p of the others
    agree with it by chance. At most e⁵⁰. (Moisan and Stival, IJCV 57(3), 2004.)
    """
    if k < sampled:
        return 0.0
    by_chance = (k - sampled) * math.log(min(max(share, 1e-300), 1.0))
    return math.exp(min(math.log(models) + _log_choose(n, k) + _log_choose(k, sampled) + by_chance, 50.0))


def _log_choose(n: int, k: int) -> float:
    return float(gammaln(n + 1) - gammaln(k + 1) - gammaln(n - k + 1))
