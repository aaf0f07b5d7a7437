"""What passes a public boundary as an array of numbers, and what does not."""

import numpy as np
import pytest

from omniservo.errors import InputError
from omniservo.geometry.arrays import finite_array


def test_masked_entries_are_no_numbers():
    """Whoever masks a point does not want it used; an array without a masked entry is one like others."""
    points = np.ma.masked_invalid([[0.0, 1.0, 2.0], [np.nan, 1.0, 2.0]])
    with pytest.raises(InputError, match="points: 1 masked entries given; every number is needed"):
        finite_array("points", points, (None, 3))
    whole = finite_array("points", points[:1], (None, 3))
    assert type(whole) is np.ndarray
    assert whole.tolist() == [[0.0, 1.0, 2.0]]


@pytest.mark.parametrize("given", [[True, 0.0], [[1.0], [1.0, 2.0]], ["1", "2"], [1 + 2j, 0.0], [None, 1.0]])
def test_what_numpy_would_turn_into_other_numbers_is_refused(given):
    with pytest.raises(InputError, match="an array of numbers is needed"):
        finite_array("it", given, (None,))
