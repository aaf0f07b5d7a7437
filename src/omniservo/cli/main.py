"""The command ``omniservo``."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

import omniservo
from omniservo.cli import camera, estimate, examples, plan, robot, run, teach, verify
from omniservo.cli.output import ANSWER_IS_NO, WRONG_INPUT
from omniservo.errors import AnswerIsNo, InputError

app = typer.Typer(
    name="omniservo",
    help="Certified visual-servo path planning for every central camera.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.command("run")(run.run)
app.command("estimate")(estimate.estimate)
app.command("plan")(plan.plan)
app.command("verify")(verify.verify)
app.command("teach")(teach.teach)
app.command("examples")(examples.examples)
app.add_typer(camera.app, name="camera")
app.add_typer(robot.app, name="robot")


def _version(wanted: bool) -> None:
    if wanted:
        print(omniservo.__version__)
        raise typer.Exit


@app.callback()
def _omniservo(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Certified visual-servo path planning for every central camera."""


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; a wrong input is one message and exit code 2, never a traceback.

    Args:
        arguments: what follows the program's name; None: what the process was called with.
    """
    try:
        app(args=arguments)
    except InputError as error:
        print(f"omniservo: {error}", file=sys.stderr)
        sys.exit(WRONG_INPUT)
    except AnswerIsNo as answer:
        print(f"omniservo: {answer}", file=sys.stderr)
        sys.exit(ANSWER_IS_NO)
    except KeyboardInterrupt:
        print("omniservo: interrupted; nothing was written", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()
