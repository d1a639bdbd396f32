"""The stages of a fit, each of which extends the previous one: the pinhole, the smooth cover, and
the cover's relief.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import compress

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.calibration_content import Stage
from calib.corners.view import View, pose_labels
from calib.effects.board_shape import DEGREES, BoardShape
from calib.effects.effect import Effect
from calib.errors import InputError, NotEnoughDataError
from calib.estimation.camera_model import CameraModel
from calib.estimation.corner_cells import average_corners, is_large, spread_part
from calib.estimation.gradient_fit import descend
from calib.estimation.joint_fit import FIRST_SIGMA, GOOD_GLASS, ROUNDS, JointFit, Start
from calib.estimation.noise import corner_noise
from calib.estimation.observations import Observations
from calib.estimation.poses import TOLERANCE, pinhole_poses, refine_poses
from calib.estimation.residuals import Residuals, residuals
from calib.estimation.stated_priors import priors_of
from calib.estimation.surface_prior import Smoothness, expected_amplitudes
from calib.estimation.uneven_glass import uneven_log_odds
from calib.fit_record.request import Settings
from calib.fitting.board_turns import find_turned
from calib.fitting.fit_result import EFFECTS_STAGE
from calib.inference.board_bend import estimate_board
from calib.optics.build import covered_path, footprint, pinhole_path, relief_over, with_relief
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.relief import AMPLITUDES, Relief
from calib.optics.relief_view import described_at
from calib.progress import Progress
from calib.session.board import Board
from calib.session.camera import Camera, Intrinsics
from calib.session.cover import AUTO as AUTO_SURFACE
from calib.session.cover import EVEN, Cover
from calib.session.freeing import AUTO, free_parameters
from calib.session.numbers import numbers_of
from calib.session.parameter_names import COVER

MAX_LOST_FRACTION = 0.2
"""If the rays of a larger fraction of corners fail, the described cover cannot be right."""
MAX_SHIFT = 0.08
"""The largest change of the seen glass, as a fraction of it, for which a relief is kept: its prior
is that of the glass within the picture.
"""
MAX_PULL = 10.0
"""Tolerances: a declared number of the cover that even glass moves farther is no start for uneven
glass. A cone with bumps of 30 um can be imitated by one whose radius is zero.
"""
MAX_NOISE_RATIO = 1.3
"""A fit whose residual exceeds the corners' noise by this factor lacks something else, which may be
what pulls a number away from its declared value.
"""
MIN_LOG_ODDS = math.log(100)
"""The least log odds of uneven glass, or of a bent board behind even glass, against less."""
PINHOLE_STAGE = "pinhole"
COVER_STAGE = "cover+rbf"
START_TOLERANCE = 1e-6
"""The same as `TOLERANCE` for the start of a fit to very many corners."""
LAST_ROUNDS = (3e-4, 1e-6)
"""The tolerances of a fit to very many corners that starts next to its optimum. Where it ends, a
step would lower the squares of a million corners by 2 or less in all, for thousands of numbers:
each is about a hundredth of its standard deviation from the optimum.
"""
LINEARISATIONS = 12
"""Length of the progress bar: a joint fit takes about as many."""


@dataclass(frozen=True, slots=True)
class Setup:
    """The board, camera and cover as they are known before the fit."""

    board: Board
    camera: Camera
    intrinsics: Intrinsics
    cover: Cover
    intrinsics_are_final: bool = False
    """True if no joint fit must estimate these intrinsics again (`FitInputs`)."""
    initial: Mapping[str, float] = field(default_factory=dict)
    """The values of unknown numbers with which a fit starts, in SI units or px, by their names in
    the ray path; other numbers start at the means of their priors.
    """
    bare_lens: Mapping[str, float] = field(default_factory=dict)
    """The unknown intrinsics that `calibrate_bare` finds in the covered views as if there were no
    cover, focal lengths and principal point in px.
    """

    def with_tolerances(self, settings: Settings) -> Setup:
        """Return the setup with a tolerance for each declared number that the settings estimate.

        Raises:
            InputError: the cover has no number of such a name, or the method needs a number that is
                unknown.
        """
        if settings.method == "paper":
            for name, number in numbers_of(self.intrinsics, self.cover).items():
                if number.unknown:
                    raise InputError(
                        f"--method paper fits no number, and {name} is unknown: write its value in"
                        " session.yaml, or leave out --method."
                    )
            return self
        names = settings.free
        if self.cover.shape == "none":  # stated intrinsics are held unless they have a tolerance
            names = tuple(name for name in names if name != AUTO)
        intrinsics, cover = free_parameters(self.intrinsics, self.cover, names)
        return replace(self, intrinsics=intrinsics, cover=cover)

    def initial_values(self, values: Values) -> dict[str, Tensor]:
        """Return the values of a path with those of `initial` in their place."""
        initial = {name: torch.tensor(v, dtype=torch.float64) for name, v in self.initial.items()}
        return {name: initial.get(name, value) for name, value in values.items()}


@dataclass(frozen=True, slots=True)
class OnAverages:
    """Averages of the corners of a session with very many, and a fit to them: for questions."""

    observations: Observations
    joint: JointFit


@dataclass(frozen=True, slots=True)
class Fitted:
    """The model, poses and residuals after the last stage."""

    path: Path
    values: Values
    poses: Tensor
    stages: tuple[Stage, ...]
    residuals: Residuals
    relief: Relief | None = None
    joint: JointFit | None = None
    model: CameraModel | None = None
    """The model of the joint fit; None without one."""
    turned: tuple[str, ...] = ()
    """The views that show the board turned by a quarter turn. This fit has them as they are."""
    on_averages: OnAverages | None = None
    """The fit of the same model to averages of the corners; None if they are not very many."""

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects of the path: the board's bend, or none."""
        return self.model.effects if self.model else ()

    def leaves_noise(
        self, views: Sequence[View], board: Board, ratio: float = MAX_NOISE_RATIO
    ) -> bool:
        """Return True if the error is at most so many times the corners' noise, and this is
        known.
        """
        noise = corner_noise(self.residuals.image, views, board)
        return noise is not None and self.residuals.rms_px <= ratio * noise


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
        decided: an earlier fit of these views, which decided on the board's bend; None to decide.
            Its error with a flat board is kept.
        purpose: a few words for the progress bar that distinguish this fit from others of the
            session, of at most 14 characters.

    Raises:
        InputError: no ray of the camera leaves the cover.
        NotEnoughDataError: the corners cannot be seen through the cover.
    """
    path, means = pinhole_path(setup.intrinsics)
    values = setup.initial_values(means)
    poses = pinhole_poses(path, values, observations)
    residual = residuals(path, values, observations, poses)
    alone = _bare_residual(setup, observations, residual)
    stages: tuple[Stage, ...] = (_stage(PINHOLE_STAGE, alone),)
    has_poses = bool(torch.isfinite(poses).all())  # the caller rejects views without a pose first
    is_bare = setup.cover.shape == "none"
    if not has_poses or (is_bare and (settings.method == "paper" or setup.intrinsics_are_final)):
        return Fitted(path, values, poses, stages, residual)
    job = _Job(setup, observations, settings, progress, purpose, (), labels, decided)
    if is_bare:
        model = job.model(path, means)
        start = earlier.joint.start if earlier and earlier.joint else job.initial(values)
        joint = job.part.fit(model, earlier.poses if earlier else poses, start)
        return job.finish_all(model, joint)
    path, means = covered_path(setup.intrinsics, setup.cover)
    values = setup.initial_values(means)
    tolerance = START_TOLERANCE if is_large(observations) else TOLERANCE
    poses = refine_poses(path, values, observations, poses, tolerance).blocks
    residual = residuals(path, values, observations, poses)
    _check_cover(residual)
    stages = (*stages, _stage("cover", residual))
    assert settings.grid, "the caller chooses the grid"
    if settings.method == "paper":
        if job.surface == EVEN:
            return Fitted(path, values, poses, stages, residual)
        low, high = footprint(path, values, setup.camera.width, setup.camera.height)
        relief = Relief(low, high, settings.grid[::-1])
        path = with_relief(path, relief, exact_hit=settings.exact_hit)
        values[AMPLITUDES] = torch.zeros(relief.grid, dtype=torch.float64)
        values[AMPLITUDES] = _descend(path, values, observations, poses, settings.steps, progress)
        residual = residuals(path, values, observations, poses)
        return Fitted(
            path, values, poses, (*stages, _stage(COVER_STAGE, residual)), residual, relief
        )
    return _fit_cover(replace(job, stages=stages), job.model(path, means), poses, earlier)


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


def _bare_residual(setup: Setup, observations: Observations, declared: Residuals) -> Residuals:
    """Return the residuals of the camera alone.

    If the lens is declared, these are `declared`. If it is unknown, they are those of
    `setup.bare_lens`, with a pose for each view of a flat board. `calibrate_bare` fits that lens
    together with the board's bend, so another lens may leave less here.
    """
    if not setup.bare_lens:
        return declared
    path, means = pinhole_path(setup.intrinsics)
    lens = {name: torch.tensor(v, dtype=torch.float64) for name, v in setup.bare_lens.items()}
    values = {name: lens.get(name, value) for name, value in means.items()}
    return residuals(path, values, observations, pinhole_poses(path, values, observations))


def _stage(name: str, residual: Residuals) -> Stage:
    return Stage(name, residual.rms_px, residual.rmse_cm)


@dataclass(frozen=True, slots=True)
class _Job:
    """The arguments of `fit_stages`, and the stages so far."""

    setup: Setup
    observations: Observations
    settings: Settings
    progress: Progress
    purpose: str
    stages: tuple[Stage, ...]
    labels: NDArray[np.int64] | None
    decided: Fitted | None

    @property
    def surface(self) -> str:
        """Whether the outer surface is even, as the session or the grid says it."""
        return EVEN if self.settings.is_even else self.setup.cover.covers[-1].surface

    def initial(self, values: Values) -> Start | None:
        """Return the start of a fit with unknown numbers, from the initial values of its path; None
        if all numbers are known.
        """
        return Start(dict(values), FIRST_SIGMA, None) if self.setup.initial else None

    @property
    def decides_bend(self) -> bool:
        """True if it is not decided whether the board is bent."""
        return self.decided is None and self.settings.estimates_bend

    def model(self, path: Path, values: Values) -> CameraModel:
        """Return the model of a path, with the board's bend if it is decided."""
        priors = priors_of(self.setup.intrinsics, self.setup.cover, path)
        effects = self.decided.effects if self.decided else ()
        return CameraModel(path, values, priors).with_effects(effects)

    @property
    def part(self) -> _Job:
        """The same with a part of the corners, if they are very many: what it finds is the start of
        `complete`.
        """
        corners = spread_part(self.observations)
        return self if corners is self.observations else replace(self, observations=corners)

    def complete(self, model: CameraModel, joint: JointFit) -> tuple[JointFit, OnAverages | None]:
        """Return the fit to all corners, from that to a part of them. Between these two, a fit to
        averages of all corners comes so near to the optimum that one step of all corners remains.
        """
        observations = self.observations
        if not is_large(observations) or not joint.finite:
            return joint, None
        path, values, poses = model.path, joint.values, joint.poses
        averages = average_corners(path, values, observations, poses, joint.sigma)
        near = replace(self, observations=averages).fit(model, poses, joint.start)
        if not near.finite:
            return near, None
        on_averages = OnAverages(averages, near)
        return self.fit(model, near.poses, near.start, LAST_ROUNDS), on_averages

    def log_odds_of_texture(self, model: CameraModel, joint: JointFit) -> tuple[float, Smoothness]:
        """Return `uneven_log_odds` of the fit of a model without a relief."""
        relief = _relief(self, model.path, joint.values)
        return uneven_log_odds(model, joint, self.observations, relief)

    def fit(
        self,
        model: CameraModel,
        poses: Tensor,
        start: Start | None,
        rounds: Sequence[float] = ROUNDS,
    ) -> JointFit:
        """Return the joint fit of a model."""
        is_uneven = bool(model.path.relief)
        title = "Rough fit" if len(rounds) == 1 else "Joint fit"
        if is_uneven:
            title = "Uneven glass, roughly" if len(rounds) == 1 else "Uneven glass"
        if self.purpose:
            title = f"{'Uneven' if is_uneven else 'Fit'}, {self.purpose}"
        advance = self.progress.task(title, LINEARISATIONS)
        joint = model.fit(
            self.observations,
            poses,
            start,
            rounds,
            progress=lambda count, rms: advance(min(count, LINEARISATIONS), f"{rms:.3f} px"),
        )
        advance(LINEARISATIONS, "")
        return joint

    def finish_all(
        self, model: CameraModel, joint: JointFit, relief: Relief | None = None
    ) -> Fitted:
        """Return `finish` of the fit to all corners, from that to a part of them."""
        completed, on_averages = self.complete(model, joint)
        return self.finish(model, completed, relief, on_averages)

    def is_possible(self, model: CameraModel, joint: JointFit) -> bool:
        """Return True if the cover's estimated numbers are within the limits of what a session may
        declare, and not far from what this one declares.
        """
        for name, kind in self.setup.cover.kinds.items():
            sigma = model.priors.sigmas.get(full_name := COVER.of(name))
            if sigma is not None:
                low, high = kind.quantity.low, kind.quantity.high
                value, mean = float(joint.values[full_name]), float(model.means[full_name])
                is_near = abs(value - mean) <= MAX_PULL * float(sigma)
                if not (is_near and low <= value * kind.quantity.unit[1] <= high):
                    return False
        return True

    def finish(
        self,
        model: CameraModel,
        joint: JointFit,
        relief: Relief | None = None,
        on_averages: OnAverages | None = None,
    ) -> Fitted:
        """Return the fit of a flat board, or that of a bent one if the views show the bend."""
        residual = residuals(model.path, joint.values, self.observations, joint.poses)
        flat = _stage(COVER_STAGE if model.path.cover else PINHOLE_STAGE, residual)
        if self.decided and self.decided.effects:
            flat = self.decided.stages[-2]
        stages = (*self.stages, flat)
        turned: tuple[str, ...] = ()
        if self.decides_bend:
            board = self.setup.board
            asked = on_averages or OnAverages(self.observations, joint)
            is_turned = find_turned(model, asked.observations, asked.joint, board)
            turned = tuple(compress(self.observations.names, is_turned))
            model, decided = estimate_board(
                model, asked.observations, asked.joint, board, self.labels
            )
            if decided is not asked.joint:
                joint = decided
                if on_averages:
                    joint, on_averages = self.complete(model, decided)
                residual = residuals(model.path, joint.values, self.observations, joint.poses)
        if model.effects:
            stages = (*stages, _stage(EFFECTS_STAGE, residual))
        return Fitted(
            path=model.path,
            values=joint.values,
            poses=joint.poses,
            stages=stages,
            residuals=residual,
            relief=relief,
            joint=joint,
            model=model,
            turned=turned,
            on_averages=on_averages,
        )


