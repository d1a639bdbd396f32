"""Another lens than the declared one, as the rival of uneven glass.

Pictures without the cover that were taken at another zoom or focus, or cropped, give another focal
length or principal point than the lens has under the cover. The figure of uneven glass makes up for
that: the maps are right, and the numbers of the camera and the cover are not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.corners.view import View
from calib.estimation.joint_fit import JointFit
from calib.estimation.observations import Observations
from calib.estimation.prior_conflict import PRIOR_INFLATION, contradicts_prior
from calib.estimation.stated_priors import widen_prior
from calib.fit_record.request import EVEN_GRID, Settings
from calib.fitting.fitted import Fitted
from calib.fitting.setup import Setup
from calib.fitting.stages import fit_stages
from calib.progress import Progress
from calib.session.cover import AUTO
from calib.session.numbers import camera_numbers
from calib.session.parameter_names import CAMERA

MIN_LOG_ODDS = 10.0
"""The log evidence by which even glass with another lens must exceed uneven glass to be taken, or
uneven glass must exceed it to stand alone. A hundred to one is 4.6, and the approximation of the
evidence has an error of its own.
"""
MAX_DIFFERENCE = 3.0
"""Standard deviations by which the changes of the two focal lengths may differ."""


@dataclass(frozen=True, slots=True)
class OtherLens:
    """A fit of even glass, and of a lens that the declared one contradicts."""

    fitted: Fitted
    setup: Setup
    """The setup with wider priors of the numbers that differ."""
    differing: tuple[str, ...]
    """The names of these numbers in the ray path."""
    log_odds: float
    """The log evidence over that of the uneven glass."""

    @property
    def is_more_probable(self) -> bool:
        """True if it is clearly more probable than uneven glass."""
        return self.log_odds > MIN_LOG_ODDS


def find_other_lens(
    uneven: Fitted,
    setup: Setup,
    views: Sequence[View],
    settings: Settings,
    progress: Progress,
) -> OtherLens | None:
    """Return the fit of even glass and another lens, if it leaves noise and is at least about as
    probable as the fit of uneven glass; None otherwise, or if the session states the surface of the
    glass or does not state the lens.

    Args:
        uneven: the fit with the tolerances of `setup`.
    """
    numbers = camera_numbers(setup.intrinsics)
    names = tuple(name for name in CAMERA.pinhole if numbers[name].sigma > 0)
    is_chosen = setup.cover.covers[-1].surface == AUTO and not setup.cover.glass
    is_stated = names and not any(numbers[name].unknown for name in names)
    if not (uneven.relief and uneven.joint and is_chosen and is_stated):
        return None
    observations = Observations.of(views, setup.board)
    if asked := uneven.on_averages:
        even_fit = _even_fit(_widened(setup, names), asked.observations, settings, uneven, progress)
        if not _competes(even_fit, replace(uneven, joint=asked.joint), setup, names):
            return None
    while True:
        wider = _widened(setup, names)
        even_fit = _even_fit(wider, observations, settings, uneven, progress)
        differing = _competes(even_fit, uneven, setup, names)
        if not (differing and even_fit.joint and even_fit.leaves_noise(views, setup.board)):
            return None
        if differing == names:
            log_odds = even_fit.joint.log_evidence - uneven.joint.log_evidence
            return OtherLens(even_fit, wider, names, log_odds)
        names = differing


def _even_fit(
    wider: Setup, observations: Observations, settings: Settings, uneven: Fitted, progress: Progress
) -> Fitted:
    """Return the fit of even glass with the board's bend of the fit of uneven glass."""
    return fit_stages(
        wider,
        observations,
        replace(settings, grid=EVEN_GRID),
        progress,
        decided=uneven,
        purpose="another lens",
    )


def _competes(
    even_fit: Fitted, uneven_fit: Fitted, setup: Setup, names: Sequence[str]
) -> tuple[str, ...]:
    """Return the names of the numbers whose estimates contradict the setup; none where even glass
    is far less probable than uneven glass, or the lens is not possible.
    """
    if not (even_fit.joint and uneven_fit.joint):
        return ()
    differing = _differing(even_fit.joint, setup, names)
    if not (differing and _is_possible(even_fit.joint, setup, differing)):
        return ()
    log_odds = even_fit.joint.log_evidence - uneven_fit.joint.log_evidence
    return differing if log_odds >= -MIN_LOG_ODDS else ()


def _widened(setup: Setup, names: Sequence[str]) -> Setup:
    intrinsics, cover = setup.intrinsics, setup.cover
    for name in names:
        intrinsics, cover = widen_prior(intrinsics, cover, name, PRIOR_INFLATION)
    return replace(setup, intrinsics=intrinsics, cover=cover)


def _differing(joint: JointFit, setup: Setup, names: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the numbers whose estimates contradict the setup."""
    numbers = camera_numbers(setup.intrinsics)
    return tuple(name for name in names if contradicts_prior(joint, name, numbers[name].sigma))


def _is_possible(joint: JointFit, setup: Setup, differing: Sequence[str]) -> bool:
    """Return True if both focal lengths change by the same fraction, or none does: no focus, zoom
    or crop of pictures changes one alone.
    """
    focal = [name for name in CAMERA.focal if name in differing]
    if len(focal) != len(CAMERA.focal):
        return not focal
    numbers = camera_numbers(setup.intrinsics)
    stated = np.array([numbers[name].value for name in focal])
    changes = np.array([float(joint.values[name]) for name in focal]) / stated - 1
    sigmas = np.array(
        [np.hypot(float(joint.sigma_of(name)), numbers[name].sigma) for name in focal]
    )
    return bool(abs(np.diff(changes)[0]) < MAX_DIFFERENCE * np.linalg.norm(sigmas / stated))
