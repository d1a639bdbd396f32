"""The effects' names for the help, read from their files: importing them loads torch, and help
comes at once.
"""

import re
from collections.abc import Iterator
from pathlib import Path

EFFECTS = Path(__file__).parents[1] / "effects"


def effects_help() -> str:
    """A line for each effect, in the registry's order: its name, and what it is."""
    return "\n".join(["effects:", *(f"  {name:<18}{_summary(name)}" for name in effect_names())])


def effect_names() -> Iterator[str]:
    """In the registry's order."""
    registry = (EFFECTS / "registry.py").read_text(encoding="utf-8")
    modules = {
        kind: name
        for name, kind in re.findall(
            r"^from calib\.effects\.(\w+) import (\w+)$", registry, re.MULTILINE
        )
    }
    for listed in re.findall(
        r"^(?:EFFECTS|FIELDS): .*? = \((.*?)\)$", registry, re.MULTILINE | re.DOTALL
    ):
        yield from (modules[kind] for kind in re.findall(r"\w+", listed))


def _summary(name: str) -> str:
    """The first words of the module's docstring."""
    first = (EFFECTS / f"{name}.py").read_text(encoding="utf-8").partition("\n")[0]
    return re.split("[:.]", first.strip('"'))[0]
