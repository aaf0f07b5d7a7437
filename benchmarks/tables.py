"""Tables in Markdown, as they come."""

from __future__ import annotations

from collections.abc import Iterable


def print_table(head: str, rows: Iterable[str]) -> None:
    """Print a table's head, then its rows one by one."""
    print(head)
    print("|---" * (head.count("|") - 1) + "|")
    for row in rows:
        print(f"| {row} |", flush=True)
