"""``omniservo doctor``."""

from __future__ import annotations

from dataclasses import asdict

from omniservo.cli.grouped import grouped
from omniservo.cli.output import Output, answer_is_no


@grouped
def doctor(output: Output) -> None:
    """Check what of this machine matters, and say what to do next: exit 0 where all is well, else 1."""
    with output.working("checking this machine"):
        from omniservo.cli.machine_checks import machine_checks

        checks = list(machine_checks())
    for check in checks:
        output.line(f"{check.verdict:<6}{check.name:<15}{check.found}")
        if check.next_step:
            output.line(f"{'':<6}{'':<15}→ {check.next_step}")
    wrong = [check for check in checks if check.verdict == "wrong"]
    output.result({"well": not wrong, "checks": [asdict(check) for check in checks]}, "doctor")
    if wrong:
        raise answer_is_no("; ".join(f"{check.name}: {check.found}: {check.next_step}" for check in wrong))
    output.line("all is well")
