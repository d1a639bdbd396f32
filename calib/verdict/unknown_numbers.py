"""Checks: unknown numbers that these views do not determine, or that end far off."""

from collections.abc import Iterator

from calib.fitting.declared import comparisons
from calib.session.shapes.registry import find_shape
from calib.verdict.case import Case
from calib.verdict.verdict import Reason


def unknown_shape(case: Case) -> Iterator[Reason]:
    """Name the shapes that are about as probable as the one that the fit chose."""
    chosen, *rivals = case.calibration.outcome.probable_shapes or ("",)
    if not rivals:
        return
    listed = " or ".join(find_shape(name).words for name in (chosen, *rivals))
    sentence = (
        f"your pictures fit {listed} about equally well. The fit assumed"
        f" {find_shape(chosen).words}. Look at the cover, and write cover.shape in session.yaml."
    )
    yield Reason(sentence, case.next.fit(), ("cover.shape",))


def unknown_numbers(case: Case) -> Iterator[Reason]:
    """Name the unknown numbers that are far outside of their stated range, and those whose standard
    deviation is about that of their wide prior.
    """
    compared = list(comparisons(case.calibration))
    unusual = [number for number in compared if number.is_unusual]
    if unusual:
        listed = ", ".join(f"{number.name} ({number.estimated})" for number in unusual)
        sentence = (
            f"these estimates are far outside of the usual range: {listed}. An unknown number can"
            " hide an error of another kind: measure one of them, and write it in session.yaml."
        )
        yield Reason(sentence, case.next.fit(), tuple(number.name for number in unusual))
    numbers = [number for number in compared if number.is_open and not number.is_unusual]
    if not numbers:
        return
    listed = ", ".join(f"{number.name} ({number.estimated})" for number in numbers)
    sentence = (
        f"your pictures do not determine {listed}. The maps already allow for that. If you need"
        " the number, measure it, or take pictures of the board near and tilted."
    )
    yield Reason(sentence, case.next.capture(), tuple(number.name for number in numbers))