def _fit_cover(job: _Job, even: CameraModel, poses: Tensor, earlier: Fitted | None) -> Fitted:
    """Return the joint fit of a covered camera, with a relief if the glass is uneven.

    What the numbers explain is explained by them first: the fit of even glass is the start.
    """
    start = job.initial(job.setup.initial_values(even.means))
    if earlier and earlier.joint:
        start = earlier.joint.start
        poses = earlier.poses
    was_uneven = earlier is not None and earlier.relief is not None
    is_known = job.setup.cover.glass is not None
    if was_uneven or is_known:
        return _fit_uneven(job, even, poses, earlier, start)
    subset, on_averages = job.part, None
    smooth = subset.fit(even, poses, start)
    if job.surface == EVEN or not smooth.finite:
        return job.finish_all(even, smooth)
    log_odds, texture = subset.log_odds_of_texture(even, smooth)
    # With every number held, nothing but the glass could make up for their errors.
    is_asked = job.surface == AUTO_SURFACE and bool(even.priors.sigmas)
    if is_asked and subset is not job and log_odds < MIN_LOG_ODDS:
        subset = job
        smooth, on_averages = job.complete(even, smooth)
        log_odds, texture = job.log_odds_of_texture(even, smooth)
    if is_asked and log_odds < MIN_LOG_ODDS:
        return job.finish(even, smooth, None, on_averages)
    if not job.is_possible(even, smooth):
        # Even glass has no bumps, and its numbers went elsewhere to imitate them.
        return _fit_uneven(job, even, poses, None, start)
    start = replace(smooth.start, smoothness=texture)
    bent = _fit_bent(subset, even, smooth, log_odds) if job.decides_bend else None
    if not (bent and bent.model and bent.joint):
        return _fit_uneven(job, even, smooth.poses, None, start)
    log_odds, texture = subset.log_odds_of_texture(bent.model, bent.joint)
    if job.surface == AUTO_SURFACE and log_odds < MIN_LOG_ODDS:
        if subset is job:
            return bent
        finished = replace(job, decided=bent).finish_all(bent.model, bent.joint)
        return replace(finished, turned=bent.turned)
    # A relief of a flat board is fitted roughly, for the error that the bend removes.
    flat = _with_relief(job, even, _relief(job, even.path, job.setup.initial_values(even.means)))
    rough = subset.fit(flat, smooth.poses, start, ROUNDS[:1])
    residual = residuals(flat.path, rough.values, subset.observations, rough.poses)
    stages = (*job.stages, _stage(COVER_STAGE, residual), bent.stages[-1])
    job = replace(job, decided=replace(bent, stages=stages))
    start = replace(bent.joint.start, smoothness=texture)
    fitted = _fit_uneven(job, bent.model, bent.poses, None, start)
    return replace(fitted, turned=bent.turned)


