"""Check: the views, and the corners of the board, scatter about the fit as noise does."""

from collections.abc import Iterator

from calib.verdict.case import Case
from calib.verdict.thresholds import SCATTER
from calib.verdict.verdict import Reason


def scatter(case: Case) -> Iterator[Reason]:
    """Report a model that lacks something, though its standard deviations allow for it."""
    uncertainty = case.calibration.outcome.uncertainty
    if uncertainty is None:
        return
    diagnosed = case.calibration.history.diagnosis is not None
    command = case.next.report() if diagnosed else case.next.diagnose()
    if uncertainty.view_scatter > SCATTER:
        yield Reason(
            f"the views scatter {uncertainty.view_scatter:.1f} times as much about the fit as noise"
            " does: something differs between them, or the model lacks something. Every sigma"
            " includes this scatter.",
            command,
        )
    if uncertainty.corner_scatter > SCATTER:
        yield Reason(
            f"the corners of the board scatter {uncertainty.corner_scatter:.1f} times as much about"
            " the fit as noise does: the print is uneven, or the board is not flat.",
            command,
        )
