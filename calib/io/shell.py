"""Paths and command lines as a person types them in a shell."""

import shlex
from pathlib import Path


def from_here(path: Path) -> Path:
    """Return a path relative to the current folder if it lies below it; else as it is."""
    here = Path.cwd()
    return path.relative_to(here) if path.is_relative_to(here) else path


def path_word(path: Path | str) -> str:
    """Return a path as an argument of a command: with ./ before a name that begins with a dash,
    which the command would take for an option.
    """
    text = str(path)
    return f"./{text}" if text.startswith("-") else text


def shell_path(path: Path | str) -> str:
    """Return a path as an argument of a command, quoted for a shell."""
    return shlex.quote(path_word(path))


def shell_line(*words: Path | str) -> str:
    """Return a command line of these words; those that are of type Path are written as paths."""
    return " ".join(
        shell_path(word) if isinstance(word, Path) else shlex.quote(word) for word in words
    )
