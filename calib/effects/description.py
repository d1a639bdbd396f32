"""A short plain description of an effect, for people who do not know it by its name."""

from collections.abc import Iterator, Sequence

from calib.effects.registry import KINDS
from calib.effects.varying import MANNERS, VARYING_NUMBERS, Varying
from calib.io.exif import list_names
from calib.session.shapes.layer import MEDIA, opposite_medium


def describe_effect(name: str, varies: str | None = None) -> str:
    """Return the sentence that describes the effect of this name, whose numbers differ from view to
    view in this way.
    """
    kind = next(kind for kind in KINDS if kind.name == name)
    if not varies or kind.varies:
        return kind.description
    numbers = VARYING_NUMBERS[name]
    return f"{numbers[0].upper()}{numbers[1:]} {MANNERS[varies]}."


def describe_media(effect: Varying, views: Sequence[str]) -> str:
    """Return sentences that say which of the views of these names were taken in the other medium,
    and which medium the maps are for.
    """
    names = [name for name, step in zip(views, effect.pattern, strict=True) if step]
    stated = opposite_medium(MEDIA[effect.other_medium])
    return (
        f"{list_names(names)} {'were' if len(names) > 1 else 'was'} taken in"
        f" {effect.other_medium}, the other pictures in {stated}. The maps are for {stated}."
    )


def number_legend(effect: str, numbers: Sequence[str]) -> Iterator[str]:
    """Yield lines that explain numbers of an effect, such as board_shape.xx: one for each number
    with words of its own, one for all others, or else the description of the effect.
    """
    legend = next(kind for kind in KINDS if kind.name == effect).legend
    if not legend:
        yield f"{effect}: {describe_effect(effect)}"
        return
    further = []
    for number in numbers:
        if words := legend.get(number.removeprefix(f"{effect}.")):
            yield f"{number}: {words}"
        else:
            further.append(number)
    if further:
        name = further[0] if len(further) == 1 else f"{further[0]} to {further[-1]}"
        yield f"{name}: {legend['']}"
