"""A calibrated rig from a joint estimate, and the state of that estimate from the rig."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from calib.calibration import Calibration
from calib.calibration_content import Stage
from calib.estimation.joint_fit import Estimate
from calib.estimation.residuals import residuals
from calib.fit_record.outcome import JointOutcome, Uncertainty
from calib.fitting.fit_result import with_estimate
from calib.inference.calibration_model import full_model
from calib.rig.joint_estimate import CameraState, RigState
from calib.rig.layout import RigLayout
from calib.rig.poses import compose, invert_poses
from calib.rig.problem import BaselinePrior
from calib.rig.rig import Rig
from calib.rig.rig_content import RigRecord
from calib.rig.rig_geometry import rig_models
from calib.rig.shared_cover import cover_in_camera, relief_in_camera, share_cover
from calib.rig.shared_medium import with_shared_media


def rig_of(
    state: RigState,
    covariance: Tensor,
    calibrations: Mapping[str, Calibration],
    reference: str,
    covers: Mapping[str, str],
    names: Sequence[str],
    record: RigRecord,
) -> Rig:
    """Return the rig of a joint estimate.

    Args:
        state: the optimum.
        covariance: (S, S) of the rig's vector, whose last numbers may be those of effects; NaN if
            the fit is not finite.
        calibrations: of the cameras, with the views of the estimate.
        reference: the name of the reference.
        covers: the first camera behind the same cover, as in `RigContent`.
        names: of the P placements.
        record: the record of the fit.
    """
    count = state.layout.count
    finite = bool(torch.isfinite(covariance).all())
    covariance = covariance[:count, :count]
    cameras = {}
    for index, camera in enumerate(state.cameras):
        calibration = calibrations[camera.name]
        columns = state.layout.columns[index]
        result = Estimate(
            values=dict(camera.values),
            poses=state.poses(index),
            covariance=covariance[columns[:, None], columns],
            sigma=camera.sigma,
            smoothness=camera.smoothness,
            parameters=camera.model.parameters,
        )
        cameras[camera.name] = _calibration(calibration, camera, result, record)
        if camera.name in covers:
            frame = state.layout.frames[index]
            mounting = state.mountings[index]
            in_own_frame = replace(
                result, poses=compose(mounting, state.placements[camera.placement])
            )
            to_camera = compose(mounting, invert_poses(state.mountings[frame]))
            cameras[camera.name] = _with_own_cover(
                cameras[camera.name], camera, in_own_frame, to_camera
            )
    return Rig(
        calibrations=cameras,
        reference=reference,
        mountings=state.mountings.numpy(),
        covariance=covariance.numpy() if finite else np.zeros((0, 0)),
        placements=state.placements[:, :6].numpy(),
        placement_names=tuple(names),
        of_views={camera.name: camera.placement.numpy() for camera in state.cameras},
        covers=covers,
        media=state.layout.media,
        record=record,
    )


def state_of(rig: Rig) -> RigState:
    """Return the optimum of the estimate that made a rig, with the priors of its cameras."""
    optima = rig_models(rig.calibrations, rig.reference, rig.covers, rig.mountings)
    models = {name: full_model(calibration) for name, calibration in rig.calibrations.items()}
    models = with_shared_media(models, rig.calibrations, rig.media)
    mountings = torch.from_numpy(rig.mountings)
    placed = dict(zip(rig.names, mountings, strict=True))
    for name, first in rig.covers.items():
        frame = "" if first == rig.reference else first
        models[name] = share_cover(name, models[name], frame, models[first], placed)
    cameras = []
    for (name, model), optimum in zip(models.items(), optima, strict=True):
        calibration = rig.calibrations[name]
        joint = calibration.outcome.joint
        cameras.append(
            CameraState(
                name=name,
                model=model,
                observations=calibration.observations,
                placement=torch.from_numpy(rig.of_views[name]),
                values={key: optimum.means[key] for key in model.means},
                sigma=calibration.corner_sigma_px,
                smoothness=joint.relief_prior if joint else None,
            )
        )
    baseline = None
    if rig.record.baseline:
        second = next(i for i, name in enumerate(rig.names) if name != rig.reference)
        baseline = BaselinePrior(second, rig.record.baseline.value, rig.record.baseline.sigma)
    return RigState(
        cameras=tuple(cameras),
        layout=RigLayout.of(rig.names, list(models.values()), rig.reference, rig.covers, rig.media),
        nominal=mountings,
        mountings=mountings,
        placements=torch.from_numpy(rig.placement_numbers),
        baseline=baseline,
    )


def _with_own_cover(
    calibration: Calibration, camera: CameraState, estimate: Estimate, to_camera: Tensor
) -> Calibration:
    """Return the calibration of a camera behind a shared cover, with the cover in its own frame and
    without a covariance: that of the rig has the cover in the first camera's frame.

    Args:
        estimate: the estimate with the board's poses in the camera's own frame.
        to_camera: (6,) T_camera_first.
    """
    path, values = camera.model.path, camera.values
    cover = cover_in_camera(calibration.camera, calibration.cover, path, values, to_camera)
    even = replace(
        calibration,
        cover=cover,
        relief=None,
        amplitudes=np.zeros((0, 0)),
        poses=estimate.poses.numpy(),
        covariance=np.zeros((0, 0)),
        stated=None,
    )
    if not path.relief:
        return even
    relief, amplitudes = relief_in_camera(even, path, values)
    return replace(even, relief=relief, amplitudes=amplitudes)


def _calibration(
    calibration: Calibration, camera: CameraState, estimate: Estimate, record: RigRecord
) -> Calibration:
    """Return a camera's calibration with its part of the joint estimate."""
    result = with_estimate(calibration, camera.model, estimate, camera.observations)
    residual = residuals(camera.model.path, camera.values, camera.observations, estimate.poses)
    last = Stage(result.stages[-1].name, residual.rms_px, residual.rmse_cm)
    joint = JointOutcome(
        outcome=record.outcome,
        iterations=record.iterations,
        sigma_px=camera.sigma,
        relief_prior=camera.smoothness,
    )
    uncertainty = Uncertainty(
        views=len(calibration.views),
        inflation=max(1.0, record.scatter),
        view_scatter=record.scatter,
        corner_scatter=1.0,
        method="placements",
    )
    outcome = replace(calibration.outcome, joint=joint, uncertainty=uncertainty)
    return replace(result, stages=(*result.stages[:-1], last), outcome=outcome)
