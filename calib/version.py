"""The version of both packages: what `--version` prints, calibrations keep, and pyproject.toml
builds.
"""

VERSION = "0.1.0"
