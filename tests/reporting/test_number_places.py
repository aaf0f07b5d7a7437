"""Numbers of points in a picture: beside their point, and on nothing else."""

import numpy as np
import pytest

from omniservo.reporting.number_places import HEIGHT, number_places


def boxes(places):
    for number, place in enumerate(places):
        if place is not None:
            yield place, np.array([0.5 * 5.6 * len(str(number)), 0.5 * HEIGHT])


@pytest.mark.parametrize("seed", range(4))
def test_numbers_cover_neither_each_other_nor_a_ring(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform(0.0, 240.0, size=(40, 2))
    points[7] = np.nan
    places = number_places(points)
    assert places[7] is None
    placed = list(boxes(places))
    assert len(placed) > 25
    for k, (place, half) in enumerate(placed):
        for other, size in placed[:k]:
            assert (np.abs(place - other) >= half + size - 1e-9).any()
        rings = np.delete(points, 7, axis=0)
        assert (np.abs(place - rings) >= half + 4.0 - 1e-9).any(axis=1).all()


def test_a_number_stands_near_its_own_point():
    points = np.array([[20.0 * i, 15.0 * (i % 3)] for i in range(12)])
    for point, place in zip(points, number_places(points), strict=True):
        assert np.linalg.norm(place - point) < 16.0


def test_where_points_are_dense_some_numbers_are_left_out():
    points = np.array([[3.0 * i, 3.0 * j] for i in range(10) for j in range(10)])
    places = number_places(points)
    assert 0 < sum(place is not None for place in places) < 60
