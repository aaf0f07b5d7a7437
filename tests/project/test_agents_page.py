"""docs/agents.md is shipped as SKILL.md, and every command on it gives the JSON that stands below it."""

import contextlib
import json
import re
import shlex

from tests.cli.calling import call
from tests.project.agents_page import CONSOLE, FILES, LONG, ROOT, TEXT, differences, shown


def test_the_package_ships_the_page():
    assert (ROOT / "src/omniservo/SKILL.md").read_text() == TEXT
    assert re.match(r"---\nname: omniservo\ndescription: .{50,1000}\n---\n", TEXT)


def test_every_command_on_the_page_gives_the_json_below_it(capsys, tmp_path):
    for name, content in FILES.findall(TEXT):
        (tmp_path / name).write_text(content)
    blocks, checked = CONSOLE.findall(TEXT), 0
    with contextlib.chdir(tmp_path):
        for command, answer in blocks:
            if not command.startswith(LONG):
                words, _, said = command.partition("#")
                code, out, err = call(capsys, *shlex.split(words))
                assert code == int(said.split()[-1] if said else 0), err
                assert list(differences(shown(answer), json.loads(out))) == [], command
                checked += 1
    assert checked == 9
    assert len(blocks) == checked + 3


def test_a_difference_from_what_is_shown_is_found():
    expected = shown('{"status": "ok", "rows": [1.0, …], "more": …, …}')
    assert list(differences(expected, {"status": "ok", "rows": [1.0, 2.0], "more": 1, "x": 1})) == []
    assert list(differences(expected, {"status": "no", "rows": [], "more": 1})) == [
        ".status: 'no'", ".rows: 0 items",
    ]  # fmt: skip
    assert list(differences(expected, {"rows": [1.5], "more": 1})) == [
        ".status: missing", ".rows[0]: 1.5",
    ]  # fmt: skip
    assert list(differences(shown('{"a": 1}'), {"a": 1, "b": 2})) == [": ['b']"]
