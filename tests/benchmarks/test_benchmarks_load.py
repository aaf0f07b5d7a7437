"""Every benchmark finds what it imports of ours; packages of others that it compares with may be missing."""

import ast
import inspect
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NAMES = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts) for path in (ROOT / "benchmarks").rglob("*.py")
)


@pytest.mark.parametrize("name", NAMES)
def test_a_benchmark_can_be_imported(name):
    try:
        import_module(name)
    except ModuleNotFoundError as error:
        own = (error.name or "").split(".")[0] in ("omniservo", "benchmarks", "tests")
        if own:
            raise
        pytest.skip(f"{error.name} is not installed")


def called(module, function):
    """Return what a call's function is where the module's own names tell, else None."""
    if isinstance(function, ast.Name):
        return getattr(module, function.id, None)
    if isinstance(function, ast.Attribute) and isinstance(function.value, ast.Name):
        owner = getattr(module, function.value.id, None)
        return getattr(owner, function.attr, None) if inspect.ismodule(owner) else None
    return None


@pytest.mark.parametrize("name", NAMES)
def test_what_a_benchmark_calls_takes_these_arguments(name):
    """Most run for minutes, and nobody notices for weeks that a function of ours has changed."""
    module = pytest.importorskip(name)
    calls = (node for node in ast.walk(ast.parse(inspect.getsource(module))) if isinstance(node, ast.Call))
    for call in calls:
        function = called(module, call.func)
        ours = (getattr(function, "__module__", None) or "").split(".")[0] in ("omniservo", "benchmarks")
        names = [keyword.arg for keyword in call.keywords]
        starred = None in names or any(isinstance(argument, ast.Starred) for argument in call.args)
        if callable(function) and ours and not starred:
            try:
                inspect.signature(function).bind(*call.args, **dict.fromkeys(names))
            except TypeError as error:
                pytest.fail(f"line {call.lineno}: {ast.unparse(call.func)}: {error}")
