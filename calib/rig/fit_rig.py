"""Fit a rig: each camera by itself for a start, then all of them together.

1. Each camera is fitted to its own views, with the effects that were asked for.
2. The poses of the board in the views that cameras share give the mounting of each camera. They
   also show boards that were turned, and views that the other cameras contradict.
3. A camera with such views is fitted again: its corners are renumbered, or the views are left out.
4. The joint estimate leaves out the views that do not fit it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.corners.view import View
from calib.errors import NotEnoughDataError
from calib.estimation.observations import Observations
from calib.estimation.residuals import Residuals, residuals
from calib.fit_record.request import Settings
from calib.fitting.fit import fit
from calib.progress import Progress, Silent, check_progress
from calib.rig.clock_shift import describe_clock_shift
from calib.rig.disagreement import with_noise
from calib.rig.mounting_start import RigStart, start_rig, turn_view
from calib.rig.outlying_views import estimate_without_outliers
from calib.rig.placements import Placements
from calib.rig.requested_effects import requested_by_camera, with_requested_effects
from calib.rig.rig import Rig
from calib.rig.rig_content import INCONSISTENT, OUTLYING, RejectedView, RigRecord
from calib.rig.rig_file import RigDescription, RigSource, read_rig
from calib.rig.rig_result import rig_of
from calib.rig.scatter import count_placements
from calib.session.session import Session
from calib.threads import single_thread


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
    sessions = _with_shared_covers(description)
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
    turned = _turned_views(calibrations, start)
    for name, mask in start.inconsistent.items():
        rejected += _rejections(name, calibrations[name].views, mask, INCONSISTENT)
    corrected = _corrected_views(calibrations, start)
    for name, views in corrected.items():
        calibrations[name] = fit_camera(name, views)
    if corrected:
        with single_thread():
            start, placements = _start(description, calibrations)
    return _fit_jointly(description, calibrations, start, placements, turned, rejected, progress)


def _with_shared_covers(description: RigDescription) -> dict[str, Session]:
    """Return the session of each camera. Sessions of cameras that share a cover have the cover of
    the first of them.
    """
    return {
        name: replace(session, cover=description.sessions[description.covers[name]].cover)
        if name in description.covers
        else session
        for name, session in description.sessions.items()
    }


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


def _turned_views(
    calibrations: Mapping[str, Calibration], start: RigStart
) -> dict[str, tuple[str, ...]]:
    """Return, for each camera that has any, the names of its views whose corners are numbered as if
    the board were turned against that of the other cameras.
    """
    return {
        name: tuple(
            view.name
            for view, quarters in zip(calibrations[name].views, turns.tolist(), strict=True)
            if quarters
        )
        for name, turns in start.turns.items()
        if turns.any()
    }


def _corrected_views(
    calibrations: Mapping[str, Calibration], start: RigStart
) -> dict[str, tuple[View, ...]]:
    """Return the corrected views of each camera that has turned or inconsistent ones: turned views
    with renumbered corners, and no inconsistent views.
    """
    corrected: dict[str, tuple[View, ...]] = {}
    for name, calibration in calibrations.items():
        turns, inconsistent = start.turns[name].tolist(), start.inconsistent[name].tolist()
        if any(turns) or any(inconsistent):
            corrected[name] = tuple(
                turn_view(view, calibration.board, quarters)
                for view, quarters, is_out in zip(
                    calibration.views, turns, inconsistent, strict=True
                )
                if not is_out
            )
    return corrected


def _fit_jointly(
    description: RigDescription,
    calibrations: Mapping[str, Calibration],
    start: RigStart,
    placements: Placements,
    turned: Mapping[str, tuple[str, ...]],
    rejected: Sequence[RejectedView],
    progress: Progress,
) -> Rig:
    """Return the rig of the joint estimate.

    Args:
        calibrations: of the cameras, each by itself.
        start: where the cameras and the boards are.
        placements: the views of each placement of the board.
        turned: the names of the views that were turned back, by camera.
        rejected: the views that were left out so far.
    """
    with single_thread():
        estimate, dropped = estimate_without_outliers(
            description, calibrations, start, placements, progress
        )
        board = calibrations[description.reference].board
        estimate, scatter = count_placements(estimate, board)
    outlying = [
        view
        for name, mask in dropped.items()
        for view in _rejections(name, calibrations[name].views, mask, OUTLYING)
    ]
    record = RigRecord(
        source=str(description.file.resolve()),
        outcome=estimate.outcome.value,
        iterations=estimate.iterations,
        scatter=scatter,
        turned=turned,
        rejected=(*rejected, *outlying),
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


def _rejections(
    camera: str, views: Sequence[View], mask: NDArray[np.bool_], reason: str
) -> list[RejectedView]:
    return [
        RejectedView(camera, view.name, reason)
        for view, is_rejected in zip(views, mask, strict=True)
        if is_rejected
    ]


def _alone_px(calibration: Calibration, dropped: NDArray[np.bool_]) -> float:
    """Return the error, px, of the views that the rig uses, in the camera's own fit."""
    path, values = calibration.model()
    observations = Observations.of(calibration.views, calibration.board)
    poses = torch.from_numpy(calibration.poses)
    image = residuals(path, values, observations, poses).image
    used = torch.from_numpy(~dropped)[observations.view]
    return Residuals(image[used], image[used]).rms_px


def _used_placements(placements: Placements, dropped: Mapping[str, NDArray[np.bool_]]) -> list[int]:
    """Return the indices of the placements that have at least one view that was not dropped."""
    used = {
        int(place)
        for name, places in placements.of_views.items()
        for place in places[~dropped[name]]
    }
    return sorted(used)


def _without(calibration: Calibration, dropped: NDArray[np.bool_]) -> Calibration:
    views = tuple(v for v, out in zip(calibration.views, dropped, strict=True) if not out)
    return replace(calibration, views=views)
