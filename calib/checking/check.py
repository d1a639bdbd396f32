"""Whether a calibration still holds, from a few pictures of its board; and if not, what changed."""

from __future__ import annotations

from collections.abc import Callable, Container
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.checking.answer import Answer, Change, Word
from calib.checking.changes import changes_of
from calib.checking.dispersion import Dispersion
from calib.checking.equations import Equations
from calib.checking.hypotheses import GROSS, TURNED, UNCOVERED, Hypothesis, Seen, hypotheses
from calib.checking.known import Known
from calib.checking.naming import named, probabilities, shift_of
from calib.checking.picture_mode import PictureMode
from calib.checking.pictures import Pictures
from calib.checking.significance import significance
from calib.corners.view import Rejected, View
from calib.diagnosis.families import ALONE
from calib.effects.effect import Effect
from calib.errors import InputError
from calib.estimation.noise import on_board_grid, short_scale_noise
from calib.estimation.observations import Observations
from calib.estimation.residuals import Residuals, residuals
from calib.fitting.posable import posable
from calib.progress import Progress, Silent
from calib.session.board import Board
from calib.threads import single_thread

NOTICEABLE = 1 / 3
"""Of the corners' noise: what a change adds to the error below that makes it larger by less than a
twentieth, and is not worth a word.
"""
BROKEN_PX = 1.0
"""px: from there on what is added is a fault that people see in undistorted pictures."""
BROKEN = 3.0
"""Times the corners' noise, where that is more."""
OTHER_PICTURES = frozenset({TURNED, UNCOVERED, PictureMode.name})
"""Changes of which there is no little: no pixel is what it was."""
NOISIER = 1.3
"""Times the variance of the corners' noise, from which it changes what is most probable."""
OUT_OF_REACH = 3.0
"""Times the error of the best: what leaves more is not the most probable, whatever the corners'
noise.
"""
STAGES = 3
ONE_PICTURE = 0.01
"""px"""


