"""False plans by the hundred: none is accepted, by the planner's certificate or by the verifier."""

import numpy as np
import pytest
from benchmarks.mutation_kinds import MUTATIONS, mutants
from benchmarks.mutations import certified_by_planner, plans, spared

from omniservo.verification import verify_plan

SETS = ("perspective", "catadioptric", "occlusion", "boxes")
FAMILIES = ("meshes", "clouds", "capsules", "half-spaces", "moving", "workspace", "masks", "distorted")


@pytest.fixture(scope="module")
def cases():
    found = [case for _, case in plans(len(SETS + FAMILIES), SETS + FAMILIES)]
    for case in found:
        assert verify_plan(case.document).status == "certified"
    return found


@pytest.mark.slow
def test_no_false_plan_is_accepted(cases):
    rng = np.random.default_rng(11)
    kinds = set()
    for case in cases:
        for mutant in mutants(case, rng, len(MUTATIONS)):
            kinds.add(mutant.kind)
            assert verify_plan(mutant.document).status != "certified", mutant
            assert not (mutant.path and certified_by_planner(mutant.document)), mutant
    assert len(kinds) == 16


def test_a_path_with_a_little_more_than_1e_6_left_is_certified(cases):
    rng = np.random.default_rng(12)
    answers = [spared(case, rng) for case in cases for _ in range(6)]
    judged = [answer for answer in answers if answer is not None]
    assert len(judged) > 30
    for family, certified, verified in judged:
        assert certified, family
        assert verified, family


def test_stated_margins_are_below_the_truth_and_not_loose(cases):
    loosest = {"m": 2e-3, "px": 0.5, "rad": 1e-6, "1": 1e-6}
    for case in cases:
        # A distorted camera's polygon lies inside the image, and the planner states its pixels cautiously.
        loose = loosest | ({"px": 2.5} if "visibility polygon" in case.truth else {})
        for line in case.document["certificate"]["constraints"]:
            truth = case.truth[line["name"].split(" (")[0]]
            assert line["margin"] <= truth.margin < line["margin"] + loose[line["unit"]], line
