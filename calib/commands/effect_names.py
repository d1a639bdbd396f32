"""The effects' names and descriptions for the help. They are read from the source files, because an
import of the effects loads torch, and help must come at once.
"""

import re
from collections.abc import Iterator
from pathlib import Path

EFFECTS = Path(__file__).parents[1] / "effects"


def effects_help() -> str:
    """Return a line for each effect, in the registry's order: its name and its description."""
    return "\n".join(
        ["effects:", *(f"  {name:<18}{_summary(name)}" for name in registered_names())]
    )


def effect_names_help() -> str:
    """Return the effects' names alone, and the command whose help describes them."""
    return f"effects: {', '.join(registered_names())}. `calib diagnose --help-all` describes them."


def registered_names() -> Iterator[str]:
    """Yield the names in the registry's order."""
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
    """Return the effect's description without its full stop."""
    source = (EFFECTS / f"{name}.py").read_text(encoding="utf-8")
    description = re.search(r'description: ClassVar\[str\] = \(?\s*"(.*)\."', source)
    return description[1] if description else ""
