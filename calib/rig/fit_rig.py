"""Fit a rig: each camera by itself for a start, then all of them together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.corners.view import View
from calib.effects.effect import Effect
from calib.errors import NotEnoughDataError
from calib.estimation.camera_model import CameraModel
from calib.estimation.observations import Observations
from calib.estimation.prior_conflict import CONFLICT_THRESHOLD
from calib.estimation.residuals import Residuals, residuals
from calib.estimation.robust import outlier_mask
from calib.fit_record.request import Settings
from calib.fitting.fit import fit
from calib.inference.calibration_model import full_model
from calib.optics.board_target import with_blocks
from calib.optics.params import Values
from calib.progress import Progress, Silent, check_progress
from calib.rig.clock_shift import describe_clock_shift
from calib.rig.disagreement import estimate_with_disagreement, with_noise
from calib.rig.joint_estimate import CameraState, RigEstimate, RigState
from calib.rig.layout import RigLayout
from calib.rig.mounting_start import RigStart, start_rig, turn_view
from calib.rig.placements import Placements
from calib.rig.problem import BaselinePrior
from calib.rig.requested_effects import (
    is_of_board,
    requested_by_camera,
    richer,
    with_requested_effects,
)
from calib.rig.rig import Rig
from calib.rig.rig_content import INCONSISTENT, OUTLYING, RejectedView, RigRecord
from calib.rig.rig_file import RigDescription, RigSource, read_rig
from calib.rig.rig_result import rig_of
from calib.rig.scatter import count_placements
from calib.rig.shared_cover import (
    is_of_cover,
    share_cover,
    with_joined_relief,
)
from calib.rig.shared_medium import find_shared_media, with_shared_media
from calib.session.session import Session
from calib.threads import single_thread

LINEARISATIONS = 8
"""Length of the progress bar: a joint estimate takes about as many."""


def fit_rig(
    rig: RigSource,
    settings: Settings = Settings(),
    progress: Progress = Silent(),
    *,
    effects: Sequence[str] = (),
) -> Rig:
    """Calibrate the cameras of a rig together.

    Args:
        rig: the rig, or the path of its rig.yaml or folder.
        settings: the options of each camera's fit.
        progress: the progress bars.
        effects: the names of effects to add without a held-out test
            (`calib.rig.requested_effects`).

    Raises:
        InputError: a file is missing, wrong or damaged, or an effect is not possible.
        NotEnoughDataError: too few views show the board, or the cameras share too few of them.
    """
    check_progress(progress)
    description = read_rig(rig)
    sessions = {
        name: replace(session, cover=description.sessions[description.covers[name]].cover)
        if name in description.covers
        else session
        for name, session in description.sessions.items()
    }
    requested = requested_by_camera(sessions, description.covers, settings, effects)

    def fit_camera(name: str, views: Sequence[View] | None = None) -> Calibration:
        calibration = _fit_camera(name, sessions[name], settings, progress, views)
        return with_requested_effects(name, calibration, requested[name], progress)

    calibrations = {name: fit_camera(name) for name in sessions}
    rejected = [
        RejectedView(name, view.name, view.reason)
        for name, calibration in calibrations.items()
        for view in calibration.rejected
    ]
    with single_thread():
        start, placements = _start(description, calibrations)
    turned = {
        name: tuple(
            view.name
            for view, quarters in zip(calibrations[name].views, turns.tolist(), strict=True)
            if quarters
        )
        for name, turns in start.turns.items()
        if turns.any()
    }
    views = _renumbered(calibrations, start)
    for name, inconsistent in start.inconsistent.items():
        rejected += _rejections(name, calibrations[name].views, inconsistent, INCONSISTENT)
        usable = ~inconsistent
        views[name] = tuple(v for v, use in zip(views[name], usable, strict=True) if use)
    changed = [name for name in calibrations if name in turned or start.inconsistent[name].any()]
    for name in changed:
        calibrations[name] = fit_camera(name, views[name])
    if changed:
        with single_thread():
            start, placements = _start(description, calibrations)
    with single_thread():
        estimate, dropped = _estimate(description, calibrations, start, placements, progress)
        board = calibrations[description.reference].board
        estimate, scatter = count_placements(estimate, board)
    for name, mask in dropped.items():
        rejected += _rejections(name, calibrations[name].views, mask, OUTLYING)
    record = RigRecord(
        source=str(description.file.resolve()),
        outcome=estimate.outcome.value,
        iterations=estimate.iterations,
        scatter=scatter,
        turned=turned,
        rejected=tuple(rejected),
        alone_px={name: _alone_px(c, dropped[name]) for name, c in calibrations.items()},
        baseline=description.baseline,
    )
    with single_thread():
        names = [placements.names[i] for i in _used_placements(placements, dropped)]
        used = {name: _without(c, dropped[name]) for name, c in calibrations.items()}
        noise = {name: calibration.corner_sigma_px for name, calibration in used.items()}
        return rig_of(
            with_noise(estimate.state, noise),
            estimate.covariance,
            used,
            description.reference,
            description.covers,
            names,
            record,
        )


def _fit_camera(
    name: str,
    session: Session,
    settings: Settings,
    progress: Progress,
    views: Sequence[View] | None,
) -> Calibration:
    """Return the calibration of one camera by itself."""
    try:
        return fit(session, settings, progress, views=views)
    except NotEnoughDataError as error:
        raise NotEnoughDataError(f"{name}: {error}") from None


def _start(
    description: RigDescription, calibrations: Mapping[str, Calibration]
) -> tuple[RigStart, Placements]:
    views = {name: calibration.views for name, calibration in calibrations.items()}
    placements = Placements.of(description, views)
    if sentence := describe_clock_shift(description, views, placements):
        raise NotEnoughDataError(sentence)
    poses = {
        name: torch.from_numpy(calibration.poses[:, :6])
        for name, calibration in calibrations.items()
    }
    board = calibrations[description.reference].board
    return start_rig(poses, placements, description.reference, board), placements


def _renumbered(
    calibrations: Mapping[str, Calibration], start: RigStart
) -> dict[str, tuple[View, ...]]:
    """Return the views of each camera, with their corners in the order of the same board."""
    return {
        name: tuple(
            turn_view(view, calibration.board, quarters)
            for view, quarters in zip(calibration.views, start.turns[name].tolist(), strict=True)
        )
        for name, calibration in calibrations.items()
    }


def _rejections(
    camera: str, views: Sequence[View], mask: NDArray[np.bool_], reason: str
) -> list[RejectedView]:
    return [
        RejectedView(camera, view.name, reason)
        for view, is_rejected in zip(views, mask, strict=True)
        if is_rejected
    ]


def _estimate(
    description: RigDescription,
    calibrations: Mapping[str, Calibration],
    start: RigStart,
    placements: Placements,
    progress: Progress,
) -> tuple[RigEstimate, dict[str, NDArray[np.bool_]]]:
    """Return the joint estimate without outlying views, and for each camera the (V,) mask of
    these. A stated distance of two cameras that the pictures contradict is not used: it would push
    the error into all other numbers.
    """
    dropped = {name: np.zeros(len(c.views), np.bool_) for name, c in calibrations.items()}
    state = _initial_state(description, calibrations, start, placements)
    noise = {camera.name: camera.sigma for camera in state.cameras}
    while True:
        estimate = _with_bar(state, progress)
        outliers = _outliers(estimate.state)
        if not any(mask.any() for mask in outliers):
            if not _contradicts_baseline(estimate.state):
                return estimate, dropped
            free = replace(description, baseline=None)
            return _estimate(free, calibrations, start, placements, progress)
        for name, mask in zip(calibrations, outliers, strict=True):
            indices = np.flatnonzero(~dropped[name])
            dropped[name][indices[mask]] = True
        state = with_noise(_without_views(estimate.state, outliers), noise)


def _contradicts_baseline(state: RigState) -> bool:
    """Return True if the estimate is far from the stated distance of two cameras, in its sigma."""
    if not state.baseline:
        return False
    deviation, _ = state.baseline.row(state.mountings[state.baseline.camera])
    return abs(deviation) > CONFLICT_THRESHOLD


def _with_bar(state: RigState, progress: Progress) -> RigEstimate:
    """Return `estimate_with_disagreement`, with its progress bar."""
    advance = progress.task(f"Joint estimate of {len(state.cameras)} cameras", LINEARISATIONS)
    estimate = estimate_with_disagreement(
        state, lambda count, _: advance(min(count, LINEARISATIONS), "")
    )
    advance(LINEARISATIONS, "")
    return estimate


def _outliers(state: RigState) -> list[NDArray[np.bool_]]:
    """Return the (V,) mask of the outlying views of each camera."""
    masks = []
    for index, camera in enumerate(state.cameras):
        poses = state.poses(index)
        residual = residuals(camera.model.path, camera.values, camera.observations, poses)
        masks.append(outlier_mask(residual.view_errors(camera.observations)))
    return masks


def _without_views(state: RigState, masks: Sequence[NDArray[np.bool_]]) -> RigState:
    cameras = []
    for camera, mask in zip(state.cameras, masks, strict=True):
        outlying = torch.from_numpy(mask)
        if bool(outlying.all()):
            raise NotEnoughDataError(
                f"No view of {camera.name} fits the other cameras of the rig: check that"
                " together in rig.yaml is right, and that no camera moved."
            )
        observations = camera.observations.without_views(outlying)
        placement = camera.placement[~outlying]
        cameras.append(replace(camera, observations=observations, placement=placement))
    return _compact(replace(state, cameras=tuple(cameras)))


def _compact(state: RigState) -> RigState:
    """Return the state without the placements that no camera sees any more."""
    used = torch.zeros(len(state.placements), dtype=torch.bool)
    for camera in state.cameras:
        used[camera.placement] = True
    places = used.cumsum(0) - 1
    cameras = tuple(replace(camera, placement=places[camera.placement]) for camera in state.cameras)
    return replace(state, cameras=cameras, placements=state.placements[used])


def _initial_state(
    description: RigDescription,
    calibrations: Mapping[str, Calibration],
    start: RigStart,
    placements: Placements,
) -> RigState:
    effects = _board_effects(calibrations)
    bend = _effect_values(calibrations)
    media = find_shared_media(calibrations, description.covers)
    models = {name: _model(calibration, effects) for name, calibration in calibrations.items()}
    models = with_shared_media(models, calibrations, media)
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
    names = tuple(calibrations)
    mountings = torch.stack([start.mountings[name] for name in names])
    cameras = _share_covers(description, calibrations, cameras, start.mountings)
    baseline = None
    if description.baseline:
        second = next(i for i, name in enumerate(names) if name != description.reference)
        baseline = BaselinePrior(second, description.baseline.value, description.baseline.sigma)
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
        baseline=baseline,
    )


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


def _alone_px(calibration: Calibration, dropped: NDArray[np.bool_]) -> float:
    """Return the error, px, of the views that the rig uses, in the camera's own fit."""
    path, values = calibration.model()
    observations = Observations.of(calibration.views, calibration.board)
    poses = torch.from_numpy(calibration.poses)
    image = residuals(path, values, observations, poses).image
    used = torch.from_numpy(~dropped)[observations.view]
    return Residuals(image[used], image[used]).rms_px


def _used_placements(placements: Placements, dropped: Mapping[str, NDArray[np.bool_]]) -> list[int]:
    """Return the placements of which a view is left."""
    used = {
        int(place)
        for name, places in placements.of_views.items()
        for place in places[~dropped[name]]
    }
    return sorted(used)


def _without(calibration: Calibration, dropped: NDArray[np.bool_]) -> Calibration:
    views = tuple(v for v, out in zip(calibration.views, dropped, strict=True) if not out)
    return replace(calibration, views=views)
