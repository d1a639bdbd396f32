"""What an effect is, in a few plain words for people to whom its name says little."""

import re
import sys

from calib.effects.registry import KINDS


def plainly(name: str) -> str:
    """A sentence: the first clause of what the effect's own file says of it."""
    kind = next(kind for kind in KINDS if kind.name == name)
    said = re.split(r"[:,.]", sys.modules[kind.__module__].__doc__ or "")[0]
    return f"{' '.join(said.split())}." if said else ""
