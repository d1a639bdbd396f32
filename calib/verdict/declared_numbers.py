"""What the session declares against what the views say."""

from collections.abc import Iterator

from calib.fitting.declared import comparisons
from calib.verdict.case import Case
from calib.verdict.residual import likely_effects
from calib.verdict.verdict import Reason


def declared_numbers(case: Case) -> Iterator[Reason]:
    """The numbers that cannot be as they are declared, the farthest first; an estimate that is no surer than what is declared, and drifted
    within both, contradicts nothing."""
    if not case.calibration.covariance.size:
        return
    lacking = bool(likely_effects(case))
    advice = "find what the model lacks first, which may cause it" if lacking else "measure it again, and correct session.yaml"
    wrong = [one for one in comparisons(case.calibration) if one.contradicted and one.corrected]
    for one in sorted(wrong, key=lambda one: -one.apart):
        said = f"{one}, {one.apart:.1f} standard deviations apart: {advice}."
        yield Reason(said, case.next.fit(), (one.name,))
