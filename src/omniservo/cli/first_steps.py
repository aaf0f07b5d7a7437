"""What ``omniservo`` alone says: what to do next, on one screen."""

from __future__ import annotations

from omniservo.cli.compiled_record import CompiledRecord

_STEPS = (
    ("omniservo run paper-example-1", "a first whole run in the simulator; it ends with a report to open"),
    ("omniservo examples", "the other tasks that come with it"),
    ("omniservo doctor", "whether this machine has what is needed"),
    ("omniservo --help", "every command; COMMAND --help tells its options"),
)
_FIRST = ("omniservo warm-up", "compile what is compiled, once; without it the first run does")


def first_steps() -> str:
    """Return what a person may do next; compiling comes first where it is still to be done."""
    steps = _STEPS if CompiledRecord().is_complete() else (_FIRST, *_STEPS)
    wide = max(len(command) for command, _ in steps)
    lines = [f"  {command:<{wide}}   {what}" for command, what in steps]
    return "\n".join(("omniservo moves a camera to a view that it was shown. What next:", "", *lines))
