"""`python -m capture` is the command."""

import sys

from capture.cli import main

if __name__ == "__main__":  # a process that this one starts looks in here first
    sys.exit(main())
