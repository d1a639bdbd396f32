"""`python -m capture` and the script `capture` are the command."""

import sys


def run() -> int:
    """Run `capture` with the arguments of this process and return its exit code. Ctrl-C during the
    imports, which take a tenth of a second, ends it as later: without a traceback.
    """
    try:
        from capture.cli import main

        return main()
    except KeyboardInterrupt:
        print("capture: interrupted.", file=sys.stderr)
        return 130


if __name__ == "__main__":  # a process that this one starts looks in here first
    sys.exit(run())
