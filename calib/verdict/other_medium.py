"""A calibration that was put into another medium, where it has no views of its own."""

from collections.abc import Iterator

from calib.verdict.case import Case
from calib.verdict.thresholds import HELD_OUT
from calib.verdict.verdict import Reason


def other_medium(case: Case) -> Iterator[Reason]:
    noise, found = case.calibration.noise_px, case.evaluation
    check = case.next.check(case.holdout)
    if found is None:
        said = (
            "none of its views were taken in the medium that it is for: a few pictures of the board"
            " taken there say whether it holds."
        )
        yield Reason(said, check)
    elif found.rms_px > HELD_OUT * noise:
        said = (
            f"views there have {found.rms_px:.3f} px where corners have {noise:.3f} px of noise:"
            " calib check says whether that is more than this calibration's own uncertainty."
        )
        yield Reason(said, check)
