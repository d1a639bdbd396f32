"""The model of a calibration, with the parameters that its fit estimated free again."""

from dataclasses import replace

import torch

from calib.calibration import Calibration
from calib.effects.board_scale import BoardScale
from calib.effects.board_shape import BoardShape
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import FIRST_SIGMA, ROUNDS, JointFit, Start
from calib.estimation.prior_conflict import PRIOR_INFLATION
from calib.estimation.stated_priors import priors_of, widen_prior
from calib.estimation.surface_prior import expected_amplitudes
from calib.optics.relief import AMPLITUDES
from calib.session.freeing import free_own_intrinsics
from calib.session.numbers import unknown_names


def base_model(calibration: Calibration) -> CameraModel:
    """Return the model at the declared values from which the calibration was fitted, without
    effects.
    """
    declared = calibration.declared
    as_declared = replace(
        calibration,
        camera=replace(calibration.camera, intrinsics=declared.intrinsics),
        cover=declared.cover,
        effects=(),
    )
    path, values = as_declared.model()
    intrinsics, cover = declared.intrinsics, declared.cover
    for name in declared.doubted:
        intrinsics, cover = widen_prior(intrinsics, cover, name, PRIOR_INFLATION)
    if calibration.outcome.intrinsics_from == "views":
        intrinsics = free_own_intrinsics(intrinsics)
    priors = priors_of(intrinsics, cover, path)
    if calibration.relief:
        values[AMPLITUDES] = torch.from_numpy(
            expected_amplitudes(calibration.relief, declared.cover.glass)
        )
    return CameraModel(path, values, priors)


def full_model(calibration: Calibration) -> CameraModel:
    """Return `base_model` with the calibration's effects."""
    return base_model(calibration).with_effects(added.effect for added in calibration.effects)


def fit_again(calibration: Calibration, model: CameraModel) -> JointFit:
    """Fit a model of a calibration, such as `full_model`, to its views.

    The fit starts at the declared values. An unknown number has none, only a usual range, and the
    fit of the session found its way from there in several steps. So with unknown numbers it starts
    at the calibration's estimates.
    """
    declared = calibration.declared
    start = None
    if unknown_names(declared.intrinsics, declared.cover):
        joint = calibration.outcome.joint
        start = Start(calibration.model()[1], FIRST_SIGMA, joint.relief_prior if joint else None)
    poses = torch.from_numpy(calibration.poses)
    return model.fit(calibration.observations, poses, start, ROUNDS)


def without_own_bend(calibration: Calibration) -> Calibration:
    """Return the calibration without the board's bend and print that its fit found, or the same one
    without such. Those that the user or an earlier diagnosis added stay.
    """
    settings, command = calibration.request.settings, calibration.request.command
    asked = command.effects if command else ()
    is_own = settings and not settings.flat_board and not calibration.history.diagnosis
    own = [
        added
        for added in calibration.effects
        if isinstance(added.effect, BoardShape | BoardScale) and added.effect.name not in asked
    ]
    if not is_own or not own:
        return calibration
    return replace(
        calibration, effects=tuple(added for added in calibration.effects if added not in own)
    )
