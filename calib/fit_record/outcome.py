"""The outcome of a fit: its choices, its remarks on the views, its noise and its evidence."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from calib.estimation.joint_fit import JointFit
from calib.estimation.surface_prior import Smoothness
from calib.fit_record.request import IntrinsicsSource

MIN_SHAPE_LOG_ODDS = math.log(100)
"""The log odds below which a shape is as probable as the chosen one."""
OVERFIT_RATIO = 1.25
"""Ratio of held-out to fitted error above which a fit overfits. The fitted poses explain a smaller
ratio.
"""


@dataclass(frozen=True, slots=True)
class CrossValidation:
    """The errors when each view is held out once and only its pose is refitted."""

    folds: int
    held_out_px: float
    """Root mean square two-dimensional reprojection error."""
    fitted_px: float
    """The same error of the fitted views, over all folds."""
    held_out_sigma_px: float = 0.0
    """Standard deviation of `held_out_px`, from the spread over poses; 0 if unknown."""

    @property
    def overfits(self) -> bool:
        return self.held_out_px > OVERFIT_RATIO * self.fitted_px


@dataclass(frozen=True, slots=True)
class Redetection:
    """The result of the second look for corners in one picture."""

    file: str
    new_corners: int
    """Corners that the first detection lacked."""
    refused: int
    """Corners that the model predicts inside the picture but that do not look like corners there,
    or that have no neighbour which does.
    """
    dropped: int
    """Corners of the first detection that do not look like corners once their edges are curved as
    the model predicts.
    """


@dataclass(frozen=True, slots=True)
class FleetPriorTest:
    """The prior of a fleet that a session names, and its test by the views."""

    file: str
    sha256: str
    cameras: int
    """Number of cameras that made the prior."""
    used: bool
    """False if the views contradict the prior, so that the fit left it out."""
    p_value: float
    farthest: str
    """The number that the views pull farthest; empty if there is none."""
    farthest_sigmas: float


@dataclass(frozen=True, slots=True)
class JointOutcome:
    """The outcome of the joint fit, or of an update by a check."""

    outcome: str
    """A sentence of `calib.estimation.levenberg_marquardt.Outcome`."""
    iterations: int
    sigma_px: float
    """The standard deviation of a corner in x and in y."""
    log_evidence: float | None = None
    """The logarithm of the evidence (`JointFit.log_evidence`); None after an update of a
    calibration that has none.
    """
    relief_prior: Smoothness | None = None
    """The prior of the relief's texture, by the evidence; None without a relief."""

    @staticmethod
    def of(joint: JointFit) -> JointOutcome:
        return JointOutcome(
            outcome=joint.outcome.value,
            iterations=joint.iterations,
            sigma_px=joint.sigma,
            log_evidence=joint.log_evidence,
            relief_prior=joint.smoothness,
        )


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """How the covariance of a fit counts views and corners of the board."""

    views: int
    """The number of different poses of the board."""
    inflation: float
    """The root mean square, over what the corners determine, of the standard deviations over those
    of independent corners.
    """
    view_scatter: float
    """The scatter of the views about the fit, over that of independent corners."""
    corner_scatter: float
    """The same of the corners of the board, each in all views: what its print leaves."""
    heavy_views: Mapping[str, float] = field(default_factory=dict)
    """The views that tell more than a tenth of what all tell, by file, with that part."""
    method: str = "views and board corners"

    @property
    def heavy_sentence(self) -> str:
        """A sentence on the views that tell most; empty if there are none."""
        shares = [f"{name} ({100 * share:.0f} %)" for name, share in self.heavy_views.items()]
        if not shares:
            return ""
        listed = " and ".join(filter(None, [", ".join(shares[:-1]), shares[-1]]))
        these = "this" if len(shares) == 1 else "these"
        return (
            f"Much of the result comes from {listed}: more pictures like {these} would make it"
            " safer."
        )


@dataclass(frozen=True, slots=True)
class FitOutcome:
    """The outcome that a calibration records. None stands for what is not recorded."""

    grid_held_out_px: Mapping[str, float] | None = None
    """The held-out error of each tried grid; empty if the request names the grid."""
    intrinsics_from: IntrinsicsSource | None = None
    shape_log_odds: Mapping[str, float] | None = None
    """The logarithm of the odds of each shape of the cover against the most probable one, which the
    fit chose; None if the session states the shape.
    """
    shape_map_changes_px: Mapping[str, float] | None = None
    """By how many px the maps would differ with each shape that explains the views as well; None if
    there is no such shape.
    """
    shape_camera_sigma: Mapping[str, float] | None = None
    """px: the standard deviation of fx, fy, cx and cy that the shapes which explain the views as
    well have together, or uneven glass and `rival_lens`; None if there is one explanation.
    """
    rival_lens: Mapping[str, float] | None = None
    """px: fx, fy, cx and cy of another lens with which even glass explains the views about as well
    as uneven glass and the declared lens; None if there is none.
    """
    medium_log_odds: Mapping[str, float] | None = None
    """The log odds of air and of water outside of the cover, where other numbers are unknown; None
    if they were not compared.
    """
    lens_held_out_px: Mapping[str, float] | None = None
    """The held-out error of each tried lens model; empty if there was no choice."""
    turned_boards: tuple[str, ...] | None = None
    """The views whose corners were renumbered, because the board is turned by a quarter turn there;
    None if there are none.
    """
    half_turned_boards: tuple[str, ...] | None = None
    """The same for half a turn."""
    mixed_settings: tuple[str, ...] = ()
    """Sentences on differences between the pictures that one calibration cannot have."""
    redetections: tuple[Redetection, ...] | None = None
    outlier_corners: Mapping[str, int] | None = None
    """The number of corners that were left out of each view, by file; None if there are none."""
    view_noise: Mapping[str, float] | None = None
    """The noise of each noisy view over that of the median view, by file."""
    cross_validation: CrossValidation | None = None
    """None if the request has no folds."""
    fleet_prior: FleetPriorTest | None = None
    """None if the session names no prior."""
    uncertainty: Uncertainty | None = None
    """How the covariance counts views and corners of the board; None if it counts every corner of
    every view as independent.
    """
    joint: JointOutcome | None = None
    """None if no joint fit was made: a camera without a cover, or the paper's method."""

    @property
    def probable_shapes(self) -> tuple[str, ...]:
        """The shapes that the views hardly tell apart, the most probable first; empty if the
        session states the shape.
        """
        odds = self.shape_log_odds or {}
        ranked = sorted(odds, key=lambda name: -odds[name])
        return tuple(name for name in ranked if odds[name] > -MIN_SHAPE_LOG_ODDS)
