"""Joint paths made up without an arm."""

import numpy as np

from omniservo.robots import JointPath


def straight_joint_path(first, last, knots=9):
    """From rest to rest in a straight line of joints: q = first + (3w² − 2w³)(last − first)."""
    w, way = np.linspace(0.0, 1.0, knots), np.asarray(last) - np.asarray(first)
    shape = (3 * w**2 - 2 * w**3, 6 * w - 6 * w**2, 6 - 12 * w)
    q, slope, bend = (np.outer(values, way) for values in shape)
    return JointPath(w, first + q, slope, bend, np.ones(knots), np.ones((knots, len(way))), (), 1.0)
