"""Views that the fit has not seen: of its own folds, and of an evaluation."""

from collections.abc import Iterator

from calib.fitting.cross_validation import CrossValidation
from calib.verdict.case import Case
from calib.verdict.depths import trusted_depths
from calib.verdict.thresholds import HELD_OUT
from calib.verdict.verdict import Reason


def overfits(case: Case) -> Iterator[Reason]:
    kept = case.calibration.settings.get("cross_validation")
    if kept and (validation := CrossValidation(**kept)).overfits:
        said = (
            "the fit overfits, views that it has not seen are much further off"
            f" ({validation.held_out_px:.3f} px for {validation.fitted_px:.3f} px): take more"
            " views, or choose a coarser grid."
        )
        yield Reason(said, case.next.fit("--grid", "auto"))


def held_out(case: Case) -> Iterator[Reason]:
    found = case.evaluation
    if not found:
        return
    near, far = case.reach
    nearest, farthest = trusted_depths(near, far)
    outside = found.near_m < nearest or found.far_m > farthest
    if found.rms_px > HELD_OUT * case.left_px:
        where = (
            ", some of them at depths of which the calibration's do not speak" if outside else ""
        )
        said = (
            f"views that were not fitted have {found.rms_px:.3f} px where the fitted ones have"
            f" {case.left_px:.3f} px{where}: the model lacks something, or these views are of"
            " another setup."
        )
        yield Reason(said, case.next.diagnose("--holdout", case.holdout))
    elif outside:
        said = (
            f"the views that it was measured with are {found.near_m:.2g} to {found.far_m:.2g} m"
            f" away, and its own {near:.2g} to {far:.2g} m: it was"
            " not made for all of these depths."
        )
        yield Reason(said, case.next.capture())
