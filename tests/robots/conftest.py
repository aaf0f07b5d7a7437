"""Arms that every claim about arms is tested on: the shipped ones, and two that only a URDF knows."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))  # importlib mode adds no folder: urdf_arms.py

from urdf_arms import SEVEN, SIX, urdf

from omniservo.robots import Arm, load_arm, shipped_arms

ARMS = (*shipped_arms(), "urdf of six", "urdf of seven")


@pytest.fixture(scope="session")
def load(tmp_path_factory):
    """Makes an arm by its name."""

    def made(name):
        if name in shipped_arms():
            return load_arm(name)
        path = tmp_path_factory.mktemp("arm") / "arm.urdf"
        path.write_text(urdf(SIX if name == "urdf of six" else SEVEN))
        return Arm(path)

    return made


@pytest.fixture(scope="session", params=ARMS)
def any_arm(request, load):
    return load(request.param)
