"""A calibration with every number estimated that is not exact: those, too, that its fit held as
declared, as the views allow that.

In its own medium such a number is as good as exact. In another it may move every ray, so its
tolerance has to be in the covariance.
"""

from dataclasses import replace

import torch

from calib.calibration import Calibration, Declared
from calib.diagnosis.diagnosed import with_fit
from calib.diagnosis.starting_model import model_of
from calib.errors import NotEnoughDataError
from calib.session.freeing import ALL, AUTO, with_free
from calib.threads import single_thread


def all_free(calibration: Calibration) -> Calibration:
    """The calibration itself where nothing was held that is not exact, or where its fit was told
    what to hold.
    """
    declared = calibration.declared
    intrinsics, cover = with_free(declared.intrinsics, declared.cover, (ALL,))
    same = (intrinsics, cover) == (declared.intrinsics, declared.cover)
    if (
        same
        or AUTO not in calibration.settings.get("free", ())
        or not (calibration.views and calibration.covariance.size)
    ):
        return calibration
    freed = replace(calibration, stated=Declared(intrinsics, cover, declared.doubted))
    model, observations = model_of(freed), calibration.observations
    with single_thread():
        joint = model.fit(observations, torch.from_numpy(calibration.poses))
    if not joint.finite:
        raise NotEnoughDataError(joint.outcome.value)
    return with_fit(freed, model, joint, observations)
