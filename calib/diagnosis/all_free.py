"""A calibration with all inexact numbers estimated, including those that its fit held at their
declared values.

In the medium of the views, such a number may be held. In another medium it may move every ray, so
its tolerance must be in the covariance. A fit also holds numbers because its model lacks
something; once a diagnosis has added that, they can be estimated.
"""

from dataclasses import replace

from calib.calibration import Calibration
from calib.calibration_content import Declared
from calib.errors import NotEnoughDataError
from calib.fitting.fit_result import with_fit
from calib.inference.calibration_model import fit_again, full_model
from calib.session.freeing import ALL, AUTO, free_parameters
from calib.threads import single_thread


def all_free(calibration: Calibration) -> Calibration:
    """Return the refitted calibration, or the same one if there is nothing to free."""
    freed = with_all_free(calibration)
    if freed is calibration:
        return calibration
    model, observations = full_model(freed), calibration.observations
    with single_thread():
        joint = fit_again(freed, model)
    if not joint.finite:
        raise NotEnoughDataError(joint.outcome.value)
    return with_fit(freed, model, joint, observations)


def with_all_free(calibration: Calibration) -> Calibration:
    """Return the calibration with a tolerance for every inexact number, for another fit; the same
    one if only exact numbers were held, or if the user chose the numbers to hold.
    """
    declared = calibration.declared
    intrinsics, cover = free_parameters(declared.intrinsics, declared.cover, (ALL,))
    is_unchanged = (intrinsics, cover) == (declared.intrinsics, declared.cover)
    if (
        is_unchanged
        or AUTO not in calibration.request.free
        or not (calibration.views and calibration.covariance.size)
    ):
        return calibration
    return replace(calibration, stated=Declared(intrinsics, cover, declared.doubted))
