"""Paths that a person types where no shell expands them."""

import os.path
from pathlib import Path


def expand_typed_path(text: str) -> Path:
    """Return the path with `~` replaced by the home folder, or unchanged where there is no such
    home.
    """
    # Path.expanduser raises where there is no such home
    return Path(os.path.expanduser(text))  # noqa: PTH111
