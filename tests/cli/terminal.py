"""What a terminal shows of a command."""

import os
import pty
import re
import select
import subprocess
import time


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


_COLOUR = re.compile(rb"\x1b\[[0-9;]*m")


def answered_on_terminal(command, question, answer, look=0.5):
    """Answer a command's question as a person does; return what is shown before, meanwhile, and after.

    Args:
        command: its input, output and standard error are the terminal.
        question: how it ends on the terminal.
        answer: is typed after it stood for so long.
        look: [s]
    """
    ours, theirs = pty.openpty()
    named = os.environ | {"TERM": "xterm"}
    process = subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs, env=named)
    os.close(theirs)
    before, meanwhile, after = b"", b"", b""
    while not _COLOUR.sub(b"", before).endswith(question):
        before += os.read(ours, 4096)
    end = time.monotonic() + look
    while select.select([ours], [], [], max(end - time.monotonic(), 0.0))[0]:
        meanwhile += os.read(ours, 4096)
        if time.monotonic() > end:
            break
    os.write(ours, answer)
    while True:
        try:
            after += os.read(ours, 4096)
        except OSError:
            break
    os.close(ours)
    process.wait()
    return before.decode(), meanwhile.decode(), after.decode()
