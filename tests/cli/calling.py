"""A command as a user gives it."""

from omniservo.cli.main import main


def call(capsys, *arguments):
    """Exit code, standard output and standard error of one command."""
    try:
        main([str(a) for a in arguments])
        code = 0
    except SystemExit as end:
        code = end.code or 0
    captured = capsys.readouterr()
    return code, captured.out, captured.err
