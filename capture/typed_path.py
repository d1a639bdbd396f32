"""Paths as a person types them, where no shell has seen them first."""

import os.path
from pathlib import Path


def typed_path(text: str) -> Path:
    """With `~` as the home; as it stands where there is no such home."""
    return Path(os.path.expanduser(text))  # noqa: PTH111 - Path.expanduser raises where there is none
