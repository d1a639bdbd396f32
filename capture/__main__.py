"""`python -m capture` is the command."""

import sys

from capture.cli import main

sys.exit(main())
