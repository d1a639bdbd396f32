"""Effects that a person asks for by name: added without asking held-out views."""

from collections.abc import Sequence

import numpy as np
import torch

from calib.calibration import Calibration
from calib.diagnosis.diagnosed import with_fit
from calib.diagnosis.far_start import begun
from calib.diagnosis.fine_surface_search import surroundings
from calib.diagnosis.most_probable_form import with_most_probable
from calib.diagnosis.score_test import Optimum
from calib.diagnosis.starting_model import model_of
from calib.effects.registry import KINDS
from calib.errors import InputError
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import JointFit
from calib.estimation.observations import Observations
from calib.estimation.residuals import residuals
from calib.progress import Progress
from calib.threads import single_thread

NAMES = tuple(kind.name for kind in KINDS)


def with_named(calibration: Calibration, names: Sequence[str], progress: Progress) -> Calibration:
    """Fit again with these effects; of an effect's forms, the one with the smallest error.

    Raises:
        InputError: there can be no such effect in this set-up.
    """
    kinds = {kind.name: kind for kind in KINDS}
    observations = calibration.observations
    advance = progress.task("Effects", len(names))
    with single_thread():
        model = model_of(calibration)
        joint = model.fit(observations, torch.from_numpy(calibration.poses))
        for done, name in enumerate(names, start=1):
            at = Optimum(model, observations, joint)
            there = surroundings(
                at, calibration.board, calibration.camera, place=kinds[name].needs_place
            )
            forms = kinds[name].propose(there)
            if not forms:
                raise InputError(
                    f"--effects {name}: this set-up can have no {name}, or the fit estimates it"
                    " already: leave it out."
                )
            tried: list[tuple[float, CameraModel, JointFit]] = []
            for test in at.candidates(forms):
                wider = model.with_effect(test.effect)
                begin = begun(wider, observations, joint)
                fitted = wider.fit(observations, begin.poses, begin.start)
                tried.append((_left(wider, fitted, observations), wider, fitted))
            _, wider, fitted = min(tried, key=lambda one: one[0])
            model, joint = with_most_probable(model, wider.effects[-1], observations, fitted)
            advance(done, name)
    return with_fit(calibration, model, joint, observations)


def _left(model: CameraModel, joint: JointFit, observations: Observations) -> float:
    """px^2: the median, which single bad corners do not move."""
    missed = residuals(model.path, joint.values, observations, joint.poses).image
    return float(np.nanmedian((missed**2).sum(-1).numpy()))
