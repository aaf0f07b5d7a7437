"""README, docs, help texts, docstrings and reports use the field's terms; docs/glossary.md defines them."""

import ast
import re
from importlib import import_module
from pathlib import Path

import pytest
import typer

from omniservo.cli.main import app

ROOT = Path(__file__).resolve().parents[2]
GLOSSARY = ROOT / "docs/glossary.md"
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
SOURCES = sorted((ROOT / "src/omniservo").rglob("*.py"))
REPORTING = sorted((ROOT / "src/omniservo/reporting").glob("*.py"))

# the replaced phrase, and the term that stands for it
REPLACED = {
    r"ways of the points": "feature trajectories",
    r"shows by itself": "natural features",
    r"to begin with": "suggested start configuration",
    r"looked at\b": "checked, evaluated, sampled",
    r"\bpostures?\b": "joint configuration",
    r"\bpictures?\b": "image",
    r"\bled over\b": "blended",
    r"\basked\b": "required",
    r"\bbelie(f|ve)|\bforget": "state estimate, reset",
    r"\bvouch": "outlier rejection",
    r"\b(least )?room (of|to) (each|a|the|its) (joint|ends)": "joint-limit margin",
    r"\bin (the|its|their) hand\b": "eye-in-hand, on the end-effector",
    r"\btold\b": "given, detected",
    r"joints' turn": "search seeded from joint-space curves",
    r"\bin the way\b": "obstacle",
    r"\bhandy\b": "suggested",
    r"\b(of|along|out of) the hand\b": "of the end-effector",
    r"\bup is up\b": "drawn upright, equal axis scaling",
    r"\bstray(s|ed)?\b": "deviates",
    r"\btake[sn]? up\b": "followed from, absorbed",
    r"[Pp]lanned again on the way|[Pp]lanning again on the way": "replanning",
    r"\bdemands?\b|\bdemanded\b": "constraint, required",
    r"AnswerIsNo": "NoSolutionError",
    r"\b[Nn]obody\b": "unknown",
    r"\b(the|its|your|this|another) tool\b": "flange",
}

TERMS = [
    "trajector", "end-effector", "eye-in-hand", "collision checking", "self-collision", "field of view",
    "reprojection error", "outlier", "null.space", "manipulability|singular value", "extrinsics",
    "waypoint", "chance constraint", "warm start", "covariance",
]  # fmt: skip


def replaced_words(text, where):
    """Return 'file:line: phrase (term)' of every replaced phrase outside code."""
    prose = re.sub(r"(?ms)^```.*?^```", lambda block: "\n" * block[0].count("\n"), text)
    prose = re.sub(r"`[^`\n]*`", "", prose)
    return [
        f"{where}:{prose.count(chr(10), 0, found.start()) + 1}: {found[0]!r}, say: {term}"
        for phrase, term in REPLACED.items()
        for found in re.finditer(phrase.replace(" ", r"\s+"), prose, re.IGNORECASE)
    ]


def texts_of(path):
    """Yield line and text of every string that has a blank in it, without arguments' names in docstrings."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            yield node.lineno, re.sub(r"(?m)^ +\w+: ", "", node.value)


def docstrings_of(path):
    """Yield line and text of every docstring, of attributes too, without arguments' names."""
    for node in ast.walk(ast.parse(path.read_text())):
        body = getattr(node, "body", ())
        for statement in body if isinstance(body, list) else ():
            value = getattr(statement, "value", None)
            if isinstance(statement, ast.Expr) and isinstance(getattr(value, "value", None), str):
                yield statement.lineno, re.sub(r"(?m)^ +\w+: ", "", value.value)


def helps(command, name="omniservo"):
    """Yield every command's name and its help with that of its parameters."""
    params = [getattr(param, "help", None) or "" for param in command.params]
    yield name, "\n".join([command.help or "", *params])
    for sub in getattr(command, "commands", {}).values():
        yield from helps(sub, f"{name} {sub.name}")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_no_page_uses_a_replaced_word(page):
    assert replaced_words(page.read_text(), page.relative_to(ROOT)) == []


def test_no_help_text_uses_a_replaced_word():
    commands = dict(helps(typer.main.get_command(app)))
    assert len(commands) > 10
    assert [found for name, text in commands.items() for found in replaced_words(text, name)] == []


def test_no_text_of_the_report_uses_a_replaced_word():
    texts = [(path, *text) for path in REPORTING for text in texts_of(path)]
    assert [f for path, line, text in texts for f in replaced_words(text, f"{path.name}:{line}")] == []


@pytest.mark.slow
def test_no_docstring_uses_a_replaced_word():
    texts = [(path, *text) for path in SOURCES for text in docstrings_of(path)]
    assert len(texts) > 5000
    assert [f for path, line, text in texts for f in replaced_words(text, f"{path.name}:{line}")] == []


def test_a_replaced_word_in_an_attribute_s_docstring_is_found(tmp_path):
    file = tmp_path / "planted.py"
    file.write_text('class A:\n    """Fine."""\n\n    x: int\n    """the picture of\n    a posture"""\n')
    found = [f for line, text in docstrings_of(file) for f in replaced_words(text, f"{line}")]
    assert [words.split("'")[1] for words in found] == ["posture", "picture"]


@pytest.mark.parametrize(
    "planted",
    ["The ways of the points.", "Limits are\nlooked at.", "A posture.", "Two pictures.", "It strays."],
)
def test_a_replaced_word_that_comes_back_is_found_with_its_line(planted):
    (found,) = replaced_words(f"One line.\n{planted}\n", "page.md")
    assert re.match(r"page\.md:[23]: ", found)


def headings(page):
    """Return the anchors of a page as GitHub makes them, and the stated ones."""
    text = page.read_text()
    titles = re.findall(r"(?m)^#+ (.*)$", text)
    made = {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}
    return made | set(re.findall(r'<a id="([^"]+)"', text))


def glossary():
    rows = re.findall(r"(?m)^\| (.+?) \| (.+) \| (.+?) \|$", GLOSSARY.read_text())
    return [row for row in rows if row[0] != "term"]


def test_the_glossary_is_in_alphabetical_order_and_has_about_sixty_terms():
    terms = [re.sub(r"[^a-z]", "", term.lower().replace("é", "e")) for term, _, _ in glossary()]
    assert len(terms) >= 60
    assert terms == sorted(set(terms))


@pytest.mark.parametrize(("term", "meaning", "home"), glossary(), ids=lambda text: text[:20])
def test_every_glossary_entry_leads_to_where_it_lives(term, meaning, home):
    link = re.fullmatch(r"\[[^]]+\]\(([^)#]+)(?:#([^)]+))?\)", home)
    if link is None:
        import_module(home.strip("`"))
        return
    page = GLOSSARY.parent / link[1]
    assert page.exists()
    assert link[2] is None or link[2] in headings(page)


@pytest.mark.parametrize("term", TERMS)
def test_the_docs_use_the_term_outside_the_glossary(term):
    assert any(re.search(term, page.read_text(), re.IGNORECASE) for page in PAGES if page != GLOSSARY)
