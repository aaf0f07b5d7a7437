"""Every Python block in README and docs runs; a ``text`` block right after it is what it prints."""

import contextlib
import io
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"```python\n(.*?)```(?:\s*(?:[^\n`]*\n)?\s*```text\n(.*?)```)?", re.DOTALL)
BLOCKS = {page: found for page in PAGES if (found := BLOCK.findall(page.read_text()))}


@pytest.mark.parametrize("page", BLOCKS, ids=lambda page: page.name)
def test_code_in_the_papers_runs_in_its_order_and_prints_what_they_say(page, tmp_path):
    names = {"__name__": "__main__"}
    for code, printed in BLOCKS[page]:
        output = io.StringIO()
        with contextlib.chdir(tmp_path), contextlib.redirect_stdout(output):
            exec(compile(code, f"{page.name}: code", "exec"), names)  # noqa: S102
        if printed:
            assert output.getvalue().split() == printed.split()


def test_there_is_code_to_run():
    assert any(page.name == "README.md" for page in BLOCKS)
