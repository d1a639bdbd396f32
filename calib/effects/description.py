"""A short plain description of an effect, for people who do not know it by its name."""

import re
import sys

from calib.effects.registry import KINDS


def describe_effect(name: str) -> str:
    """Return a sentence: the first clause of the docstring of the effect's module."""
    kind = next(kind for kind in KINDS if kind.name == name)
    clause = re.split(r"[:,.]", sys.modules[kind.__module__].__doc__ or "")[0]
    return f"{' '.join(clause.split())}." if clause else ""
