"""`python -m calib` is the command."""

import sys

from calib.cli import main

sys.exit(main())
