"""The agents' page: its files, its commands, and the JSON that stands below them."""

import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs/agents.md"
TEXT = PAGE.read_text()
CONSOLE = re.compile(r"```console\n\$ omniservo (.*?)\n(.*?)```", re.DOTALL)
FILES = re.compile(r"`([\w.-]+\.json)`[^`]*\n\n```json\n(.*?)```", re.DOTALL)
LONG = "run", "estimate", "plan --estimate"
"""Commands that take a whole run, or its results: `tests/cli/test_run.py` has them."""


def shown(text):
    """Return the JSON of a block; … stands for any value, further fields, or further items."""
    text = re.sub(r"([{,]\s*)…(?=\s*\})", r'\1"…": "…"', text)
    text = re.sub(r"(?<!\")…(?!\")", '"…"', text)
    return json.loads(text)


def differences(expected, given, place=""):
    """Yield where what was given is not what is shown."""
    if expected == "…":
        return
    if isinstance(expected, dict) and isinstance(given, dict):
        for name in expected:
            if name != "…" and name not in given:
                yield f"{place}.{name}: missing"
            elif name != "…":
                yield from differences(expected[name], given[name], f"{place}.{name}")
        if "…" not in expected and set(given) != set(expected):
            yield f"{place}: {sorted(set(given) ^ set(expected))}"
    elif isinstance(expected, list) and isinstance(given, list):
        items = expected[:-1] if expected[-1:] == ["…"] else expected
        if len(given) < len(items) or (items is expected and len(given) != len(items)):
            yield f"{place}: {len(given)} items"
        for i, (one, other) in enumerate(zip(items, given, strict=False)):
            yield from differences(one, other, f"{place}[{i}]")
    elif isinstance(expected, float) and isinstance(given, float):
        if given != pytest.approx(expected, rel=0.02, abs=2e-4):
            yield f"{place}: {given}"
    elif expected != given:
        yield f"{place}: {given!r}"
