"""A short plain description of an effect, for people who do not know it by its name."""

from calib.effects.registry import KINDS
from calib.effects.varying import MANNERS, VARYING_NUMBERS


def describe_effect(name: str, varies: str | None = None) -> str:
    """Return the sentence that describes the effect of this name, whose numbers differ from view to
    view in this way.
    """
    kind = next(kind for kind in KINDS if kind.name == name)
    if not varies or kind.varies:
        return kind.description
    numbers = VARYING_NUMBERS[name]
    return f"{numbers[0].upper()}{numbers[1:]} {MANNERS[varies]}."
