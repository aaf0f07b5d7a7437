"""The command ``omniservo``, also as ``python -m omniservo``: ended cleanly also while it is loaded."""

import sys


def main() -> None:
    """Run the command line; Ctrl-C is one message from the first moment on."""
    try:
        from omniservo.cli.main import main as run
    except KeyboardInterrupt:
        print("omniservo: interrupted while loading; nothing was written", file=sys.stderr)  # noqa: T201
        sys.exit(130)
    run()


if __name__ == "__main__":
    main()