@dataclass(frozen=True, slots=True, eq=False)
class Checker:
    """A calibration that is ready to be checked, its own views' dispersion computed once."""

    calibration: Calibration
    known: Known
    changes: tuple[Effect, ...]
    dispersion: Dispersion
    noise: float
    """px, of the calibration's own corners at short scale; NaN where it has too few."""

    @staticmethod
    def of(calibration: Calibration) -> Checker:
        with single_thread():
            known, changes = Known.of(calibration), changes_of(calibration)
            noise = float("nan")
            if calibration.views:
                poses = torch.from_numpy(calibration.poses)
                missed = residuals(
                    known.model.path, known.model.means, calibration.observations, poses
                )
                noise = short_scale_noise(
                    on_board_grid(missed.image, calibration.views), calibration.board
                )
            return Checker(
                calibration, known, changes, Dispersion.of(calibration, known, changes), noise
            )

    def check(self, pictures: Pictures, progress: Progress = Silent()) -> Answer:
        """The answer.

        Raises:
            InputError: the views admit no pose of the board.
        """
        if pictures.other:
            return _without_views(pictures)
        advance = progress.task("Check", STAGES)
        with single_thread():
            answer = replace(self._check(pictures, advance), known=self._known(pictures.views))
        advance(STAGES, "")
        return answer

    def _check(self, pictures: Pictures, advance: Callable[[int, str], None]) -> Answer:
        views, poses, missed, lost = self._posed(pictures)
        rejected = (*pictures.rejected, *lost)
        camera = self.calibration.camera
        observations = Observations.of(views, pictures.board).add_times(None, camera.height)
        advance(1, "test")
        equations = Equations.of(self.known, self.changes, observations, poses)
        louder = self._louder(missed, views, pictures.board)
        found = significance(equations, self.dispersion, louder)
        expected = self._expected(equations, observations, louder)
        error = missed.rms_px
        answer = Answer(
            Word.VALID,
            found.p_value,
            found.statistic,
            found.freedom,
            error,
            expected,
            expected * found.allowed**0.5,
            max(0.0, error**2 - expected**2) ** 0.5,
            2**0.5 * self.known.sigma * louder**0.5,
            louder**0.5,
            len(views),
            (),
            rejected,
        )
        if not found.significant:
            return answer
        advance(2, "what has changed")
        seen = Seen(observations, poses, equations, camera.width, camera.height)
        guesses, louder = self._guesses(seen, views, pictures.board, error, louder)
        first, chances = guesses[0], probabilities(guesses)
        if first.view >= 0 and chances[0] > ALONE and len(views) > 1:
            out = views[first.view]
            rest = tuple(view for view in views if view is not out)
            return self._check(
                Pictures(rest, pictures.board, (*rejected, Rejected(out.name, first.words))),
                advance,
            )
        noise = 2**0.5 * self.known.sigma * (louder * self.dispersion.typical) ** 0.5
        shift = shift_of(first, seen)
        added = (
            shift
            if shift < GROSS * noise
            else max(0.0, error**2 - self._expected(equations, observations, louder) ** 2) ** 0.5
        )
        if added < NOTICEABLE * noise:
            return replace(answer, added_px=added)
        word = (
            Word.BROKEN
            if added > max(BROKEN_PX, BROKEN * noise) or first.name in OTHER_PICTURES
            else Word.DEGRADED
        )
        return replace(
            answer,
            word=word,
            added_px=added,
            changes=named(guesses, seen),
            noise_px=2**0.5 * self.known.sigma * louder**0.5,
            louder=louder**0.5,
            lacking=first.name if self.dispersion.lacking.get(first.name, (0.0,))[0] > 0 else "",
        )

    def _known(self, views: tuple[View, ...]) -> int:
        """How many of these views the calibration was made from: their corners are the same."""
        return sum(
            any(_same(view.corners, own.corners) for own in self.calibration.views)
            for view in views
        )

    def _guesses(
        self, seen: Seen, views: tuple[View, ...], board: Board, error: float, louder: float
    ) -> tuple[list[Hypothesis], float]:
        """What may have changed, the most probable first, with the noise that is left at the best
        of them: a large change looks like noise where it bends from square to square.
        """
        if error < GROSS * 2**0.5 * self.known.sigma:
            return self._asked(seen, error, louder), louder
        guesses = self._asked(seen, error, 1.0)
        best = guesses[0].missed
        if best is None:
            return guesses, louder
        quieter = self._louder(best, views, board)
        if quieter <= NOISIER:
            return guesses, quieter
        near = {
            one.name
            for one in guesses
            if one.missed and one.missed.rms_px < OUT_OF_REACH * best.rms_px
        }
        return self._asked(seen, error, quieter, near), quieter

    def _asked(
        self, seen: Seen, error: float, louder: float, names: Container[str] | None = None
    ) -> list[Hypothesis]:
        """Args: names: of the changes that are worth a fit; None: all."""
        sigma = self.known.sigma * (louder * self.dispersion.typical) ** 0.5
        changes = [change for change in self.changes if names is None or change.name in names]
        return hypotheses(self.known, changes, seen, sigma, error)

    def _posed(
        self, pictures: Pictures
    ) -> tuple[tuple[View, ...], torch.Tensor, Residuals, tuple[Rejected, ...]]:
        views, poses, lost = posable(pictures.views, pictures.board, self.known.model.means)
        if not views:
            raise InputError(
                "No picture can be checked: no pose of the board explains the corners of any; take"
                " some that show it whole."
            )
        observations = Observations.of(views, pictures.board).add_times(
            None, self.calibration.camera.height
        )
        poses, missed = self.known.posed(observations, poses)
        return views, poses, missed, lost

    def _louder(self, missed: Residuals, views: tuple[View, ...], board: Board) -> float:
        """The variance of the corners' noise over that of the calibration's own, at short scale; at
        least 1.
        """
        grid = on_board_grid(missed.image, views)
        noise = float(
            np.median(
                [short_scale_noise(grid[view : view + 1], board) for view in range(len(views))]
            )
        )  # whatever one of them has
        return max(1.0, (noise / self.noise) ** 2) if np.isfinite(noise) and self.noise > 0 else 1.0

    def _expected(self, equations: Equations, observations: Observations, louder: float) -> float:
        """px, the error of a valid calibration."""
        squares = float(equations.freedom.sum()) * self.dispersion.typical * louder + float(
            equations.spared.sum()
        )
        corners = len(observations.pixels)
        each = 2 * self.known.sigma**2 * float((observations.weight**-2).mean())
        return float(np.sqrt(each * squares / (2 * corners)))


def check(calibration: Calibration, pictures: Pictures, progress: Progress = Silent()) -> Answer:
    """As `Checker.check`."""
    return Checker.of(calibration).check(pictures, progress)


def _without_views(pictures: Pictures) -> Answer:
    nan = float("nan")
    change = Change(pictures.name, pictures.other, 1.0)
    return Answer(
        Word.BROKEN, nan, nan, 0, nan, nan, nan, nan, nan, nan, 0, (change,), pictures.rejected
    )


def _same(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Whether corners are of one picture: of two, noise alone puts some farther apart."""
    return one.shape == other.shape and bool(
        np.nanmax(np.abs(one - other), initial=0.0) < ONE_PICTURE
    )
