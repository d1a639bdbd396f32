"""A fit that corrects its own views, and is repeated until it changes none of them.

A first fit shows which boards are turned, which corners and views are outliers, and where the
corners are that the search in the pictures missed. Each correction needs another fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from calib.corners.detect_all import refuse_larger_board
from calib.corners.view import MISFIT, RejectedPicture, View, describe_most, pose_labels
from calib.errors import NotEnoughDataError
from calib.estimation.observations import Observations
from calib.estimation.residuals import Residuals
from calib.estimation.robust import outlier_mask
from calib.fit_record.outcome import Redetection
from calib.fit_record.request import Settings
from calib.fitting.board_turns import RENUMBERED, turn_back
from calib.fitting.corner_outliers import find_outlier_corners, without_corners
from calib.fitting.fitted import Fitted
from calib.fitting.guided_redetection import redetect_corners
from calib.fitting.half_turns import HalfTurned
from calib.fitting.inputs import FitInputs, recalibrate_bare
from calib.fitting.setup import Setup
from calib.fitting.stages import fit_stages
from calib.fitting.view_noise import weigh_noisy_views
from calib.io.numerals import counted
from calib.progress import Progress
from calib.session.board import Board
from calib.session.session import MIN_FIT_VIEWS, Session
from calib.threads import single_thread

LARGE_ERROR = 1.0
"""px, root mean square: with a larger error, the corners may be those of a part of the board, which
is another one in each picture.
"""


@dataclass(slots=True)
class RepeatedFit:
    """The state of a repeated fit: `run` changes it."""

    session: Session
    inputs: FitInputs
    settings: Settings
    progress: Progress
    session_setup: Setup
    """The setup as the session declares it."""
    redetects: bool
    """True until missed corners have been looked for; false for a session without pictures."""
    views: tuple[View, ...] = field(init=False)
    """The views of the fit."""
    rejected: tuple[RejectedPicture, ...] = field(init=False)
    redetections: tuple[Redetection, ...] = ()
    """The outcome of the search for missed corners."""
    turned: tuple[str, ...] = ()
    """The views whose boards were turned by a quarter turn. `views` has them turned back."""
    half_turned: tuple[str, ...] = ()
    """The views whose boards were turned by half a turn. `views` has them turned back."""
    noise_ratios: dict[str, float] = field(default_factory=dict)
    """The noise of each noisy view over that of the others."""
    _outlier_masks: dict[str, NDArray[np.bool_]] = field(default_factory=dict)
    """(N,) true for the corners that were removed from each view, by its name."""
    _fitted: Fitted | None = None
    _earlier: Fitted | None = None
    """A fit of the same setup, where the next one starts."""
    _decided: Fitted | None = None
    """A fit of the same views, whose decision on the board's bend stands."""
    _fit_count: int = 0
    _purpose: str = ""
    """Words for the progress bar, which distinguish the next fit from those before it."""
    _is_half_turn_tried: bool = False

    def __post_init__(self) -> None:
        self.views, self.rejected = self.inputs.views, self.inputs.rejected

    @property
    def setup(self) -> Setup:
        """The declared setup, with a tolerance for each number that the settings estimate."""
        return self.session_setup.with_tolerances(self.settings)

    @property
    def fitted(self) -> Fitted:
        """The last fit."""
        assert self._fitted, "run comes first"
        return self._fitted

    @property
    def observations(self) -> Observations:
        """The corners of the views."""
        return Observations.of(self.views, self.session.board)

    @property
    def outlier_corners(self) -> dict[str, int]:
        """The number of corners that are left out of each view, by its name. A removed corner that
        was measured again in the picture does not count.
        """
        absent = {
            view.name: int((self._outlier_masks[view.name] & ~view.seen).sum())
            for view in self.views
            if view.name in self._outlier_masks
        }
        return {name: count for name, count in absent.items() if count}

    @property
    def picture_names(self) -> tuple[str, ...]:
        """The pictures that show the board, also those that the fit does not explain."""
        misfits = [picture.name for picture in self.rejected if picture.is_misfit]
        return (*(view.name for view in self.views), *misfits)

    def run(self) -> None:
        """Fit the views until no correction changes them, then weigh the noisy ones.

        Raises:
            InputError: a picture is damaged, or no ray of the camera leaves the cover.
            NotEnoughDataError: too few views show the board.
            OtherBoardError: the pictures show another board, which the message names.
        """
        while True:
            self._fit()
            self._refuse_larger_board()
            if self._turn_back():
                continue
            with single_thread():
                self._turn_half()
            if self._remove_outlier_corners():
                continue
            observations = self.observations
            if self._reject_outliers(observations):
                continue
            if not self.redetects:
                break
            with single_thread():
                has_more_corners = self._redetect()
            if not has_more_corners:
                break
        if self.settings.method == "joint":  # the paper's method weights all views equally
            with single_thread():
                self._weigh_noisy_views(observations)

    def check_enough(self, for_folds: int = 0) -> None:
        """Raise NotEnoughDataError if there are too few views."""
        check_enough(self.session.board, self.views, self.rejected, for_folds)

    def _fit(self) -> None:
        """Fit the views."""
        self.check_enough()
        with single_thread():
            self._fitted = fit_stages(
                self.setup,
                self.observations,
                self.settings,
                self.progress,
                earlier=self._earlier,
                labels=pose_labels(self.views),
                decided=self._decided,
                purpose=self._purpose,
            )
        self._fit_count += 1
        self._earlier = None
        self._decide()

    def _decide(self) -> None:
        """Let the last fit decide on the board's bend. A flat board is questioned again with more
        corners.
        """
        self._decided = self.fitted if self.fitted.effects else None

    def _refuse_larger_board(self) -> None:
        """Raise OtherBoardError if the first fit is bad and the pictures show a larger board."""
        if not (self.redetects and self._fit_count == 1):
            return
        if self.fitted.stages[-1].rms_px > LARGE_ERROR:
            names = {view.name for view in self.views}
            frames = [frame for frame in self.session.frames if frame.name in names]
            refuse_larger_board(frames, self.session.board)

    def _turn_back(self) -> bool:
        """Renumber the corners of boards that are turned by a quarter turn. Return True if there
        are any.
        """
        if self.turned or not self.fitted.turned:
            return False
        self.turned = self.fitted.turned
        board = self.session.board
        self.views = tuple(turn_back(v, board) if v.name in self.turned else v for v in self.views)
        self._decided = None
        self._purpose = RENUMBERED
        return True

    def _turn_half(self) -> None:
        """Renumber the corners of boards that are turned by half a turn, once, and take the fit
        that this needs.
        """
        if self._is_half_turn_tried:
            return
        self._is_half_turn_tried = True
        half_turns = HalfTurned.find(
            self.fitted, self.views, self.setup, self.settings, self.progress
        )
        if half_turns:
            self.half_turned = half_turns.names
            self.views = half_turns.views
            self._fitted = half_turns.fitted
            self._decide()

    def _remove_outlier_corners(self) -> bool:
        """Leave out single corners at wrong places. Return True if there are any."""
        session = self.session
        masks = find_outlier_corners(
            self.views, self.fitted.residuals, session.board, session.camera
        )
        if not masks.any():
            return False
        for view, mask in zip(self.views, masks, strict=True):
            if mask.any():
                self._outlier_masks[view.name] = mask | self._outlier_masks.get(view.name, False)
        self.views = without_corners(self.views, masks)
        self._purpose = "fewer corners"
        self._decided = None
        if self.inputs.is_own:
            self._recalibrate_bare()
        return True

    def _reject_outliers(self, observations: Observations) -> bool:
        """Leave out the views that the fit does not explain. Return True if there are any.

        Args:
            observations: those of the last fit.
        """
        self.views, outliers = _without_outliers(self.views, observations, self.fitted.residuals)
        if not outliers:
            return False
        self.rejected = (*self.rejected, *outliers)
        self._decided = None
        count = len(self.rejected)
        self._purpose = f"{count} view{'s' * (count > 1)} fewer"
        return True

    def _redetect(self) -> bool:
        """Look for corners where the fit expects them. Return True if there are new ones."""
        session = self.session
        self.redetects = False
        size = session.camera.width, session.camera.height
        self.views, self.redetections = redetect_corners(
            self.fitted, self.views, session.board, session.frames, size, self.progress
        )
        if not any(redetection.new_corners for redetection in self.redetections):
            return False
        self._purpose = "more corners"
        if self.inputs.is_own:
            self._recalibrate_bare()
        else:
            self._earlier = self.fitted
        return True

    def _recalibrate_bare(self) -> None:
        """Estimate the intrinsics, which come from the views of the fit, from all their corners."""
        bare = recalibrate_bare(self.views, self.session, self.inputs.intrinsics, self.progress)
        self.views = bare.views
        self.rejected = (*self.rejected, *bare.rejected)
        self.inputs = replace(
            self.inputs, intrinsics=bare.intrinsics, intrinsics_are_final=bare.final
        )
        self.session_setup = setup_of(self.session, self.inputs)

    def _weigh_noisy_views(self, observations: Observations) -> None:
        """Give noisy views less weight, and fit once more if there are any.

        Args:
            observations: those of the last fit.
        """
        self.views, self.noise_ratios = weigh_noisy_views(
            self.views, observations, self.fitted.residuals, self.session.board
        )
        if self.noise_ratios:
            self._fitted = fit_stages(
                self.setup,
                self.observations,
                self.settings,
                self.progress,
                earlier=self.fitted,
                decided=self.fitted,
                purpose="noisy views",
            )


