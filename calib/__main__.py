"""`python -m calib` and the script `calib` are the command."""

import sys
from importlib import import_module


def run(program: str = "calib") -> int:
    """Run a program of this project, `calib` or `capture`, with the arguments of this process and
    return its exit code. Ctrl-C during the imports, which take a tenth of a second, ends it as
    later: without a traceback.
    """
    try:
        code: int = import_module(f"{program}.cli").main()
    except KeyboardInterrupt:
        print(f"{program}: interrupted.", file=sys.stderr)
        return 130
    return code


if __name__ == "__main__":  # a process that this one starts looks in here first
    sys.exit(run())
