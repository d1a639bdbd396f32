"""The smooth cover as it is declared, against no cover and against the end of the fit."""

from collections.abc import Iterator

import numpy as np

from calib.fitting.declared import comparisons
from calib.fitting.fit_result import EFFECTS_STAGE
from calib.session.freeing import AUTO, free_parameters
from calib.verdict.bare_pictures import taken_through_cover
from calib.verdict.case import Case
from calib.verdict.thresholds import TAKEN_UP, WORSE_THAN_BARE
from calib.verdict.verdict import Reason


def worse_than_none(case: Case) -> Iterator[Reason]:
    """What else is found then only makes up for it: this comes first."""
    cover, bare = (case.rms_px.get(name, np.nan) for name in ("cover", "pinhole"))
    if _told_apart(case) and cover > WORSE_THAN_BARE * bare:
        said = (
            f"the cover as it is described makes the error larger than no cover at all, {cover:.3f}"
            f" for {bare:.3f} px: check its numbers in session.yaml, their signs too."
        )
        yield Reason(said, case.next.fit(), _suspects(case))


def cover_stage(case: Case) -> Iterator[Reason]:
    cover, bare, last = (
        case.rms_px.get(name, np.nan) for name in ("cover", "pinhole", "cover+rbf")
    )
    taken_up = cover > TAKEN_UP * last and not cover > WORSE_THAN_BARE * bare
    if _told_apart(case) and taken_up and EFFECTS_STAGE not in case.rms_px and not _tried(case):
        said = (
            f"the cover as it is described leaves {cover:.3f} px, and with every number held its"
            f" unevenness had to explain all but {last:.3f} px: a number of the cover or the camera"
            " may be wrong, so let the fit estimate them."
        )
        yield Reason(said, case.next.fit("--free", "all"), _suspects(case))


def _told_apart(case: Case) -> bool:
    """Only of numbers that were held: those that are estimated are compared one by one; and only
    where the lens has no cover in it.
    """
    return not taken_through_cover(case) and all(one.held for one in comparisons(case.calibration))


def _suspects(case: Case) -> tuple[str, ...]:
    most = ("cover.inner_radius", "cover.distance", "cover.thickness")
    return tuple(one.name for one in comparisons(case.calibration) if one.name in most)


def _tried(case: Case) -> bool:
    """Whether the fit asked if a number is wrong before it held them all."""
    declared = case.calibration.declared
    told = declared.intrinsics, declared.cover
    return (
        AUTO in case.calibration.settings.get("free", ())
        and free_parameters(*told, (AUTO,)) != told
    )
