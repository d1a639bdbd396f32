"""What a person should know before trusting a fit."""

import numpy as np

from calib.calibration import Calibration
from calib.estimation.levenberg_marquardt import Outcome
from calib.fitting.cross_validation import CrossValidation
from calib.fitting.declared import Comparison, comparisons


def remarks(calibration: Calibration) -> list[str]:
    """A sentence each."""
    said = []
    errors = {stage.name: stage.rms_px for stage in calibration.stages}
    if errors.get("cover", 0.0) > 1.5 * errors["pinhole"]:
        said.append("the cover as it is described makes the error larger than no cover at all: check its numbers in session.yaml.")
    if calibration.settings.get("outcome", Outcome.CONVERGED.value) != Outcome.CONVERGED.value:
        said.append(str(calibration.settings["outcome"]))
    for one in _contradicted(calibration):
        said.append(f"{one}, {one.apart:.1f} standard deviations apart: measure it again, and correct session.yaml.")
    validation = calibration.settings.get("cross_validation")
    if validation and CrossValidation(**validation).overfits:
        said.append("the fit overfits, views that it has not seen are much further off: take more views, or choose a coarser --grid.")
    last = calibration.stages[-1].rms_px
    if np.isfinite(calibration.noise_px) and last > 2 * calibration.noise_px:
        said.append(
            f"{last:.3f} px are left where the corners' noise is about {calibration.noise_px:.3f} px: the model lacks something, or the "
            "board, cover or intrinsics are not as described."
        )
    return said


def _contradicted(calibration: Calibration) -> list[Comparison]:
    """The numbers that cannot be as they are declared, the farthest first."""
    found = [one for one in comparisons(calibration) if one.contradicted] if calibration.covariance.size else []
    return sorted(found, key=lambda one: -one.apart)
