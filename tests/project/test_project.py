"""The project tests itself: public names, versions, papers, and that importing changes nothing."""

import ast
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

import omniservo

ROOT = Path(__file__).resolve().parents[2]
SOURCES = sorted((ROOT / "src").rglob("*.py"))


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


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT / "src")))
def test_functions_are_short_and_files_fit_a_reader(path):
    text = path.read_text()
    assert text.count("\n") <= 450
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            length = (node.end_lineno or 0) - node.lineno + 1
            assert length <= 60, f"{node.name}: {length} lines"


def test_every_rooms_public_names_exist():
    for room in (ROOT / "src" / "omniservo").iterdir():
        if (room / "__init__.py").exists():
            module = __import__(f"omniservo.{room.name}", fromlist=["__all__"])
            for name in getattr(module, "__all__", []):
                assert hasattr(module, name), f"omniservo.{room.name}.{name}"


def test_the_readme_starts_with_the_two_commands():
    first_screen = "\n".join((ROOT / "README.md").read_text().splitlines()[:25])
    assert "make demo" in first_screen
    assert "make test" in first_screen


def test_links_in_the_papers_lead_somewhere():
    for page in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")]:
        for target in re.findall(r"\]\(([^)#]+)", page.read_text()):
            if not target.startswith(("http://", "https://")):
                assert (page.parent / target).exists(), f"{page.name}: {target}"
