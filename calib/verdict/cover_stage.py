"""The smooth cover as it is declared, against no cover and against the end of the fit."""

from collections.abc import Iterator

import numpy as np

from calib.diagnosis.diagnosed import STAGE
from calib.fitting.declared import comparisons
from calib.session.freeing import AUTO, with_free
from calib.verdict.bare_pictures import taken_through_cover
from calib.verdict.case import Case
from calib.verdict.thresholds import TAKEN_UP, WORSE_THAN_BARE
from calib.verdict.verdict import Reason


def cover_stage(case: Case) -> Iterator[Reason]:
    """Only of numbers that were held: those that are estimated are compared one by one; and only where the lens has no cover in it."""
    cover, bare, last = (case.rms_px.get(name, np.nan) for name in ("cover", "pinhole", "cover+rbf"))
    numbers = [one for one in comparisons(case.calibration) if one.name.startswith("cover.")]
    suspects = tuple(one.name for one in numbers if one.name in ("cover.inner_radius", "cover.distance", "cover.thickness"))
    if taken_through_cover(case) or not all(one.held for one in comparisons(case.calibration)):
        return
    if cover > WORSE_THAN_BARE * bare:
        said = (
            f"the cover as it is described makes the error larger than no cover at all, {cover:.3f} for {bare:.3f} px: check its "
            "numbers in session.yaml."
        )
        yield Reason(said, case.next.fit(), suspects)
    elif cover > TAKEN_UP * last and STAGE not in case.rms_px and not _tried(case):
        said = (
            f"the cover as it is described leaves {cover:.3f} px, and with every number held its unevenness had to explain all but "
            f"{last:.3f} px: a number of the cover or the camera may be wrong, so let the fit estimate them."
        )
        yield Reason(said, case.next.fit("--free", "all"), suspects)


def _tried(case: Case) -> bool:
    """Whether the fit asked if a number is wrong before it held them all."""
    declared = case.calibration.declared
    told = declared.intrinsics, declared.cover
    return AUTO in case.calibration.settings.get("free", ()) and with_free(*told, (AUTO,)) != told
