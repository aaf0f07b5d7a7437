"""A command as a user gives it."""

from tests.cli.valid_output import check_output

from omniservo.cli.main import main


def call(capsys, *arguments):
    """Exit code, standard output and standard error of one command; its JSON is what its schema says."""
    try:
        main([str(a) for a in arguments])
        code = 0
    except SystemExit as end:
        code = end.code or 0
    captured = capsys.readouterr()
    if "--json" in arguments and captured.out:
        check_output(captured.out)
    return code, captured.out, captured.err
