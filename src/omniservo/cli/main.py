"""The command ``omniservo``."""

from __future__ import annotations

import gc
import io
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Annotated, Any, NoReturn

import typer
from typer.main import get_command

import omniservo
from omniservo.cli import (
    camera,
    doctor,
    estimate,
    examples,
    export,
    plan,
    render,
    robot,
    run,
    schema,
    sim,
    study,
    teach,
    verify,
    view,
    warm_up,
)
from omniservo.cli.first_steps import first_steps
from omniservo.cli.output import ANSWER_IS_NO, INTERRUPTED, UNREAD, WRONG_INPUT
from omniservo.cli.progress import DOING
from omniservo.errors import TERMINATED, AlreadyExists, InputError, NoSolutionError, ServoStop

_GARBAGE = (20_000, 20, 20)
"""Objects made between looks for garbage: counts free nearly all, and a look at all modules takes 30 ms."""

_LOSSLESS = "utf-8", "surrogateescape"
"""encoding and errors of a stream that writes everything as it is"""

app = typer.Typer(
    name="omniservo",
    help="Certified visual-servo path planning for every central camera.",
    pretty_exceptions_enable=False,
)
app.command("run")(run.run)
app.command("export")(export.export)
app.command("estimate")(estimate.estimate)
app.command("plan")(plan.plan)
app.command("verify")(verify.verify)
app.command("teach")(teach.teach)
app.command("view")(view.view)
app.command("examples")(examples.examples)
app.command("render")(render.render)
app.command("schema")(schema.schema)
app.command("warm-up")(warm_up.warm_up)
app.command("doctor")(doctor.doctor)
app.add_typer(camera.app, name="camera")
app.add_typer(robot.app, name="robot")
app.add_typer(sim.app, name="sim")
app.add_typer(study.app, name="study")


def _version(wanted: bool) -> None:
    if wanted:
        print(omniservo.__version__)
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _omniservo(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Certified visual-servo path planning for every central camera."""
    if context.invoked_subcommand is None:
        print(first_steps())


@cache
def _commands() -> Callable[..., Any]:
    """Return the commands, made once: typer reads all their signatures."""
    return get_command(app)


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; a wrong input is one message and exit code 2, never a traceback.

    Args:
        arguments: what follows the program's name; None: what the process was called with.
    """
    gc.set_threshold(*_GARBAGE)
    os.environ.pop("MPLBACKEND", None)  # no command opens a window; of a name unknown to it matplotlib fails
    _open_closed_streams()
    _escape_unencodable(sys.stdout)
    DOING.stage, DOING.written = "", []
    try:
        with _ended_cleanly():
            sys.exit(_commands()(args=arguments, standalone_mode=False) or 0)
    except AlreadyExists as error:
        _end(WRONG_INPUT, f"{error.path}: exists; --force replaces it")
    except InputError as error:
        _end(WRONG_INPUT, str(error))
    except NoSolutionError as answer:
        _end(ANSWER_IS_NO, str(answer))
    except ServoStop as stop:
        _end(ANSWER_IS_NO, f"{stop.reason}: {stop}")
    except OSError as error:  # such as a full disk behind standard output
        _end(WRONG_INPUT, ": ".join(str(w) for w in (error.filename, error.strerror or error) if w))
    except KeyboardInterrupt:
        _end(INTERRUPTED, DOING.ended("interrupted"))
    except typer.Abort:  # which typer makes of an end of input
        _end(ANSWER_IS_NO, DOING.ended("the input ended"))
    except SystemExit as end:
        if isinstance(end.__context__, BrokenPipeError):  # which typer ends with the code of a no
            sys.exit(UNREAD)
        if end.code == INTERRUPTED:  # what typer makes of Ctrl-C
            _end(INTERRUPTED, DOING.ended("interrupted"))
        if end.code == TERMINATED:
            _end(TERMINATED, DOING.ended("terminated"))
        raise
    except Exception as error:
        _end(WRONG_INPUT, _wrong_call(error))


def _wrong_call(error: Exception) -> str:
    """Return in one line what typer says of a wrong call; another error is a defect, and raised."""
    if not hasattr(error, "format_message"):
        raise error
    said = " ".join(error.format_message().split()).removesuffix(".")
    called = getattr(getattr(error, "ctx", None), "command_path", "omniservo")
    return f"{said or 'a command is missing'}; see {called} --help"


def _open_closed_streams() -> None:
    """Put the null device in the place of streams that whoever called closed."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open(mode, encoding="utf-8"))  # noqa: SIM115 — until the end


def _escape_unencodable(stream: object) -> None:
    """Let a stream write the numbers of characters that its encoding lacks, in place of failing."""
    if isinstance(stream, io.TextIOWrapper) and (stream.encoding, stream.errors) != _LOSSLESS:
        stream.reconfigure(errors="backslashreplace")


@contextmanager
def _ended_cleanly() -> Iterator[None]:
    """Make SIGTERM an exit, which leaves no half-written folder behind, where no one else answers it."""

    def leave(number: int, frame: FrameType | None) -> NoReturn:
        sys.exit(TERMINATED)

    ours = threading.current_thread() is threading.main_thread()
    if not ours or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGTERM, leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _end(code: int, message: str) -> NoReturn:
    print(f"omniservo: {message}", file=sys.stderr)
    sys.exit(code)


if __name__ == "__main__":
    main()
