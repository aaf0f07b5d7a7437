"""Which look is taken, what is expected of it, and what is said where none helps."""

from dataclasses import replace

import numpy as np
import pytest
from tests.looks.conftest import SINGULAR

from omniservo.errors import InputError
from omniservo.looks import NextLook, next_look, uncertainty_size, what_is_missing
from omniservo.looks.candidate_joints import ASIDE, ROLLED, _camera_moves
from omniservo.looks.followed_points import MOST_POINTS
from omniservo.risk import plan_arm_with_risk
from omniservo.whole_arm import plan_with_arm


def is_planned(there):
    """As if the estimate were exact."""
    problem = replace(there.problem, initial_T_goal=there.estimate.initial_T_goal)
    return plan_with_arm(problem, there.planned_setting).certified


def is_planned_at_risk(there, risk=0.005):
    return plan_arm_with_risk(
        there.problem, there.planned_setting, there.estimate, risk=risk, mount_covariance=None
    ).ok


def test_what_is_planned_from_a_look_keeps_what_servoing_needs_of_joint_ranges(standing):
    here = standing()
    assert (
        here.planned_setting.limit_reserve == here.setting.servoed.limit_reserve > here.setting.limit_reserve
    )


@pytest.mark.slow
def test_a_start_near_a_singularity_is_left_by_a_certified_move_to_where_there_is_a_plan(standing, tube):
    here = standing(start=SINGULAR, tube=tube)
    assert not is_planned(here)
    assert "singular" in here.reserve_missing
    found = next_look(here, is_planned, 0)
    assert isinstance(found, NextLook)
    assert found.leads_to_plan
    there = here.expected_after(found.move)
    assert there.reserve_missing == ""
    assert is_planned(there)
    assert found.move.joints.singular_values[0] < tube.singular_value <= found.move.joints.singular_values[-1]


@pytest.mark.slow
def test_the_look_that_is_expected_to_tell_most_of_those_with_a_plan_is_taken(standing):
    here = standing(noise=1.0)
    found = next_look(here, lambda there: True, 0)
    assert found.size == pytest.approx(uncertainty_size(here.expected_after(found.move).estimate))
    assert found.size < 0.6 * uncertainty_size(here.estimate)


@pytest.mark.slow
def test_a_look_that_failed_is_not_taken_again_and_smaller_changes_of_the_view_come_first(standing):
    here = standing(noise=1.0)
    first = next_look(here, lambda there: False, 0)
    asked = []
    second = next_look(here, lambda there: asked.append((there.start, there.is_free)), 0, [first.move])
    ways = [np.linalg.norm(found.move.begin_T_end.translation) for found in (first, second)]
    turns = [found.move.begin_T_end.rotation.magnitude() for found in (first, second)]
    assert ways[1] < 0.9 * ways[0] or turns[1] < 0.9 * turns[0]
    assert second.size > first.size
    assert not any(np.array_equal(q, first.move.joints.positions[-1]) for q, _ in asked)
    mount, arm = here.setting.flange_T_camera, here.setting.arm
    base_T_here = arm.base_T_flange(here.start) * mount
    moves = [base_T_here.inv() * arm.base_T_flange(q) * mount for q, free in asked if free]
    bold = [
        np.linalg.norm(move.translation) > 0.9 * ways[0] and move.rotation.magnitude() > 0.9 * turns[0]
        for move in moves
    ]
    assert bold == sorted(bold)
    assert not bold[0]


@pytest.mark.slow
def test_of_many_points_those_that_are_followed_have_to_stay_in_view_in_fifty_structures(standing):
    here = standing(count=120)
    rows = here.planned_rows
    assert len(rows) == MOST_POINTS
    found = next_look(here, lambda there: True, 0)
    samples = found.move.plan.problem.points.reshape(-1, MOST_POINTS, 3)
    assert len(samples) == 50
    assert samples[0] == pytest.approx(here.estimate.points[rows])
    assert len(here.expected_after(found.move).problem.points) == MOST_POINTS


@pytest.mark.slow
def test_a_look_after_which_nothing_is_known_better_is_not_taken(standing):
    here = replace(standing(), optimum=None)
    found = next_look(here, lambda there: False, 0)
    assert isinstance(found, str)
    assert "nor to make what is uncertain smaller" in found


@pytest.mark.slow
def test_a_candidate_that_cannot_be_planned_from_is_no_plan(standing):
    def refuses(there):
        raise InputError("nothing is left of the image")

    assert not next_look(standing(), refuses, 0).leads_to_plan


def test_what_would_have_to_be_better_is_found_by_making_it_so(standing, tube):
    here = standing(start=SINGULAR, tube=tube)
    assert "singular value: " in what_is_missing(here, is_planned)
    close = standing(tube=replace(tube, links=dict.fromkeys(tube.links, 0.3)))
    assert "tube: " in what_is_missing(close, is_planned)
    asked = []

    def needs_quiet_pixels(there):
        asked.append(float(np.median(there.optimum.views.noise)))
        return asked[-1] <= 0.2

    assert "pixels: a quarter as uncertain" in what_is_missing(standing(), needs_quiet_pixels)
    assert what_is_missing(standing(), lambda there: False).startswith("there would be none if everything")


@pytest.mark.parametrize("distance", [0.15, 0.5])
def test_from_aside_the_camera_is_aimed_at_the_target_rolled_or_not(distance):
    middle = distance * np.array([0.6, 0.0, 0.8])
    aside = [pose for pose in _camera_moves(middle) if abs(pose.translation @ middle) < 1e-12]
    assert len(aside) == 2 * 8 * len(ASIDE)
    for straight, rolled in zip(aside[::2], aside[1::2], strict=True):
        for pose in (straight, rolled):
            seen = pose.inv().apply(middle)
            assert seen / np.linalg.norm(seen) == pytest.approx(middle / distance, abs=1e-12)
        roll = (straight.inv() * rolled).rotation.as_rotvec()
        assert roll == pytest.approx(ROLLED * middle / distance, abs=1e-12)
