"""How far a place is from a line of straight pieces, against places taken densely along it."""

import numpy as np
import pytest

from omniservo.geometry.polyline import offsets_from_line


@pytest.mark.parametrize("dimension", [3, 6])
def test_the_shortest_offset_is_that_of_the_nearest_of_many_places_on_the_line(dimension):
    rng = np.random.default_rng(dimension)
    for _ in range(20):
        line, place = rng.normal(size=(5, dimension)), 2.0 * rng.normal(size=dimension)
        share = np.linspace(0.0, 1.0, 2001)[:, None, None]
        dense = line[:-1] + share * np.diff(line, axis=0)
        least = np.linalg.norm(place - dense, axis=-1).min()
        found = np.linalg.norm(offsets_from_line(line, place), axis=1).min()
        assert least - 1e-4 < found <= least + 1e-12


def test_a_piece_of_no_length_is_a_place():
    line = np.array([[1.0, 0.0], [1.0, 0.0], [3.0, 0.0]])
    assert offsets_from_line(line, np.array([0.0, 0.0])).tolist() == [[-1.0, 0.0], [-1.0, 0.0]]
