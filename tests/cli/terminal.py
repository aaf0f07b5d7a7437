"""What a terminal shows of a command."""

import os
import pty
import subprocess


def shown_on_terminal(command, stdout=None, **options):
    """Run a command whose standard error, and output where not stated otherwise, is a terminal; return it."""
    ours, theirs = pty.openpty()
    process = subprocess.Popen(command, stdout=theirs if stdout is None else stdout, stderr=theirs, **options)
    os.close(theirs)
    shown = b""
    while True:
        try:
            shown += os.read(ours, 4096)
        except OSError:
            break
    os.close(ours)
    process.wait()
    return shown.decode()