def _fit_bent(job: _Job, even: CameraModel, smooth: JointFit, log_odds: float) -> Fitted | None:
    """Return the fit of a bent board behind even glass if the bend explains more than uneven glass
    would, and None if not, or if the target is not flat.

    Args:
        smooth: the fit of a flat board behind even glass.
        log_odds: the log odds of uneven glass at that fit.
    """
    if not job.setup.board.is_flat:
        return None
    bent = even.with_effect(BoardShape(*job.setup.board.half, DEGREES[-1]))
    joint = bent.fit(job.observations, smooth.poses, smooth.start, ROUNDS)
    if not joint.log_evidence > smooth.log_evidence + log_odds + MIN_LOG_ODDS:
        return None
    fitted = job.finish(even, smooth)
    return fitted if fitted.effects else None


def _fit_uneven(
    job: _Job, even: CameraModel, poses: Tensor, earlier: Fitted | None, start: Start | None
) -> Fitted:
    """Return the fit with a relief.

    Args:
        even: the model without a relief.
        earlier: an earlier fit with a relief, which is kept.
        start: the start, with or without a relief; None with the prior of a known glass.
    """
    start = start or Start(even.means, FIRST_SIGMA, GOOD_GLASS)
    if earlier and earlier.relief:
        model = _with_relief(job, even, earlier.relief)
        return job.finish_all(model, job.part.fit(model, poses, start), earlier.relief)
    relief = _relief(job, even.path, job.setup.initial_values(even.means))
    model = _with_relief(job, even, relief)
    subset = job.part
    joint = subset.fit(model, poses, start, ROUNDS[:1])
    for is_last in (False, True):
        start = joint.start
        if not _matches(job, relief, even.path, joint.values):
            # The numbers moved so far that the camera sees other glass than at the declared ones.
            relief = _relief(job, even.path, joint.values)
            model = _with_relief(job, even, relief)
            flat = {AMPLITUDES: model.means[AMPLITUDES]}
            start = replace(start, values={**start.values, **flat})
        elif is_last:
            break
        joint = subset.fit(model, joint.poses, start)
    return job.finish_all(model, joint, relief)


