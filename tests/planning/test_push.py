"""Many rows added at once are the same normal equation as one by one."""

import numpy as np
from scipy.spatial.transform import Rotation

from omniservo.planning.constraints.push import push_centre, push_centre_often


def test_rows_added_at_once_are_rows_added_one_by_one():
    rng = np.random.default_rng(4)
    poses = np.zeros((2, 14))
    poses[1, :9] = Rotation.random(rng=rng).as_matrix().ravel()
    rows, residuals = rng.normal(size=(7, 3)), rng.uniform(0.1, 1.0, 7)
    single, costs = np.zeros((2, 6, 7)), np.zeros(2)
    for (x, y, z), r in zip(rows, residuals, strict=True):
        push_centre(single, costs, 1, poses, x, y, z, r)
    square, side = rows.T @ rows, rows.T @ residuals
    together, cost = np.zeros((2, 6, 7)), np.zeros(2)
    upper = tuple(float(v) for v in square[np.triu_indices(3)])
    push_centre_often(
        together, cost, 1, poses, upper, tuple(map(float, side)), 0.5 * float(residuals @ residuals)
    )
    assert np.allclose(together, single, rtol=1e-12, atol=1e-12)
    assert np.allclose(cost, costs, rtol=1e-12)
    assert not together[0].any()
