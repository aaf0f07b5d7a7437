"""Every benchmark finds what it imports of ours; packages of others that it compares with may be missing."""

from importlib import import_module
from pathlib import Path

import pytest

NAMES = sorted(path.stem for path in (Path(__file__).parents[2] / "benchmarks").glob("*.py"))


@pytest.mark.parametrize("name", NAMES)
def test_a_benchmark_can_be_imported(name):
    try:
        import_module(f"benchmarks.{name}")
    except ModuleNotFoundError as error:
        own = (error.name or "").split(".")[0] in ("omniservo", "benchmarks", "tests")
        if own:
            raise
        pytest.skip(f"{error.name} is not installed")
