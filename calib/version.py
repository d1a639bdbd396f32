"""The version of both packages, which `--version` prints, calibrations record, and pyproject.toml
reads.
"""

VERSION = "0.1.0"
