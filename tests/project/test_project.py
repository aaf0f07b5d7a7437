"""The project tests itself: public names, versions, papers, and that importing changes nothing."""

import ast
import re
import subprocess
import sys
import tomllib
from collections import defaultdict
from importlib import import_module
from pathlib import Path

import pytest
import yaml

import omniservo

ROOT = Path(__file__).resolve().parents[2]


def test_every_public_name_exists():
    for name in omniservo.__all__:
        assert getattr(omniservo, name) is not None
    assert set(omniservo.__all__) == set(omniservo._HOME)


def test_versions_agree():
    pyproject = tomllib.loads((ROOT / "pyproject.toml").read_text())
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert omniservo.__version__ == pyproject["project"]["version"] == citation["version"]


def test_importing_loads_no_heavy_library():
    heavy = {"numba", "cv2", "mujoco", "matplotlib", "numpy"}
    code = f"import sys, omniservo; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_whole_jobs_load_nothing_of_the_simulator():
    code = "import sys, omniservo.runs, omniservo.runs.warm_up; print('omniservo.simulation' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_every_rooms_public_names_exist():
    for room in (ROOT / "src" / "omniservo").iterdir():
        if (room / "__init__.py").exists():
            module = __import__(f"omniservo.{room.name}", fromlist=["__all__"])
            for name in getattr(module, "__all__", []):
                assert hasattr(module, name), f"omniservo.{room.name}.{name}"


MOVED = [
    *(
        ("omniservo.planning", name, f"omniservo.{room}", name)
        for room, names in {
            "whole_arm": ["ArmPlan", "ArmSetting", "plan_with_arm"],
            "risk": ["Executions", "RiskPlan", "plan_arm_with_risk", "plan_links_at_risk", "plan_with_risk"],
            "replanning": ["replan", "replan_with_arm"],
        }.items()
        for name in names
    ),
    *(("omniservo.calibration", n, "omniservo.camera_files", n) for n in ("load_camera", "save_camera")),
    ("omniservo.robots", "Robot", "omniservo.robots", "ArmDriver"),
    ("omniservo.runs", "estimate_simulated", "omniservo.runs", "estimate_in_cell"),
    ("omniservo.robots", "handy_mount", "omniservo.robots", "suggested_mount"),
    ("omniservo.simulation", "Box", "omniservo.scenes", "SceneBox"),
    *(
        ("omniservo.simulation", n, "omniservo.scenes", n)
        for n in ("Ball", "Dots", "Panel", "Scene", "SceneBox", "Sensor", "scene_of_task")
    ),
    ("omniservo.perception", "Tags", "omniservo.perception", "FoundTags"),
    ("omniservo.looks", "Standing", "omniservo.looks", "ViewingState"),
]


@pytest.mark.parametrize(("old_room", "old", "room", "name"), MOVED)
def test_names_of_before_work_with_a_warning(old_room, old, room, name):
    with pytest.warns(DeprecationWarning, match=f"{old_room}.{old} is called .*{name} now"):
        found = getattr(import_module(old_room), old)
    assert found is getattr(import_module(room), name)


def test_a_name_that_never_was_is_no_attribute():
    with pytest.raises(AttributeError, match="has no attribute 'plan_with_legs'"):
        import_module("omniservo.planning").plan_with_legs  # noqa: B018


def test_no_two_public_classes_share_a_name():
    """The verifier's own aside: it shares nothing with the rest, names included or not."""
    files = defaultdict(list)
    for path in (ROOT / "src" / "omniservo").rglob("*.py"):
        if "verification" not in path.parts:
            for node in ast.parse(path.read_text()).body:
                if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                    files[node.name].append(path.name)
    assert len(files) > 200
    assert {name: where for name, where in files.items() if len(where) > 1} == {}


def test_the_readme_starts_with_the_two_commands():
    first_screen = "\n".join((ROOT / "README.md").read_text().splitlines()[:25])
    assert "make demo" in first_screen
    assert "make test" in first_screen


def test_links_in_the_papers_lead_somewhere():
    for page in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")]:
        for target in re.findall(r"\]\(([^)#]+)", page.read_text()):
            if not target.startswith(("http://", "https://")):
                assert (page.parent / target).exists(), f"{page.name}: {target}"
