"""``omniservo warm-up``."""

from __future__ import annotations

from omniservo.cli.compiled_record import CompiledRecord, where_compiled_is_kept
from omniservo.cli.grouped import grouped
from omniservo.cli.output import Output


@grouped
def warm_up(output: Output) -> None:
    """Compile all kernels now; the first run, plan or estimate then need not."""
    record = CompiledRecord()
    if record.is_complete():
        output.line("everything is compiled already")
        output.result({"compiled": 0, "seconds": 0.0, "already": True}, "warm-up")
        return
    with output.working("starting", compiles=True) as progress:
        progress("loading", 0.0)
        from omniservo.geometry.compiler_watch import CompilerWatch
        from omniservo.runs.compile_ahead import compiling_ahead
        from omniservo.runs.warm_up import warm_up as do_small_jobs
        from omniservo.simulation import SimulatedCell

        with compiling_ahead(), CompilerWatch() as watch:
            do_small_jobs(SimulatedCell, progress)
    output.line(f"compiled {watch.compiled} functions in {watch.seconds:.0f} s; {where_compiled_is_kept()}")
    if not record.save():
        output.line(f"{record.path}: could not be written: the next warm-up goes through the same jobs again")
    output.result({"compiled": watch.compiled, "seconds": watch.seconds, "already": False}, "warm-up")
