"""The fit has not ended where it should."""

from collections.abc import Iterator

import numpy as np

from calib.estimation.levenberg_marquardt import Outcome
from calib.verdict.case import Case
from calib.verdict.thresholds import STATIONARY
from calib.verdict.verdict import Reason, Word


def not_finite(case: Case) -> Iterator[Reason]:
    """Nothing that it left can be judged."""
    arrays = (
        case.calibration.poses,
        case.calibration.amplitudes,
        np.array(list(case.rms_px.values())),
    )
    if _outcome(case) == Outcome.NOT_FINITE.value or not all(
        np.isfinite(array).all() for array in arrays
    ):
        yield Reason(
            _uncapitalised(Outcome.NOT_FINITE.value), case.next.fit(), word=Word.DO_NOT_USE
        )


def not_converged(case: Case) -> Iterator[Reason]:
    """It is finite, and so far from the most probable that it matters; where no more than rounding
    was left to gain, it does not.
    """
    if _outcome(case) == Outcome.CONVERGED.value or case.from_optimum < STATIONARY:
        return
    if _outcome(case) == Outcome.STEPS_USED_UP.value:
        said = (
            "the fit was still improving when its steps were used up: the views hardly tell some"
            " numbers, or the model lacks something."
        )
    else:
        said = _uncapitalised(Outcome.STUCK.value)
    yield Reason(said, case.next.diagnose(), word=Word.DO_NOT_USE)


def _outcome(case: Case) -> str:
    return str(case.calibration.settings.get("outcome", Outcome.CONVERGED.value))


def _uncapitalised(sentence: str) -> str:
    return sentence[0].lower() + sentence[1:]
