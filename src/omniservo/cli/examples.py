"""``omniservo examples``."""

from __future__ import annotations

from omniservo.cli.output import JsonOption, Output, QuietOption


def examples(as_json: JsonOption = False, quiet: QuietOption = False) -> None:
    """List the shipped tasks, one line each."""
    from omniservo.tasks import load_task, shipped_tasks

    output = Output(as_json, quiet)
    summaries = {name: load_task(name).summary for name in shipped_tasks()}
    for name, summary in summaries.items():
        output.line(f"{name:<20} {summary}")
    output.result({"tasks": [{"name": n, "summary": s} for n, s in summaries.items()]})
