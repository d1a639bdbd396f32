"""What the session declares against what the views say."""

from collections.abc import Iterator

from calib.fitting.declared import BARE, DECLARED, VIEWS, comparisons
from calib.verdict.case import Case
from calib.verdict.residual import likely_effects
from calib.verdict.verdict import Reason

ADVICE = {
    DECLARED: "measure it again, and correct session.yaml",
    BARE: "take the pictures in bare/ again, with the focus as it is under the cover",
}
"""By how the number was known."""


def declared_numbers(case: Case) -> Iterator[Reason]:
    """The numbers that cannot be as they were known, the farthest first; an estimate that is no
    surer than that, and drifted within both, contradicts nothing. Nor does a lens that these same
    views told, before the rest was fitted.
    """
    if not case.calibration.covariance.size:
        return
    lacking = bool(likely_effects(case))
    wrong = [
        one
        for one in comparisons(case.calibration)
        if one.contradicted and one.corrected and one.source != VIEWS
    ]
    for one in sorted(wrong, key=lambda one: -one.normalised_deviation):
        advice = (
            "find what the model lacks first, which may cause it" if lacking else ADVICE[one.source]
        )
        said = f"{one}, {one.normalised_deviation:.1f} standard deviations apart: {advice}."
        yield Reason(said, case.next.fit(), (one.name,))