def _with_relief(job: _Job, even: CameraModel, relief: Relief) -> CameraModel:
    """Return the model with a relief, whose mean is that of a known glass."""
    setup = job.setup
    path, values = covered_path(setup.intrinsics, setup.cover)
    path = with_relief(path, relief, exact_hit=job.settings.exact_hit)
    flat = {AMPLITUDES: torch.from_numpy(expected_amplitudes(relief, setup.cover.glass))}
    priors = priors_of(setup.intrinsics, setup.cover, path)
    return CameraModel(path, {**values, **flat}, priors).with_effects(even.effects)


def _matches(job: _Job, relief: Relief, path: Path, values: Values) -> bool:
    """True if the region of the relief is about the one that the camera sees at these values."""
    if not (relief.anchor and relief.size):
        return True
    seen = described_at(_relief(job, path, values), relief.anchor, relief.size)
    (low, high), (seen_low, seen_high) = np.array(relief.region), np.array(seen.region)
    off = np.maximum(np.abs(low - seen_low), np.abs(high - seen_high))
    return bool((off < MAX_SHIFT * (seen_high - seen_low)).all())


def _relief(job: _Job, path: Path, values: Values) -> Relief:
    """Return the relief of the glass that the camera sees at these values, or of a known glass."""
    assert job.settings.grid, "the caller chooses the grid"
    grid = job.settings.grid[::-1]
    camera = job.setup.camera
    if glass := job.setup.cover.glass:
        return Relief.around(glass.low, glass.high, grid)
    region = footprint(path, values, camera.width, camera.height)
    return relief_over(path, values, region, grid)


def _descend(
    path: Path,
    values: Values,
    observations: Observations,
    poses: Tensor,
    steps: int,
    progress: Progress,
) -> Tensor:
    advance = progress.task("Relief", steps)
    corners = len(observations.weight)
    return descend(
        path,
        values,
        observations,
        poses,
        steps=steps,
        progress=lambda step, loss: advance(step, f"{1e3 * (loss / corners) ** 0.5:.3f} mm"),
    )


def _check_cover(residual: Residuals) -> None:
    failed = (~torch.isfinite(residual.image + residual.board)).any(-1)
    fraction = float(failed.double().mean())
    if fraction > MAX_LOST_FRACTION:
        raise NotEnoughDataError(
            f"{100 * fraction:.0f} % of the corners are seen where this cover lets no ray from the"
            " camera to the board: check the cover's numbers, outside_index (air or water?) and"
            " board.square_mm in session.yaml."
        )
