"""The test of a rig's mountings by later placements of its board that several cameras saw."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.special import fdtrc, ndtri

from calib.checking.check import BROKEN_PX, BROKEN_RATIO, NOTICEABLE
from calib.checking.hypotheses import GROSS
from calib.checking.naming import probabilities
from calib.checking.overdispersion import Overdispersion
from calib.checking.posterior_predictive import PosteriorPredictive
from calib.checking.result import CheckStatistics, CheckStatus
from calib.checking.significance import ALPHA, significance
from calib.inference.naming import NAME_ALONE
from calib.rig.check_result import CameraPlace, RigChange
from calib.rig.check_words import Naming, name_rig_changes, size_and_sigma
from calib.rig.moved_cameras import (
    BAD_PLACEMENT,
    KINDS,
    RigHypothesis,
    marginal,
    rank_rig_hypotheses,
)
from calib.rig.placement_equations import LinearRig
from calib.rig.poses import compose, pose_matrix
from calib.rig.rig import Rig
from calib.rig.rig_content import RejectedView
from calib.rig.shared_placements import SharedPlacements

MOUNTING_SHARE = 0.5
"""The share of false alarms of the mountings; the rest is that of the cameras by themselves."""
MAX_ROUNDS = 6
"""The limit on linearisations at a large motion; each leaves a hundredth of what it found."""
CONVERGED = 0.05
"""Standard deviations: a motion that changes by less has been found."""
MIN_P_VALUE = 1e-300
"""The smallest p-value that is turned to a number of standard deviations."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class MountingCheck:
    """The answer on the mountings of a rig."""

    status: CheckStatus = CheckStatus.VALID
    p_value: float = 1.0
    """The probability of the mountings alone."""
    statistics: CheckStatistics | None = None
    """None where no two cameras could be compared."""
    changes: tuple[RigChange, ...] = ()
    places: Mapping[str, CameraPlace] = field(default_factory=dict)
    base: str = ""
    unplaced: Mapping[str, str] = field(default_factory=dict)
    """The cameras that were not compared, and the reasons."""
    placements: int = 0
    rejected: tuple[RejectedView, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class MountingTest:
    """The cameras whose mountings are tested."""

    rig: Rig
    linear: LinearRig
    base: str
    """The camera against which poses are reported."""
    reported: tuple[str, ...]
    """The cameras whose poses are reported."""
    movable: tuple[str, ...]
    """The cameras whose motion the placements may tell."""
    scatter: Overdispersion
    """The scatter of the rig's own placements, along the motions of the movable cameras."""

    def run(self, shared: SharedPlacements, *, explain: bool = True) -> MountingCheck:
        """Test placements.

        Args:
            explain: false to leave out what has changed; the status is then that of a valid rig.
        """
        predictive = self._tested(shared.predictive())
        test = significance(predictive, self.scatter, 1.0)
        squares, corners = shared.squares()
        error = (squares / corners) ** 0.5
        noise = self._noise(shared)
        expected = self._expected(predictive, noise, corners)
        noise_px = 2**0.5 * noise * self.scatter.typical**0.5
        statistics = CheckStatistics(
            p_value=test.p_value,
            statistic=test.statistic,
            freedom=test.freedom,
            error_px=error,
            expected_px=expected,
            allowed_px=expected * test.allowed**0.5,
            added_px=max(0.0, error**2 - expected**2) ** 0.5,
            noise_px=2**0.5 * noise,
            noise_ratio=max(shared.noise.values(), default=1.0),
            views=sum(len(placed.placement) for _, placed in shared.groups),
        )
        check = MountingCheck(
            p_value=test.p_value,
            statistics=statistics,
            places=self._places(predictive),
            base=self.base,
            placements=len(shared.names),
        )
        if test.p_value >= ALPHA * MOUNTING_SHARE or not explain:
            return check
        ranking, predictive = self._explain(shared, predictive, error > GROSS * expected)
        best = ranking[0]
        is_sure = probabilities(ranking)[0] > NAME_ALONE
        if best.name == BAD_PLACEMENT and is_sure and len(shared.names) > 2:
            return self._without(shared, best.placement)
        shift = predictive.products * noise**2 / corners
        added = _added_px(best, shift)
        if added is None:
            added = statistics.added_px
        statistics = replace(statistics, added_px=added)
        check = replace(check, statistics=statistics, places=self._places(predictive))
        if added < NOTICEABLE * noise_px:
            return check
        is_broken = added > max(BROKEN_PX, BROKEN_RATIO * noise_px)
        pair = len(self.reported) == 1 and self.base not in self.movable
        naming = Naming(shared.names, self.base if pair else "", shift.sum(0))
        return replace(
            check,
            status=CheckStatus.BROKEN if is_broken else CheckStatus.DEGRADED,
            changes=name_rig_changes(ranking, naming),
        )

    def _tested(self, predictive: PosteriorPredictive) -> PosteriorPredictive:
        """Return the predictive with the motions of the movable cameras only."""
        places = {name: predictive.places[name] for name in self.movable}
        return replace(predictive, places=places)

    def _noise(self, shared: SharedPlacements) -> float:
        """Return the noise of a corner in these pictures, px per axis."""
        return float(
            np.sqrt(
                np.average(
                    [(c.sigma * shared.noise.get(c.name, 1.0)) ** 2 for c, _ in shared.groups],
                    weights=[len(placed.observations.pixels) for _, placed in shared.groups],
                )
            )
        )

    def _expected(self, predictive: PosteriorPredictive, noise: float, corners: int) -> float:
        """Return the mean error of an unchanged rig in px."""
        squares = float(predictive.freedom.sum()) * self.scatter.typical
        squares += float(predictive.calibration_variance.sum())
        return float(noise * np.sqrt(squares / corners))

    def _without(self, shared: SharedPlacements, place: int) -> MountingCheck:
        """Return the answer of the other placements, and what is wrong with this one."""
        remaining = np.arange(len(shared.names)) != place
        reason = "the board moved between the pictures of this placement"
        rejected = tuple(
            RejectedView(camera, shared.names[place], reason)
            for camera in sorted(
                c.name for c, placed in shared.groups if bool((placed.placement == place).any())
            )
        )
        check = self.run(shared.select(remaining))
        return replace(check, rejected=(*rejected, *check.rejected))

    def _explain(
        self, shared: SharedPlacements, predictive: PosteriorPredictive, gross: bool
    ) -> tuple[list[RigHypothesis], PosteriorPredictive]:
        """Return the explanations, the most probable first. A large motion is linearised where it
        fits, and extrapolated from there.
        """
        ranking = rank_rig_hypotheses(self.linear, predictive, self.movable, self.scatter.typical)
        followers = {camera.name for camera in self.linear.cameras if camera.follower}
        for _ in range(MAX_ROUNDS if gross else 0):
            best = next(h for h in ranking if h.name in KINDS or h.name == BAD_PLACEMENT)
            if best.camera in followers:
                break
            motion = np.zeros(6)
            motion[KINDS.get(best.name, slice(0, 6))] = best.vector
            moves = _moves(best, len(shared.names))
            moved = shared.moved(best.camera, motion, moves)
            predictive = _extrapolated(
                self._tested(moved.predictive()), self.linear.columns()[best.camera], motion, moves
            )
            ranking = rank_rig_hypotheses(
                self.linear, predictive, self.movable, self.scatter.typical
            )
            next_best = ranking[0]
            same = (next_best.name, next_best.camera, next_best.placement) == (
                best.name,
                best.camera,
                best.placement,
            )
            if same:
                step = next_best.vector - best.vector
                if float(step @ np.linalg.solve(next_best.covariance, step)) < CONVERGED**2:
                    break
        return ranking, predictive

    def _places(self, predictive: PosteriorPredictive) -> dict[str, CameraPlace]:
        """Return the pose of each camera, with all of them free."""
        places = self.linear.columns()
        columns = np.concatenate([np.r_[places[name]] for name in self.reported])
        information, score = marginal(predictive, columns)
        covariance = np.linalg.inv(information)
        motions = -covariance @ score
        result = {}
        for index, name in enumerate(self.reported):
            entries = slice(6 * index, 6 * index + 6)
            motion = motions[entries]
            block = covariance[entries, entries]
            scale = self.scatter.by_change.get(name, 1.0)
            square = float(motion @ np.linalg.solve(block, motion)) / 6
            freedom = min(self.scatter.freedom.get(name, np.inf), 1e9)
            p_value = float(fdtrc(6, freedom, square / scale))
            block = np.asarray(block * scale)
            mounting = torch.from_numpy(self.rig.mountings[self.rig.index(name)])
            result[name] = CameraPlace(
                T_camera_reference=pose_matrix(compose(torch.from_numpy(motion), mounting)),
                motion=-motion,
                sigma=np.sqrt(block.diagonal()),
                turned=size_and_sigma(motion[:3], np.asarray(block[:3, :3])),
                moved=size_and_sigma(motion[3:], np.asarray(block[3:, 3:])),
                p_value=p_value,
                z=float(-ndtri(max(p_value, MIN_P_VALUE) / 2)),
            )
        return result


def _moves(hypothesis: RigHypothesis, count: int) -> NDArray[np.bool_]:
    """Return the (P,) mask of the placements that a motion is in."""
    index = np.arange(count)
    if hypothesis.name == BAD_PLACEMENT:
        return np.asarray(index == hypothesis.placement)
    return np.asarray(index >= hypothesis.placement)


def _extrapolated(
    predictive: PosteriorPredictive, place: slice, motion: Array, moves: NDArray[np.bool_]
) -> PosteriorPredictive:
    """Return the products with the residual of no motion, by the derivatives at a (6,) motion."""
    products = predictive.products.copy()
    change = np.eye(products.shape[1])
    change[place, 0] = -motion
    products[moves] = change.T @ products[moves] @ change
    return replace(predictive, products=products)


def _added_px(hypothesis: RigHypothesis, shift: Array) -> float | None:
    """Return the root mean square shift of the corners by a change, with the placements adapted;
    None for a change without a size.

    Args:
        shift: (P, n, n) px^2.
    """
    if not len(hypothesis.columns):
        return None
    moves = _moves(hypothesis, len(shift))
    metric = shift[moves].sum(0)[np.ix_(hypothesis.columns, hypothesis.columns)]
    return float(max(0.0, float(hypothesis.vector @ metric @ hypothesis.vector)) ** 0.5)
