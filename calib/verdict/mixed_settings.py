"""Check: the pictures are of one camera in one state, by their names, their EXIF and frames.csv."""

from collections.abc import Iterator

from calib.verdict.case import Case
from calib.verdict.verdict import Reason


def mixed_settings(case: Case) -> Iterator[Reason]:
    for sentence in case.calibration.outcome.mixed_settings:
        yield Reason(sentence, case.next.fit(), ("camera",))
