"""Write docs/api.md from the docstrings of every public name: ``python -m benchmarks.api_page``."""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from typing import Any

import omniservo

PAGE = Path(__file__).resolve().parents[1] / "docs" / "api.md"

_HEAD = """# Python

Every name of `import omniservo`, with shapes and units, as `help()` shows it. Written by
`python -m benchmarks.api_page`; the rooms below (`omniservo.planning`, `omniservo.cameras`, …) have more, and
[architecture](architecture.md) says what is where. Lengths are in m, angles in rad, pixels in px, quaternions
(x, y, z, w); `a_T_b` takes coordinates in b to coordinates in a ([conventions](conventions.md)). Arguments
that are not legal raise `InputError`, which names the argument, what was given and what is legal.

```python
import numpy as np

import omniservo

camera = omniservo.preset("fe185")
points = np.array([[0.1, 0.0, 0.3], [0.0, 0.0, -1.0]])  # (…, 3) [m]
pixels, valid = camera.project(points)  # (…, 2) [px], (…)
print(pixels.shape, valid.tolist())
```

```text
(2, 2) [True, False]
```

"""
_SECTIONS = ("Args", "Returns", "Raises", "Attributes", "Yields")


def api_page() -> str:
    """Return the page."""
    names = [n for n in omniservo.__all__ if not n.startswith("_")]
    entries = [_entry(name, getattr(omniservo, name)) for name in names]
    table = "".join(f"| [`{n}`](#{n.lower()}) | {_first_line(getattr(omniservo, n))} |\n" for n in names)
    return f"{_HEAD}| name | |\n|---|---|\n{table}\n" + "\n".join(entries)


def _entry(name: str, value: Any) -> str:
    parts = [f"## {name}\n", _signature(name, value), _described(inspect.getdoc(value) or "")]
    if inspect.isclass(value):
        for method, function in _methods(value):
            parts += [f"**{name}.{method}**\n", _signature(method, function)]
            parts.append(_described(inspect.getdoc(function) or ""))
    return "\n".join(part for part in parts if part)


def _methods(cls: type) -> list[tuple[str, Any]]:
    """Return the public methods that the class itself, or a parent of ours, has."""
    found = {}
    for name, value in inspect.getmembers(cls):
        held = inspect.getattr_static(cls, name)
        plain = inspect.isfunction(value) or isinstance(held, classmethod | staticmethod)
        if plain and not name.startswith("_") and value.__module__.startswith("omniservo"):
            found[name] = value
    return list(found.items())


def _signature(name: str, value: Any) -> str:
    try:
        text = str(inspect.signature(value))
    except (TypeError, ValueError):
        return ""
    text = re.sub(r"\bomniservo\.[\w.]*\.(?=\w)", "", text.replace("'", ""))
    for _ in range(2):  # <function A.<lambda> at 0x…>
        text = re.sub(r"<[^<>]*>", "…", text)
    if len(name + text) > 100:
        text = _in_lines(text)
    return f"    {name}{text}\n"


def _in_lines(text: str) -> str:
    """Return a signature with every argument on a line of its own."""
    depth, out = 0, ""
    for sign in text:
        depth += (sign in "([") - (sign in ")]")
        out += ",\n        " if sign == "," and depth == 1 else sign
    return re.sub(r"\n +(?=\S)", "\n        ", out)


def _described(doc: str) -> str:
    """Return a docstring as Markdown: formulas stay as they are, fields become a list."""
    lines: list[str] = []
    inside = False
    for line in doc.splitlines():
        if line.rstrip(":") in _SECTIONS and line.endswith(":"):
            lines += ["", f"*{line.rstrip(':').lower()}*", ""]
            inside = True
        elif inside and re.match(r" {4}\S", line):
            lines.append("- " + re.sub(r"^([\w, *]+): ", r"`\1`: ", line.strip()))
        elif inside and line.startswith("        "):
            lines[-1] += f" {line.strip()}"
        else:
            inside = inside and not line.strip()
            lines.append(line)
    return _escaped("\n".join(lines)) + "\n"


def _escaped(text: str) -> str:
    """Return it with what Markdown would take for markup outside of code made literal."""
    text = text.replace("``", "`")
    pieces = re.split(r"(`[^`\n]*`|^ {4}.*$)", text, flags=re.MULTILINE)
    return "".join(
        piece if i % 2 else re.sub(r"(?<=\w)\*(?=\w)|(?<!\w)_(?=\w)|[<|]", r"\\\g<0>", piece)
        for i, piece in enumerate(pieces)
    )


def _first_line(value: Any) -> str:
    return (
        _escaped((inspect.getdoc(value) or "").partition("\n")[0]).replace("|", "\\|").replace("\\\\", "\\")
    )


if __name__ == "__main__":
    PAGE.write_text(api_page())
