"""Paths and command lines as a person types them in a shell."""

import os
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
    r"""Return a path as an argument of a command, quoted for a shell. Control characters and bytes
    that are not UTF-8 stand as escapes in $'...', which bash and zsh understand.
    """
    word = path_word(path)
    if word.isprintable():
        return shlex.quote(word)
    escaped = word.replace("\\", "\\\\").replace("'", "\\'")
    return f"$'{''.join(c if c.isprintable() else _octal(c) for c in escaped)}'"


def _octal(character: str) -> str:
    r"""Return the bytes of a character in the escapes of a shell, such as \012."""
    return "".join(f"\\{byte:03o}" for byte in os.fsencode(character))


def shell_line(*words: Path | str) -> str:
    """Return a command line of these words; those that are of type Path are written as paths."""
    return " ".join(
        shell_path(word) if isinstance(word, Path) else shlex.quote(word) for word in words
    )
