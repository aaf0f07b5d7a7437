"""The numeric inverse where no closed form helps."""

import numpy as np

from omniservo.robots.numeric_inverse import descend


def test_a_descent_that_few_joints_can_still_move_ends_without_an_error():
    """One joint is left for six equal errors, and every step halves them: many steps, ever less damping."""

    def miss(q):
        off = 0.9 - q[0]
        error, jacobian = np.full(6, off), np.zeros((6, 6))
        jacobian[:, 0] = 2.0
        return error, jacobian

    found = descend(miss, np.zeros(6), np.tile([-1.0, 1.0], (6, 1)))
    assert found is None or abs(found[0] - 0.9) < 1e-2
