"""``omniservo view``."""

from __future__ import annotations

import sys
import time
import webbrowser
from typing import Annotated

import typer

from omniservo.cli.grouped import grouped
from omniservo.cli.output import Output
from omniservo.cli.robot_options import TaskOptions, packages_of

FIRST = "whole-arm-1"
"""The shipped task that is shown where nothing is named."""

_FIRST_PLAN = 900.0
"""[s] that the first plan may take: whoever never ran the program waits for compiling"""

ViewedArgument = Annotated[
    str, typer.Argument(metavar="[TASK | RUN | PLAN]", help="A task, the folder of a run, a plan, a problem.")
]
PortOption = Annotated[
    int, typer.Option("--port", min=1, max=65535, help="Of the page; the next that is free, if it is taken.")
]
NoBrowserOption = Annotated[
    bool, typer.Option("--no-browser", help="Say where the page is, and open no browser.")
]


@grouped
def view(
    what: ViewedArgument = FIRST,
    *,
    port: PortOption = 8080,
    no_browser: NoBrowserOption = False,
    seconds: Annotated[float | None, typer.Option("--seconds", min=0, help="End after so long.")] = None,
    files: TaskOptions,
    output: Output,
) -> None:
    """Show a live page: drag obstacles, start and goal, and the certified path follows.

    It is served to this machine alone, until Ctrl-C.
    """
    with output.working("loading"):
        from omniservo.viewer import open_viewed, require_viser, serve_page

        require_viser()
        viewed = open_viewed(what, packages_of(files.package), allow_outside=files.allow_outside)
    with serve_page(viewed, port=port) as page:
        with output.working("planning"):
            page.settled.wait(_FIRST_PLAN)
        url = f"http://127.0.0.1:{page.server.get_port()}/"
        output.line(f"{viewed.name}: {url}  (Ctrl-C ends it)")
        output.result({"name": viewed.name, "url": url}, "view")
        sys.stdout.flush()
        if not no_browser:
            webbrowser.open(url)
        end = float("inf") if seconds is None else time.monotonic() + seconds
        while time.monotonic() < end:
            time.sleep(0.2)
