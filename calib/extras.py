"""The packages of the optional features, and the command that installs them for the running Python.

The command names the packages themselves, so it also works for a checkout, for a wheel, and for a
copy that was never installed.
"""

import shlex
import sys

EXTRAS = {
    "bags": ("rosbags>=0.11,<1",),
    "completion": ("shtab>=1.9,<2",),
    "exr": ("OpenEXR>=3.3",),
    "fleet": ("cryptography>=42", "dask-jobqueue>=0.9", "distributed>=2024.8", "fsspec>=2024.6"),
    "plots": ("matplotlib>=3.8",),
    "render": ("mitsuba>=3.6,<4",),
    "serve": ("segno>=1.6,<2", "textual-serve>=1.1,<2"),
}
"""The extras of pyproject.toml, except those for developers."""


def how_to_install(extra: str) -> str:
    """Return a command line for the shell, such as /home/pi/refracal/.venv/bin/python -m pip
    install 'textual-serve>=1.1,<2'.
    """
    return shlex.join([sys.executable or "python3", "-m", "pip", "install", *EXTRAS[extra]])
