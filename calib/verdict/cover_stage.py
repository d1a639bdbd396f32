"""Checks: the smooth declared cover against no cover, and against the final fit."""

from collections.abc import Iterator

from calib.fitting.declared import comparisons
from calib.fitting.fit_result import EFFECTS_STAGE
from calib.session.freeing import AUTO, free_parameters
from calib.session.numbers import camera_numbers
from calib.session.parameter_names import THICKNESS, number_of
from calib.session.shapes.registry import find_shape
from calib.verdict.bare_pictures import taken_through_cover
from calib.verdict.case import Case
from calib.verdict.thresholds import NO_BETTER, REFUTED, TAKEN_UP, WORSE_THAN_BARE
from calib.verdict.verdict import Reason, Trust


def worse_than_none(case: Case) -> Iterator[Reason]:
    """Check that the cover lowers the error. Otherwise other findings only compensate for it, so
    this reason comes first.

    With all numbers held, the smooth cover must not be much worse than none. Estimated numbers may
    be off at first, within their tolerances: there the fit with a cover must explain more.
    """
    if "cover" not in case.rms_px:
        return
    if is_refuted(case):
        sentence = (
            "the camera alone, with the lens that suits the pictures, explains them better"
            f" ({case.rms_px['pinhole']:.3f} px) than it does behind this cover"
            f" ({case.rms_px['cover+rbf']:.3f} px): the cover has another shape or size, or the"
            " pictures were not taken through it."
        )
        yield Reason(sentence, case.next.fit(), ("cover.shape",), Trust.DO_NOT_USE)
        return
    cover = case.rms_px["cover"]
    bare = case.rms_px["pinhole"]
    last = case.rms_px.get("cover+rbf", cover)
    if taken_through_cover(case) or not cover > WORSE_THAN_BARE * bare:
        return
    if _all_held(case):
        comparison = (
            f"the cover as it is described makes the error larger than no cover at all, {cover:.3f}"
            f" for {bare:.3f} px"
        )
    elif last > NO_BETTER * bare:
        comparison = (
            "the cover, even with the numbers that the fit found, explains no more than no cover"
            f" at all, {last:.3f} for {bare:.3f} px"
        )
    else:
        return
    sentence = (
        f"{comparison}: check its numbers in {case.next.description}, their signs too, and that the"
        " pictures were taken through it."
    )
    yield Reason(sentence, case.next.fit(), _suspects(case))


def cover_stage(case: Case) -> Iterator[Reason]:
    """Check that the relief does not absorb errors of held numbers."""
    if not {"cover", "cover+rbf"} <= case.rms_px.keys():
        return
    cover = case.rms_px["cover"]
    bare = case.rms_px["pinhole"]
    last = case.rms_px["cover+rbf"]
    absorbed = cover > TAKEN_UP * last and not cover > WORSE_THAN_BARE * bare
    if _all_held(case) and absorbed and EFFECTS_STAGE not in case.rms_px and not _was_tested(case):
        sentence = (
            f"with the cover as described the error is {cover:.3f} px. No number was fitted, so"
            f" that only uneven glass could lower it, to {last:.3f} px: a number of the cover or"
            " the camera may be wrong, so let the fit estimate them."
        )
        yield Reason(sentence, case.next.fit("--free", "all"), _suspects(case))


def is_refuted(case: Case) -> bool:
    """Return True if the lens was unknown, and the cover with its fitted numbers leaves a larger
    error than the lens that suits the pictures best without a cover. A cover that nobody can see
    leaves the same error.
    """
    lens = camera_numbers(case.calibration.declared.intrinsics).values()
    return (
        any(number.unknown for number in lens)
        and case.rms_px.get("cover+rbf", 0.0) > REFUTED * case.rms_px["pinhole"]
    )


def _all_held(case: Case) -> bool:
    """Return True if all numbers were held and the lens does not contain the cover. Estimated
    numbers are compared one by one instead.
    """
    return not taken_through_cover(case) and all(
        number.held for number in comparisons(case.calibration)
    )


def _suspects(case: Case) -> tuple[str, ...]:
    """Return the names of the cover's size or distance, and of the glass's thickness."""
    cover = case.calibration.cover
    sizes = [kind for single in cover.covers for kind in find_shape(single.shape).dimensions[:1]]
    usual = {*(name for kind in sizes for name in kind.quantity.names), THICKNESS}
    return tuple(name for name in cover.dimensions if number_of(name) in usual)


def _was_tested(case: Case) -> bool:
    """Return True if the fit tested the numbers before it held them all."""
    declared = case.calibration.declared
    numbers = declared.intrinsics, declared.cover
    return AUTO in case.calibration.request.free and free_parameters(*numbers, (AUTO,)) != numbers