def setup_of(session: Session, inputs: FitInputs) -> Setup:
    """Return the setup that a session declares."""
    return Setup(
        session.board,
        session.camera,
        inputs.prior_intrinsics,
        session.cover,
        inputs.intrinsics_are_final,
    )


def _without_outliers(
    views: Sequence[View], observations: Observations, residual: Residuals
) -> tuple[tuple[View, ...], tuple[RejectedPicture, ...]]:
    errors = residual.view_errors(observations)
    outlying = outlier_mask(errors)
    reasons = (
        (
            f"its {error:.2g} {MISFIT} {np.nanmedian(errors):.2g} px of the other views"
            if np.isfinite(error)
            else "no board pose explains its corners"
        )
        for error in errors
    )
    rejected = tuple(
        RejectedPicture(view.name, reason)
        for view, reason, is_outlier in zip(views, reasons, outlying, strict=True)
        if is_outlier
    )
    inliers = tuple(
        view for view, is_outlier in zip(views, outlying, strict=True) if not is_outlier
    )
    return inliers, rejected


def check_enough(
    board: Board, views: Sequence[View], rejected: Sequence[RejectedPicture], for_folds: int = 0
) -> None:
    """Raise NotEnoughDataError if the views are too few for a fit, and for this many folds."""
    fewest = MIN_FIT_VIEWS if board.is_flat else 1
    if len(views) < fewest:
        raise NotEnoughDataError(
            f"A fit needs {counted(fewest, 'usable view')} and there are"
            f" {len(views)}{describe_most(rejected)}: take more {board.views_words}."
        )
    if not for_folds:
        return
    poses = pose_labels(views)
    fitted_count = min(
        int(np.count_nonzero(poses % for_folds != fold)) for fold in range(for_folds)
    )
    if fitted_count < MIN_FIT_VIEWS or poses.max() + 1 < for_folds:
        raise NotEnoughDataError(
            f"{for_folds} folds need as many poses of the board, and {MIN_FIT_VIEWS} usable views"
            f" outside each fold; there are {len(views)} views of {poses.max() + 1} poses in all:"
            f" take more {board.views_words}, or ask for fewer folds."
        )
