"""Effects that the user requests by name: they are added without a held-out test."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.calibration import Calibration
from calib.diagnosis.most_probable_form import with_most_probable
from calib.effects.board_scale import BoardScale
from calib.effects.board_shape import BoardShape
from calib.effects.registry import KINDS
from calib.errors import InputError
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import JointFit
from calib.estimation.observations import Observations
from calib.estimation.residuals import residuals
from calib.fitting.fit_result import with_fit
from calib.inference.calibration_model import fit_again, full_model
from calib.inference.effect_context import effect_context
from calib.inference.fitted_model import FittedModel
from calib.inference.score_test import tuned_score_tests
from calib.inference.warm_start import start_with_effect
from calib.progress import Progress
from calib.threads import single_thread

NAMES = tuple(kind.name for kind in KINDS)


def with_requested(
    calibration: Calibration, names: Sequence[str], progress: Progress
) -> Calibration:
    """Fit again with these effects; of the forms of an effect, the one with the smallest error.

    Raises:
        InputError: an effect is not possible with this camera and cover.
    """
    kinds = {kind.name: kind for kind in KINDS}
    calibration = _without_board_effects(calibration, names)
    observations = calibration.observations
    advance = progress.task("Effects", len(names))
    with single_thread():
        model = full_model(calibration)
        joint = fit_again(calibration, model)
        for done, name in enumerate(names, start=1):
            fitted = FittedModel(model, observations, joint)
            context = effect_context(
                fitted, calibration.board, calibration.camera, locate=kinds[name].needs_place
            )
            forms = kinds[name].propose(context)
            if not forms:
                raise InputError(
                    f"--effects {name}: this set-up cannot have {name}, or the fit estimates it"
                    " already: leave it out."
                )
            trials: list[tuple[float, CameraModel, JointFit]] = []
            for test in tuned_score_tests(fitted, forms):
                extended = model.with_effect(test.effect)
                start = start_with_effect(extended, observations, joint)
                fit = extended.fit(observations, start.poses, start.start)
                trials.append((_median_square(extended, fit, observations), extended, fit))
            _, extended, fit = min(trials, key=lambda trial: trial[0])
            model, joint = with_most_probable(model, extended.effects[-1], observations, fit)
            advance(done, name)
    return with_fit(calibration, model, joint, observations)


def _without_board_effects(calibration: Calibration, names: Sequence[str]) -> Calibration:
    """Return the calibration without those of the board's effects that a plain fit finds and that
    these names ask for.
    """
    kinds = tuple(kind for kind in (BoardShape, BoardScale) if kind.name in names)
    kept = tuple(added for added in calibration.effects if not isinstance(added.effect, kinds))
    return replace(calibration, effects=kept)


def _median_square(model: CameraModel, joint: JointFit, observations: Observations) -> float:
    """Return the median squared error in px^2, which is robust against bad corners."""
    image = residuals(model.path, joint.values, observations, joint.poses).image
    return float(np.nanmedian((image**2).sum(-1).numpy()))
