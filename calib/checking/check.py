"""The check of a calibration by a few pictures of its board, and the search for what changed."""

from __future__ import annotations

from collections.abc import Callable, Container
from dataclasses import dataclass, replace

import numpy as np
import torch

from calib.calibration import Calibration
from calib.checking.changes import changes_of
from calib.checking.hypotheses import (
    GROSS,
    OTHER_CAMERA,
    OTHER_MEDIUM,
    TURNED,
    UNCOVERED,
    CheckedViews,
    Hypothesis,
    rank_hypotheses,
)
from calib.checking.naming import name_changes, probabilities, rms_shift
from calib.checking.overdispersion import Overdispersion
from calib.checking.picture_mode import PictureMode, StretchedMode
from calib.checking.pictures import OTHER_BOARD, Pictures
from calib.checking.posterior_predictive import PosteriorPredictive
from calib.checking.prior import CalibrationPrior
from calib.checking.result import Change, CheckResult, CheckStatistics, CheckStatus
from calib.checking.significance import Significance, significance
from calib.corners.copies import count_fitted
from calib.corners.view import RejectedPicture, View
from calib.effects.effect import Effect
from calib.errors import NotEnoughDataError
from calib.estimation.noise import on_board_grid, short_scale_noise
from calib.estimation.observations import Observations
from calib.estimation.residuals import Residuals, residuals
from calib.fitting.board_difference import describe_difference, has_same_corners
from calib.fitting.with_initial_pose import with_initial_pose
from calib.inference.naming import NAME_ALONE
from calib.progress import Progress, Silent
from calib.session.board import Board
from calib.threads import single_thread

NOTICEABLE = 1 / 3
"""The smallest change worth reporting, over the corners' noise. At 1/3, the error grows by
5.4 %.
"""
BROKEN_PX = 1.0
"""The smallest added error in px that people see as a fault in undistorted pictures."""
BROKEN_RATIO = 3.0
"""The smallest added error over the corners' noise of a broken calibration, if that is more than
BROKEN_PX.
"""
OTHER_PICTURES = frozenset(
    {TURNED, UNCOVERED, OTHER_MEDIUM, OTHER_CAMERA, PictureMode.name, StretchedMode.name}
)
"""Changes that always break the calibration: they move every pixel by much."""
NOISE_CHANGE = 1.3
"""The ratio of noise variances above which the ranking of changes may depend on it."""
OUT_OF_REACH = 3.0
"""The ratio of its error to the best error above which a change cannot be the most probable."""
STAGES = 3


