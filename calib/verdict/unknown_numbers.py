"""Checks: unknown numbers that these views do not determine, or that end far off."""

from collections.abc import Iterator, Sequence

from calib.apply.map_uncertainty import map_sigmas
from calib.effects.flat_port import FlatPort
from calib.fitting.declared import Comparison, comparisons
from calib.session.parameter_names import CAMERA
from calib.session.shapes.layer import AIR, medium_word
from calib.session.shapes.registry import find_shape
from calib.verdict.case import Case
from calib.verdict.uncertainty import reached_depths
from calib.verdict.verdict import Reason


def unknown_shape(case: Case) -> Iterator[Reason]:
    """Name the shapes that are about as probable as the one that the fit chose. The maps hold where
    those of another shape differ by no more than their own largest standard deviation.
    """
    chosen, *rivals = case.calibration.outcome.probable_shapes or ("",)
    if not rivals:
        yield from _unseen_cover(case)
        return
    changes = case.calibration.outcome.shape_map_changes_px or {}
    names = dict.fromkeys((chosen, *rivals, *changes))
    listed = " or ".join(find_shape(name).words for name in names)
    change = max(changes.values(), default=0.0)
    sigmas = map_sigmas(case.calibration, reached_depths(case.calibration))
    maps_hold = bool(changes) and change <= max(sigmas.values(), default=0.0)
    comparison = ", no more than their sigma" if maps_hold else ""
    maps = f" With another the maps change by up to {change:.2g} px{comparison}." if changes else ""
    request = "If you need the numbers, look" if maps_hold else "Look"
    sentence = (
        f"your pictures fit {listed} about equally well. The fit assumed"
        f" {find_shape(chosen).words}.{maps} {request} at the cover, and"
        f" {case.next.name_cover(names)}."
    )
    command = _use(case) if maps_hold else case.next.fit()
    yield Reason(sentence, command, ("cover.shape",), maps_hold=maps_hold)


def _use(case: Case) -> str:
    """Return the command that uses the maps, which are as good as they say."""
    uses = case.next.uses(case.main_depth, mapped=case.main_depth in case.depths)
    return next(iter(uses), case.next.capture())


def _unseen_cover(case: Case) -> Iterator[Reason]:
    """Name the shapes that explain the pictures as well as no cover, if the maps depend on it by
    more than their standard deviation.
    """
    changes = case.calibration.outcome.shape_map_changes_px or {}
    sigma = max(map_sigmas(case.calibration, case.usual_depths).values(), default=0.0)
    rivals = {name: change for name, change in changes.items() if change > sigma}
    has_window = any(isinstance(added.effect, FlatPort) for added in case.calibration.effects)
    if not rivals or has_window:
        return
    listed = " or ".join(find_shape(name).words for name in rivals)
    sentence = (
        f"these pictures do not show a cover: {listed} explains them as well, and the maps would"
        f" differ by {max(rivals.values()):.2g} px. If there is a cover, write its shape in"
        f" {case.next.description}, with its numbers, and look whether outside_index is right: 1 in"
        " air, 1.333 in water."
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
            " hide an error of another kind: measure one of these numbers, and write it in"
            f" {case.next.description}."
        )
        yield Reason(sentence, case.next.fit(), tuple(number.name for number in unusual))
    numbers = [number for number in compared if number.is_open and not number.is_unusual]
    if not numbers:
        return
    listed = ", ".join(f"{number.name} ({number.estimated})" for number in numbers)
    is_lens = all(number.name.startswith(CAMERA.of("")) for number in numbers)
    advice = (
        "take pictures of the board at the picture's edges, near and tilted, or without the cover,"
        " in bare/"
        if is_lens
        else "measure it: in air, more pictures hardly show it"
        if _is_centre_in_air(case, numbers)
        else "measure it, or take pictures of the board near and tilted"
    )
    sentence = (
        f"your pictures do not determine {listed}: the sigma of the maps includes this. If you need"
        f" the number itself, {advice}."
    )
    yield Reason(sentence, _use(case), tuple(number.name for number in numbers), maps_hold=True)


def _is_centre_in_air(case: Case, numbers: Sequence[Comparison]) -> bool:
    """Return True if all of these numbers are those of the centre of a dome in air. Its wall bends
    a ray by so little that they act like a turn of the camera.
    """
    medium = case.calibration.declared.cover.medium
    in_air = medium is not None and medium_word(medium.value) == AIR
    return in_air and all(".centre." in number.name for number in numbers)
