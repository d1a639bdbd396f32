"""The joint estimate of a rig without the views that do not fit it.

The estimate is repeated, each time without the outlying views of the last one, until there are
none. A placement whose last view is left out goes with it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.errors import NotEnoughDataError
from calib.estimation.prior_conflict import CONFLICT_THRESHOLD
from calib.estimation.residuals import residuals
from calib.estimation.robust import outlier_mask
from calib.progress import Progress
from calib.rig.disagreement import estimate_with_disagreement, with_noise
from calib.rig.initial_state import initial_state
from calib.rig.joint_estimate import RigEstimate, RigState
from calib.rig.mounting_start import RigStart
from calib.rig.placements import Placements
from calib.rig.rig_file import RigDescription

LINEARISATIONS = 8
"""Length of the progress bar: a joint estimate takes about as many."""


def estimate_without_outliers(
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
    state = initial_state(description, calibrations, start, placements)
    noise = {camera.name: camera.sigma for camera in state.cameras}
    while True:
        estimate = _with_bar(state, progress)
        outliers = _outliers(estimate.state)
        if not any(mask.any() for mask in outliers):
            if not _contradicts_baseline(estimate.state):
                return estimate, dropped
            free = replace(description, baseline=None)
            return estimate_without_outliers(free, calibrations, start, placements, progress)
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