@dataclass(frozen=True, slots=True, eq=False)
class Checker:
    """A calibration ready for checks, with the overdispersion of its own views."""

    calibration: Calibration
    prior: CalibrationPrior
    changes: tuple[Effect, ...]
    overdispersion: Overdispersion
    noise: float | None
    """The short-scale noise of the calibration's own corners in px; None if it has too few."""

    @staticmethod
    def of(calibration: Calibration) -> Checker:
        """Prepare a calibration for checks."""
        with single_thread():
            prior = CalibrationPrior.with_media(calibration)
            changes = changes_of(calibration)
            noise = None
            if calibration.views:
                poses = torch.from_numpy(calibration.poses)
                residual = residuals(
                    prior.model.path, prior.model.means, calibration.observations, poses
                )
                grid = on_board_grid(residual.image, calibration.views)
                noise = short_scale_noise(grid, calibration.board)
            overdispersion = Overdispersion.of(calibration, prior, changes)
            return Checker(calibration, prior, changes, overdispersion, noise)

    def check(self, pictures: Pictures, progress: Progress = Silent()) -> CheckResult:
        """Check the calibration by pictures.

        Raises:
            NotEnoughDataError: no view has a pose of the board that explains its corners.
        """
        if pictures.mismatch:
            change = Change(pictures.mismatch_name, pictures.mismatch, 1.0)
            return CheckResult(CheckStatus.BROKEN, None, (change,), pictures.rejected)
        advance = progress.task("Check", STAGES)
        with single_thread():
            result = self._compare_boards(pictures, advance)
        advance(STAGES, "")
        assert result.statistics
        statistics = replace(
            result.statistics, reused_views=count_fitted(pictures.views, self.calibration.views)
        )
        return replace(result, statistics=statistics)

    def _compare_boards(
        self, pictures: Pictures, advance: Callable[[int, str], None]
    ) -> CheckResult:
        """Return the result of the check. Where the pictures' board is declared with other columns,
        rows or squares than the calibration's and they do not agree with it, the board is named,
        and no change of the camera: a wrong size looks like one.
        """
        board, fitted = pictures.board, self.calibration.board
        difference = describe_difference(board, fitted, "in these pictures")
        if not difference:
            return self._check(pictures, advance)
        try:
            result = self._check(pictures, advance)
        except NotEnoughDataError as error:
            raise NotEnoughDataError(
                f"{error} {difference[0].upper()}{difference[1:]}: correct the one that is wrong."
            ) from error
        if result.status is CheckStatus.VALID:
            advice = "if it is the same board, correct the one that is wrong"
            return replace(result, note=f"{difference}: {advice}")
        if not has_same_corners(board, fitted):
            advice = (
                "a wrong size looks like a change of the camera, so correct it, or take pictures of"
                " the calibration's board"
            )
        elif self._agrees_with(pictures, fitted.square, advance):
            advice = (
                f"the pictures agree with the calibration if they are {1e3 * fitted.square:g} mm,"
                " so correct the description of these pictures"
            )
        else:
            advice = (
                "the pictures agree with the calibration with neither. Measure"
                f" a {board.cell}, correct the one that is wrong, and check again"
            )
        change = Change(OTHER_BOARD, f"{difference}: {advice}", 1.0)
        return replace(result, changes=(change,), lacking="")

    def _agrees_with(
        self, pictures: Pictures, square: float, advance: Callable[[int, str], None]
    ) -> bool:
        """Return True if the calibration is valid for the pictures of a board with these squares,
        m.
        """
        board = replace(pictures.board, square=square)
        try:
            return self._check(replace(pictures, board=board), advance).status is CheckStatus.VALID
        except NotEnoughDataError:
            return False

    def _check(self, pictures: Pictures, advance: Callable[[int, str], None]) -> CheckResult:
        views, poses, residual, unexplained = self._fit_poses(pictures)
        rejected = (*pictures.rejected, *unexplained)
        camera = self.calibration.camera
        observations = Observations.of(views, pictures.board).add_times(None, camera.height)
        advance(1, "test")
        predictive = PosteriorPredictive.of(self.prior, self.changes, observations, poses)
        noise_ratio = self._noise_ratio(residual, views, pictures.board)
        test = significance(predictive, self.overdispersion, noise_ratio)
        expected = self._expected_error(predictive, observations, noise_ratio)
        statistics = self._statistics(test, residual.rms_px, expected, noise_ratio, len(views))
        result = CheckResult(CheckStatus.VALID, statistics, (), rejected)
        if not test.significant:
            return result
        advance(2, "what has changed")
        checked = CheckedViews(observations, poses, predictive, camera.width, camera.height)
        ranking, variance_ratio = self._ranking(
            checked, views, pictures.board, residual.rms_px, noise_ratio
        )
        best = ranking[0]
        if best.view >= 0 and probabilities(ranking)[0] > NAME_ALONE and len(views) > 1:
            bad_view = views[best.view]
            remaining = tuple(view for view in views if view is not bad_view)
            rejected = (*rejected, RejectedPicture(bad_view.name, best.words))
            return self._check(Pictures(remaining, pictures.board, rejected), advance)
        return self._judge_change(result, checked, ranking, residual.rms_px, variance_ratio)

    def _judge_change(
        self,
        result: CheckResult,
        checked: CheckedViews,
        ranking: list[Hypothesis],
        error: float,
        variance_ratio: float,
    ) -> CheckResult:
        """Return the result with the most probable change, if it is worth reporting.

        Args:
            result: the result of views that differ significantly from the calibration.
            checked: the same views.
            ranking: the changes, the most probable first.
            error: px, root mean square of the views' residuals.
            variance_ratio: the variance of the corners' noise over that of the calibration's.
        """
        assert result.statistics
        best = ranking[0]
        noise = self._noise_px(variance_ratio * self.overdispersion.typical)
        added = rms_shift(best, checked)
        expected = self._expected_error(checked.predictive, checked.observations, variance_ratio)
        excess_px = max(0.0, error**2 - expected**2) ** 0.5
        # Without a size, or if the first-order estimate is unreliable because the change is large,
        # take the whole excess error.
        if added is None or not max(added, excess_px) < GROSS * noise:
            added = excess_px
        statistics = replace(result.statistics, added_px=added)
        if added < NOTICEABLE * noise:
            return replace(result, statistics=statistics)
        broken = added > max(BROKEN_PX, BROKEN_RATIO * noise) or best.name in OTHER_PICTURES
        excess, _ = self.overdispersion.lacking.get(best.name, (0.0, 1.0))
        return replace(
            result,
            status=CheckStatus.BROKEN if broken else CheckStatus.DEGRADED,
            statistics=replace(
                statistics,
                noise_px=self._noise_px(variance_ratio),
                noise_ratio=variance_ratio**0.5,
            ),
            changes=name_changes(ranking, checked),
            lacking=best.name if excess > 0 else "",
        )

    def _statistics(
        self, test: Significance, error: float, expected: float, noise_ratio: float, views: int
    ) -> CheckStatistics:
        return CheckStatistics(
            p_value=test.p_value,
            statistic=test.statistic,
            freedom=test.freedom,
            error_px=error,
            expected_px=expected,
            allowed_px=expected * test.allowed**0.5,
            added_px=max(0.0, error**2 - expected**2) ** 0.5,
            noise_px=self._noise_px(noise_ratio),
            noise_ratio=noise_ratio**0.5,
            views=views,
        )

    def _noise_px(self, variance_ratio: float) -> float:
        """Return the two-dimensional noise in px for a ratio of variances to the calibration's."""
        return float(2**0.5 * self.prior.sigma * variance_ratio**0.5)

    def _ranking(
        self,
        checked: CheckedViews,
        views: tuple[View, ...],
        board: Board,
        error: float,
        noise_ratio: float,
    ) -> tuple[list[Hypothesis], float]:
        """Return the hypotheses, the most probable first, and the noise variance ratio that the
        best one leaves. A large change that bends from square to square looks like noise.
        """
        if error < self._noise_px(GROSS**2):
            return self._ranking_at(checked, error, noise_ratio), noise_ratio
        ranking = self._ranking_at(checked, error, 1.0)
        best = ranking[0].residuals
        if best is None:
            return ranking, noise_ratio
        best_ratio = self._noise_ratio(best, views, board)
        if best_ratio <= NOISE_CHANGE:
            return ranking, best_ratio
        names = {
            hypothesis.name
            for hypothesis in ranking
            if hypothesis.residuals and hypothesis.residuals.rms_px < OUT_OF_REACH * best.rms_px
        }
        return self._ranking_at(checked, error, best_ratio, names), best_ratio

    def _ranking_at(
        self,
        checked: CheckedViews,
        error: float,
        noise_ratio: float,
        names: Container[str] | None = None,
    ) -> list[Hypothesis]:
        """Rank hypotheses; `names` are those of the changes that are worth a fit, None all."""
        sigma = self.prior.sigma * (noise_ratio * self.overdispersion.typical) ** 0.5
        changes = [change for change in self.changes if names is None or change.name in names]
        return rank_hypotheses(self.prior, changes, checked, sigma, error)

    def _fit_poses(
        self, pictures: Pictures
    ) -> tuple[tuple[View, ...], torch.Tensor, Residuals, tuple[RejectedPicture, ...]]:
        model = self.prior.model
        views, poses, rejected = with_initial_pose(
            model.path, model.means, pictures.views, pictures.board
        )
        if not views:
            raise NotEnoughDataError(
                "No picture can be checked: no pose of the board explains the corners of any"
                " picture. Take pictures that show the whole board."
            )
        height = self.calibration.camera.height
        observations = Observations.of(views, pictures.board).add_times(None, height)
        poses, residual = self.prior.fit_poses(observations, poses)
        return views, poses, residual, rejected

    def _noise_ratio(self, residual: Residuals, views: tuple[View, ...], board: Board) -> float:
        """Return the short-scale noise variance of the corners over that of the calibration's own,
        at least 1.
        """
        grid = on_board_grid(residual.image, views)
        noises = [short_scale_noise(grid[view : view + 1], board) for view in range(len(views))]
        known = [noise for noise in noises if noise is not None]
        if len(known) < len(noises) or not self.noise:
            return 1.0
        noise = float(np.median(known))  # robust against a single bad view
        return max(1.0, (noise / self.noise) ** 2)

    def _expected_error(
        self, predictive: PosteriorPredictive, observations: Observations, noise_ratio: float
    ) -> float:
        """Return the mean error of a valid calibration in px."""
        noise = float(predictive.freedom.sum()) * self.overdispersion.typical * noise_ratio
        squares = noise + float(predictive.calibration_variance.sum())
        corners = len(observations.pixels)
        variance = 2 * self.prior.sigma**2 * float((observations.weight**-2).mean())
        return float(np.sqrt(variance * squares / (2 * corners)))


def check(
    calibration: Calibration, pictures: Pictures, progress: Progress = Silent()
) -> CheckResult:
    """Check a calibration by pictures, as `Checker.check` does."""
    return Checker.of(calibration).check(pictures, progress)
