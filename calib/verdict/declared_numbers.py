"""What the session declares against what the views say."""

from collections.abc import Iterator

from calib.fitting.declared import comparisons
from calib.verdict.case import Case
from calib.verdict.verdict import Reason


def declared_numbers(case: Case) -> Iterator[Reason]:
    """The numbers that cannot be as they are declared, the farthest first."""
    if not case.calibration.covariance.size:
        return
    for one in sorted((one for one in comparisons(case.calibration) if one.contradicted), key=lambda one: -one.apart):
        said = f"{one}, {one.apart:.1f} standard deviations apart: measure it again, and correct session.yaml."
        yield Reason(said, case.next.fit(), (one.name,))
