"""A short plain description of an effect, for people who do not know it by its name."""

from calib.effects.registry import KINDS


def describe_effect(name: str) -> str:
    """Return the sentence that describes the effect of this name."""
    return next(kind for kind in KINDS if kind.name == name).description
