"""Check: the declared numbers against the views."""

from collections.abc import Iterator

from calib.fitting.declared import BARE, DECLARED, VIEWS, comparisons
from calib.verdict.case import Case
from calib.verdict.residual import likely_effects
from calib.verdict.verdict import Reason

ADVICE = {
    DECLARED: "measure it again, and correct session.yaml",
    BARE: "take the pictures in bare/ again, with the focus as it is under the cover",
}
"""Advice by the source of the number."""


def declared_numbers(case: Case) -> Iterator[Reason]:
    """Report declared values that the data contradict, the largest deviation first.

    An estimate that is no more precise than the declaration contradicts nothing. A lens estimated
    from the same views is not evidence against them.
    """
    if not case.calibration.covariance.size:
        return
    model_lacks = bool(likely_effects(case))
    contradicted = [
        number
        for number in comparisons(case.calibration)
        if number.contradicted and number.corrected and number.source != VIEWS
    ]
    for number in sorted(contradicted, key=lambda number: -number.normalised_deviation):
        advice = (
            "find what the model lacks first, which may cause it"
            if model_lacks
            else ADVICE[number.source]
        )
        sentence = (
            f"{number}, {number.normalised_deviation:.1f} standard deviations apart: {advice}."
        )
        yield Reason(sentence, case.next.fit(), (number.name,))
