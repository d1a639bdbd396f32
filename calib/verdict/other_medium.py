"""Check: a calibration that was converted to another medium has no views there."""

from collections.abc import Iterator

from calib.verdict.case import Case
from calib.verdict.thresholds import HELD_OUT
from calib.verdict.verdict import Reason


def other_medium(case: Case) -> Iterator[Reason]:
    noise, evaluation = case.calibration.noise_px, case.evaluation
    check = case.next.check(case.holdout)
    if evaluation is None:
        sentence = (
            "none of its views were taken in the medium that it is for: a few pictures of the board"
            " taken there say whether it holds."
        )
        yield Reason(sentence, check)
    elif noise is not None and evaluation.rms_px > HELD_OUT * noise:
        sentence = (
            f"views there have {evaluation.rms_px:.3f} px where corners have {noise:.3f} px of"
            " noise: calib check says whether that is more than this calibration's own uncertainty."
        )
        yield Reason(sentence, check)
