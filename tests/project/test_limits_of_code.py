"""What code keeps to so that it can be read: no index above six, eight arguments, functions of 60 lines."""

import ast
from functools import cache
from pathlib import Path

import pytest

from omniservo.cli.main import app

SOURCE = Path(__file__).resolve().parents[2] / "src"

MOST_ARGUMENTS, LARGEST_INDEX = 8, 6
MOST_LINES = {"file": 450, "function": 60}

PUBLIC = {
    # documented calls whose arguments, most of them keywords with a default, are the whole of their options
    "omniservo.cameras.unified_camera.__init__",
    "omniservo.estimation.estimate_known_target.estimate_known_target",
    "omniservo.estimation.estimate_two_view.estimate_two_view",
    "omniservo.replanning.replan_with_arm.replan_with_arm",
}


def commands(typer_app):
    """Yield the functions behind a Typer app's commands: there every option is an argument."""
    for command in typer_app.registered_commands:
        yield f"{command.callback.__module__}.{command.callback.__name__}"
    for group in typer_app.registered_groups:
        yield from commands(group.typer_instance)


def long_signatures(tree):
    """Yield the functions of more than eight arguments, without the instance or class of a method."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            a = node.args
            given = [*a.posonlyargs, *a.args, *a.kwonlyargs, *filter(None, (a.vararg, a.kwarg))]
            if len(given) - sum(first.arg in ("self", "cls") for first in given[:1]) > MOST_ARGUMENTS:
                yield node.name


def long_functions(tree):
    """Yield the functions that do not fit a screen."""
    for node in ast.walk(tree):
        is_function = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        if is_function and node.end_lineno - node.lineno >= MOST_LINES["function"]:
            yield node.name


def is_large(node):
    """Tell whether an expression is an integer written as a number, above six or below minus six."""
    value = node.operand if isinstance(node, ast.UnaryOp) else node
    return isinstance(value, ast.Constant) and isinstance(value.value, int) and value.value > LARGEST_INDEX


def large_indices(tree):
    """Yield 'line: expression' of places, and of bounds of places in several dimensions, that are numbers.

    Bounds in one dimension also cut texts to a length, which names nothing.
    """
    for node in ast.walk(tree):
        if isinstance(node, ast.Subscript):
            places = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
            bounds = [b for p in places if isinstance(p, ast.Slice) for b in (p.lower, p.upper)]
            if any(is_large(p) for p in places + bounds * (len(places) > 1)):
                yield f"{node.lineno}: {ast.unparse(node)}"


@cache
def beyond():
    """Return what is beyond each limit, `module.name` or `module:line`; trees of all modules are not kept."""
    found = {"file": [], "function": [], "arguments": [], "index": []}
    for path in sorted(SOURCE.rglob("*.py")):
        text, module = path.read_text(), ".".join(path.relative_to(SOURCE).with_suffix("").parts)
        tree = ast.parse(text)
        found["file"] += [module] * (text.count("\n") > MOST_LINES["file"])
        found["function"] += [f"{module}.{name}" for name in long_functions(tree)]
        found["arguments"] += [f"{module}.{name}" for name in long_signatures(tree)]
        found["index"] += [f"{module}:{place}" for place in large_indices(tree)]
    return found


def test_functions_are_short_and_files_fit_a_reader():
    assert beyond()["file"] == []
    assert beyond()["function"] == []


def test_no_function_has_more_than_eight_arguments_but_commands_and_named_public_calls():
    assert set(beyond()["arguments"]) - set(commands(app)) == PUBLIC


def test_no_index_is_a_number_above_six():
    assert beyond()["index"] == []


@pytest.mark.parametrize(
    "text",
    ["x = body[17]", "a[:, 0, 7] = 1.0", "x = row[-8]", "x = blocks[:, 9:15]", "del rows[0, :7]"],
)
def test_a_large_index_is_found(text):
    assert len(list(large_indices(ast.parse(text)))) == 1


@pytest.mark.parametrize("text", ["x = body[6]", "x = text[:80]", "x = a[K1]", "x = a[3 * i + 8]", "x = 17"])
def test_what_is_no_large_index_is_let_through(text):
    assert list(large_indices(ast.parse(text))) == []


@pytest.mark.parametrize(("lines", "is_long"), [(60, False), (61, True)])
def test_a_function_longer_than_a_screen_is_found(lines, is_long):
    text = "class A:\n    async def f():\n" + "        pass\n" * (lines - 1)
    assert list(long_functions(ast.parse(text))) == (["f"] if is_long else [])


@pytest.mark.parametrize(
    ("text", "is_long"),
    [
        ("def f(a, b, c, d, e, f, g, h): ...", False),
        ("def f(a, b, c, d, e, f, g, h, i): ...", True),
        ("def f(a, /, b, c, d, e, f, *, g, h, i): ...", True),
        ("class A:\n    def f(self, a, b, c, d, e, f, g, h): ...", False),
        ("class A:\n    async def f(cls, a, b, c, d, e, f, g, h, i): ...", True),
    ],
)
def test_a_function_of_nine_arguments_is_found(text, is_long):
    assert list(long_signatures(ast.parse(text))) == (["f"] if is_long else [])
