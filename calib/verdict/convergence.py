"""Checks: the fit is finite and has converged."""

from collections.abc import Iterator

import numpy as np

from calib.estimation.levenberg_marquardt import Outcome
from calib.verdict.case import Case
from calib.verdict.thresholds import STATIONARY
from calib.verdict.verdict import Reason, Trust, uncapitalised


def not_finite(case: Case) -> Iterator[Reason]:
    """Check that the fit is finite; otherwise no other check is possible."""
    arrays = (
        case.calibration.poses,
        case.calibration.amplitudes,
        np.array(list(case.rms_px.values())),
    )
    if _outcome(case) == Outcome.NOT_FINITE.value or not all(
        np.isfinite(array).all() for array in arrays
    ):
        yield Reason(
            uncapitalised(Outcome.NOT_FINITE.value), case.next.fit(), word=Trust.DO_NOT_USE
        )


def not_converged(case: Case) -> Iterator[Reason]:
    """Check that the fit is close to the optimum, compared with its standard deviations."""
    if _outcome(case) == Outcome.CONVERGED.value or case.from_optimum < STATIONARY:
        return
    if _outcome(case) == Outcome.STEPS_USED_UP.value:
        sentence = (
            "the fit was still improving when its steps were used up: the views hardly determine"
            " some numbers, or the model lacks something."
        )
    else:
        sentence = uncapitalised(Outcome.STUCK.value)
    yield Reason(sentence, case.next.diagnose(), word=Trust.DO_NOT_USE)


def _outcome(case: Case) -> str:
    joint = case.calibration.outcome.joint
    return joint.outcome if joint else Outcome.CONVERGED.value
