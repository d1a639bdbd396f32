"""The state from which the joint estimate of a rig starts: the cameras as their own fits have them,
with what they share.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import torch

from calib.calibration import Calibration
from calib.effects.effect import Effect
from calib.estimation.camera_model import CameraModel
from calib.estimation.observations import Observations
from calib.inference.calibration_model import full_model
from calib.optics.params import Values
from calib.optics.view_blocks import with_blocks
from calib.rig.joint_estimate import CameraState, RigState
from calib.rig.layout import RigLayout
from calib.rig.mounting_start import RigStart
from calib.rig.placements import Placements
from calib.rig.problem import BaselinePrior
from calib.rig.requested_effects import is_of_board, richer
from calib.rig.rig_file import RigDescription
from calib.rig.shared_cover import is_of_cover, share_cover, with_joined_relief
from calib.rig.shared_medium import find_shared_media, with_shared_media


def initial_state(
    description: RigDescription,
    calibrations: Mapping[str, Calibration],
    start: RigStart,
    placements: Placements,
) -> RigState:
    """Return the start of the joint estimate. The cameras share the board's effects, the index of
    their medium, and the covers that rig.yaml names.

    Args:
        calibrations: of the cameras, each by itself.
        start: where the cameras and the boards are.
        placements: the views of each placement of the board.
    """
    effects = _board_effects(calibrations)
    media = find_shared_media(calibrations, description.covers)
    models = {name: _model(calibration, effects) for name, calibration in calibrations.items()}
    models = with_shared_media(models, calibrations, media)
    cameras = _camera_states(calibrations, models, placements)
    cameras = _share_covers(description, calibrations, cameras, start.mountings)
    names = tuple(calibrations)
    mountings = torch.stack([start.mountings[name] for name in names])
    return RigState(
        cameras=tuple(cameras),
        layout=RigLayout.of(
            names,
            [camera.model for camera in cameras],
            description.reference,
            description.covers,
            media,
        ),
        nominal=mountings,
        mountings=mountings,
        placements=with_blocks(start.placements, cameras[0].model.path.view_blocks),
        baseline=_baseline_prior(description, names),
    )


def _camera_states(
    calibrations: Mapping[str, Calibration],
    models: Mapping[str, CameraModel],
    placements: Placements,
) -> list[CameraState]:
    """Return each camera with the numbers of its own fit, and the board's numbers of the first
    camera that has them.
    """
    bend = _effect_values(calibrations)
    cameras = []
    for name, calibration in calibrations.items():
        model = models[name]
        estimated = calibration.model()[1]
        values = {
            parameter: bend.get(parameter, estimated.get(parameter, mean))
            for parameter, mean in model.means.items()
        }
        joint = calibration.outcome.joint
        cameras.append(
            CameraState(
                name=name,
                model=model,
                observations=Observations.of(calibration.views, calibration.board),
                placement=torch.from_numpy(placements.of_views[name]),
                values=values,
                sigma=calibration.corner_sigma_px,
                smoothness=joint.relief_prior if joint else None,
            )
        )
    return cameras


def _baseline_prior(description: RigDescription, names: Sequence[str]) -> BaselinePrior | None:
    """Return the stated distance of the two cameras of a pair, if there is one."""
    if not description.baseline:
        return None
    second = next(i for i, name in enumerate(names) if name != description.reference)
    return BaselinePrior(second, description.baseline.value, description.baseline.sigma)


def _model(calibration: Calibration, effects: Sequence[Effect]) -> CameraModel:
    """Return the model of a camera with these effects of the board in place of its own."""
    camera_effects = tuple(e for e in full_model(calibration).effects if not is_of_board(e))
    bare = full_model(replace(calibration, effects=()))
    return bare.with_effects((*camera_effects, *effects))


def _share_covers(
    description: RigDescription,
    calibrations: Mapping[str, Calibration],
    cameras: Sequence[CameraState],
    mountings: Mapping[str, torch.Tensor],
) -> list[CameraState]:
    """Return the cameras with the covers that they share: those of the first cameras, with a relief
    of the glass that all of them see.
    """
    shared = {camera.name: camera for camera in cameras}
    for first in dict.fromkeys(description.covers.values()):
        frame = "" if first == description.reference else first
        behind = [name for name, leader in description.covers.items() if leader == first]
        leader = shared[first]
        for name in behind:
            model = share_cover(name, shared[name].model, frame, leader.model, mountings)
            values = {key: shared[name].values.get(key, mean) for key, mean in model.means.items()}
            values |= {key: leader.values[key] for key in leader.model.means if is_of_cover(key)}
            shared[name] = replace(
                shared[name], model=model, values=values, smoothness=leader.smoothness
            )
        if leader.model.path.relief:
            members = [shared[name] for name in (first, *behind)]
            pictures = [calibrations[camera.name].camera for camera in members]
            for camera in with_joined_relief(members, pictures):
                shared[camera.name] = camera
    return list(shared.values())


def _board_effects(calibrations: Mapping[str, Calibration]) -> tuple[Effect, ...]:
    """Return the effects of the board that the cameras' own fits have, each in its form with the
    most numbers: all cameras see the same board.
    """
    richest: dict[str, Effect] = {}
    for calibration in calibrations.values():
        for added in calibration.effects:
            effect = added.effect
            if not is_of_board(effect):
                continue
            if effect.name not in richest or richer(effect, richest[effect.name]):
                richest[effect.name] = effect
    return tuple(richest.values())


def _effect_values(calibrations: Mapping[str, Calibration]) -> Values:
    """Return the start of the board's numbers: those of the first camera that has them."""
    values: dict[str, torch.Tensor] = {}
    for calibration in calibrations.values():
        for added in calibration.effects:
            if is_of_board(added.effect):
                for name, (value, _) in added.parameters.items():
                    values.setdefault(name, torch.from_numpy(value))
    return values
