"""Check: the pictures are of one camera in one state, by their names, their EXIF and frames.csv."""

from collections.abc import Iterator

from calib.verdict.case import Case
from calib.verdict.verdict import Reason

MIN_MISFITS, MISFIT_SHARE = 3, 0.2
"""The number of views that do not fit, and their share, from which on the session is doubted."""


def mixed_settings(case: Case) -> Iterator[Reason]:
    for sentence in case.calibration.outcome.mixed_settings:
        yield Reason(sentence, case.next.fit(), ("camera",))


def misfits(case: Case) -> Iterator[Reason]:
    """Doubt a session of which a good part does not fit the remaining views, and nothing else says
    why.
    """
    calibration = case.calibration
    count = sum(picture.is_misfit for picture in calibration.rejected)
    total = len(calibration.views) + count
    if calibration.outcome.mixed_settings or count < max(MIN_MISFITS, MISFIT_SHARE * total):
        return
    yield Reason(
        f"{count} of {total} views do not fit the others and are not used: they may be of another"
        " camera, zoom or board, or blurred in part, as by dirt or fog on the glass. Keep the views"
        " of one kind in the session.",
        case.next.fit(),
        ("camera",),
    )
