"""The stages of a fit, each of which extends the previous one:

1. The camera alone: the lens, and a pose of the board for each view.
2. The smooth cover, with the numbers that are declared; the poses are fitted again.
3. The joint fit of all numbers, with uneven glass if the views show it (`cover_fit`), and a bent
   board if they show that (`fit_job`); or, by the paper's method, uneven glass alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from calib.corners.view import View, pose_labels
from calib.errors import NotEnoughDataError
from calib.estimation.corner_cells import is_large
from calib.estimation.gradient_fit import descend
from calib.estimation.observations import Observations
from calib.estimation.poses import TOLERANCE, pinhole_poses, refine_poses
from calib.estimation.residuals import Residuals, residuals
from calib.fit_record.request import Settings
from calib.fitting.cover_fit import fit_cover
from calib.fitting.fit_job import FitJob
from calib.fitting.fitted import COVER_STAGE, PINHOLE_STAGE, SMOOTH_STAGE, Fitted, stage_of
from calib.fitting.setup import Setup
from calib.optics.build import covered_path, footprint, pinhole_path, with_relief
from calib.optics.relief import AMPLITUDES, Relief
from calib.progress import Progress
from calib.session.cover import EVEN

MAX_LOST_FRACTION = 0.2
"""If the rays of a larger fraction of corners fail, the described cover cannot be right."""
START_TOLERANCE = 1e-6
"""The tolerance of the poses behind the smooth cover if there are very many corners, in place of
`TOLERANCE`.
"""


def fit_stages(
    setup: Setup,
    observations: Observations,
    settings: Settings,
    progress: Progress,
    *,
    earlier: Fitted | None = None,
    labels: NDArray[np.int64] | None = None,
    decided: Fitted | None = None,
    purpose: str = "",
) -> Fitted:
    """Fit the model to corners, stage by stage. The joint method also estimates the numbers of the
    setup that have a standard deviation.

    Args:
        earlier: a fit of the same setup and views to other corners, from which the last stage
            starts.
        labels: (V,) labels of the board's poses, as `calib.corners.view.pose_labels` gives them;
            None if each view has a pose of its own.
        decided: an earlier fit of these views, whose decision on the board's bend is taken over,
            with its error for a flat board; None to decide here.
        purpose: the name of this fit in the progress bar, among the fits of the session; at most 14
            characters.

    Raises:
        InputError: no ray of the camera leaves the cover.
        NotEnoughDataError: the corners cannot be seen through the cover.
    """
    alone = _fit_alone(setup, observations)
    has_poses = bool(torch.isfinite(alone.poses).all())  # the caller rejects others first
    is_bare = setup.cover.shape == "none"
    if not has_poses or (is_bare and (settings.method == "paper" or setup.intrinsics_are_final)):
        return alone
    job = FitJob(setup, observations, settings, progress, purpose, (), labels, decided)
    if is_bare:
        return _fit_lens(job, alone, earlier)
    smooth = _fit_smooth_cover(setup, observations, alone)
    assert settings.grid, "the caller chooses the grid"
    if settings.method == "paper":
        return smooth if job.surface == EVEN else _fit_as_paper(job, smooth)
    return fit_cover(replace(job, stages=smooth.stages), smooth.poses, earlier)


def fit_or_none(
    setup: Setup, views: Sequence[View], settings: Settings, progress: Progress, purpose: str
) -> Fitted | None:
    """Return the fit of views with the tolerances of a setup; None if its cover hides the board, or
    the fit is not finite.

    Args:
        purpose: that of `fit_stages`.
    """
    try:
        fitted = fit_stages(
            setup.with_tolerances(settings),
            Observations.of(views, setup.board),
            settings,
            progress,
            labels=pose_labels(views),
            purpose=purpose,
        )
    except NotEnoughDataError:
        return None
    return fitted if fitted.joint and fitted.joint.finite else None


def _fit_alone(setup: Setup, observations: Observations) -> Fitted:
    """Return the first stage: the poses of the boards, seen by the lens without its cover."""
    path, means = pinhole_path(setup.intrinsics)
    values = setup.initial_values(means)
    poses = pinhole_poses(path, values, observations)
    residual = residuals(path, values, observations, poses)
    stage = stage_of(PINHOLE_STAGE, _bare_residual(setup, observations, residual))
    return Fitted(path, values, poses, (stage,), residual)


def _bare_residual(setup: Setup, observations: Observations, declared: Residuals) -> Residuals:
    """Return the residuals of the camera alone.

    If the lens is declared, these are `declared`. If it is unknown, they are those of
    `setup.bare_lens`, with a pose for each view of a flat board. `calibrate_bare` fits that lens
    together with the board's bend, so for a flat board another lens may have smaller residuals.
    """
    if not setup.bare_lens:
        return declared
    path, means = pinhole_path(setup.intrinsics)
    lens = {name: torch.tensor(v, dtype=torch.float64) for name, v in setup.bare_lens.items()}
    values = {name: lens.get(name, value) for name, value in means.items()}
    return residuals(path, values, observations, pinhole_poses(path, values, observations))


def _fit_lens(job: FitJob, alone: Fitted, earlier: Fitted | None) -> Fitted:
    """Return the joint fit of a camera without a cover. It replaces the first stage."""
    model = job.model(*pinhole_path(job.setup.intrinsics))
    start = earlier.joint.start if earlier and earlier.joint else job.initial(alone.values)
    joint = job.part.fit(model, earlier.poses if earlier else alone.poses, start)
    return job.finish_all(model, joint)


def _fit_smooth_cover(setup: Setup, observations: Observations, alone: Fitted) -> Fitted:
    """Return the second stage: the poses behind the cover as it is declared.

    Raises:
        NotEnoughDataError: the corners cannot be seen through the cover.
    """
    path, means = covered_path(setup.intrinsics, setup.cover)
    values = setup.initial_values(means)
    tolerance = START_TOLERANCE if is_large(observations) else TOLERANCE
    poses = refine_poses(path, values, observations, alone.poses, tolerance).blocks
    residual = residuals(path, values, observations, poses)
    _check_cover(residual)
    stages = (*alone.stages, stage_of(SMOOTH_STAGE, residual))
    return Fitted(path, values, poses, stages, residual)


def _fit_as_paper(job: FitJob, smooth: Fitted) -> Fitted:
    """Return the paper's fit: gradient descent on the relief, with everything else held."""
    camera, settings, observations = job.setup.camera, job.settings, job.observations
    assert settings.grid
    low, high = footprint(smooth.path, smooth.values, camera.width, camera.height)
    relief = Relief(low, high, settings.grid[::-1])
    path = with_relief(smooth.path, relief, exact_hit=settings.exact_hit)
    flat = torch.zeros(relief.grid, dtype=torch.float64)
    values = {**smooth.values, AMPLITUDES: flat}
    advance = job.progress.task("Relief", settings.steps)
    corners = len(observations.weight)
    values[AMPLITUDES] = descend(
        path,
        values,
        observations,
        smooth.poses,
        steps=settings.steps,
        progress=lambda step, loss: advance(step, f"{1e3 * (loss / corners) ** 0.5:.3f} mm"),
    )
    residual = residuals(path, values, observations, smooth.poses)
    stages = (*smooth.stages, stage_of(COVER_STAGE, residual))
    return Fitted(path, values, smooth.poses, stages, residual, relief)


def _check_cover(residual: Residuals) -> None:
    failed = (~torch.isfinite(residual.image + residual.board)).any(-1)
    fraction = float(failed.double().mean())
    if fraction > MAX_LOST_FRACTION:
        raise NotEnoughDataError(
            f"{100 * fraction:.0f} % of the corners are seen where this cover lets no ray from the"
            " camera to the board: check the cover's numbers, outside_index (air or water?) and"
            " board.square_mm in session.yaml."
        )
