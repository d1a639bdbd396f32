"""Check: enough of the picture has corners."""

from collections.abc import Iterator

from calib.verdict.case import Case
from calib.verdict.thresholds import FEW_CELLS
from calib.verdict.verdict import Reason


def coverage(case: Case) -> Iterator[Reason]:
    if case.covered < FEW_CELLS:
        sentence = (
            f"only {100 * case.covered:.0f} % of the picture has corners: take views with the board"
            " where the picture is empty."
        )
        yield Reason(sentence, case.next.capture())
