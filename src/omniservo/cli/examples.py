"""``omniservo examples``."""

from __future__ import annotations

from omniservo.cli.grouped import grouped
from omniservo.cli.output import Output


@grouped
def examples(output: Output) -> None:
    """List the shipped tasks, one line each."""
    from omniservo.files import read_document
    from omniservo.shipped_tasks import shipped_tasks, task_file

    summaries = {name: read_document(task_file(name))["summary"] for name in shipped_tasks()}
    for name, summary in summaries.items():
        output.line(f"{name:<20} {summary}")
    output.result({"tasks": [{"name": n, "summary": s} for n, s in summaries.items()]}, "examples")
