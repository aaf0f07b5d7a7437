"""Every command line in README, docs and the help of others names a command and options that exist."""

import re
import shlex
from pathlib import Path

import pytest
import typer
import yaml

from omniservo import PlanningProblem, plan_path, verify_plan
from omniservo.cli.main import app

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "examples/README.md", *sorted((ROOT / "docs").glob("*.md"))]
COMMAND = typer.main.get_command(app)
LINE = re.compile(r"(?m)^(?:    |\$ |)(?:\S+/)?omniservo ([a-z-]+ .*|[a-z-]+)$")
INLINE = re.compile(r"`omniservo ([a-z-]+(?: [^`\n]*)?)`")


def calls(text):
    """Yield the command lines of a page: of its blocks, and within its sentences."""
    for found in (*LINE.findall(text), *INLINE.findall(text)):
        for one in re.split(r"\s{3,}(?:omniservo )?|; (?:then: )?omniservo ", found)[:1]:
            yield one.partition(" #")[0].strip()


def wrong(call):
    """Return what of a call does not exist; nothing where it is right."""
    command = COMMAND
    words = shlex.split(call.replace("'", ""))
    while words and hasattr(command, "commands") and not words[0].startswith("--"):
        name = words.pop(0)
        default = getattr(command, "default", None)  # omniservo study STUDY is omniservo study run STUDY
        if name not in command.commands and default is not None:
            name = default
        if name not in command.commands:
            return f"no command {name!r}"
        command = command.commands[name]
    known = {option for parameter in command.params for option in parameter.opts + parameter.secondary_opts}
    for word in words:
        option = word.strip("[](),.;|").partition("=")[0]
        if option.startswith("--") and option not in (*known, "--help"):
            return f"no option {option}"
    return ""


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_line_on_a_page_exists(page):
    assert [(call, what) for call in calls(page.read_text()) if (what := wrong(call))] == []


def test_there_are_commands_to_look_at():
    assert sum(len(list(calls(page.read_text()))) for page in PAGES) > 100


@pytest.mark.parametrize(
    ("call", "what"),
    [
        ("plan problem.json --out plan.json", ""),
        ("camera convert a b --to kalibr", ""),
        ("--install-completion", ""),
        ("--instal-completion", "no option --instal-completion"),
        ("plans problem.json", "no command 'plans'"),
        ("camera turn", "no command 'turn'"),
        ("plan problem.json --oot x", "no option --oot"),
    ],
)
def test_a_call_that_is_wrong_is_found(call, what):
    assert wrong(call) == what


def first_problem():
    text = (ROOT / "docs/start.md").read_text()
    return yaml.safe_load(re.search(r"<!-- first-problem -->\n```yaml\n(.*?)```", text, re.DOTALL)[1])


def test_the_first_problem_of_the_start_page_is_planned_and_verified_and_can_be_made_impossible():
    plan = plan_path(PlanningProblem.from_dict(first_problem()))
    assert (plan.status, verify_plan(plan).status) == ("certified", "certified")
    refused = plan_path(PlanningProblem.from_dict({**first_problem(), "clearance": 0.3}))
    assert refused.status == "infeasible"
    assert "start pose (w = 0) violates clearance obstacle 0" in refused.reason
