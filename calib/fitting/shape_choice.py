"""The choice of the shape of a cover that nobody knows, by marginal likelihood."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from calib.corners.view import View
from calib.effects.board_shape import DEGREES, BoardShape
from calib.errors import NotEnoughDataError
from calib.estimation.joint_fit import ROUNDS
from calib.estimation.observations import Observations
from calib.fit_record.outcome import MIN_SHAPE_LOG_ODDS
from calib.fit_record.request import EVEN_GRID, Settings
from calib.fitting.fitted import Fitted
from calib.fitting.setup import Setup
from calib.fitting.stages import fit_or_none
from calib.fitting.unknown_numbers import with_initial_values
from calib.progress import Progress
from calib.session.freeing import ALL, AUTO, free_parameters
from calib.session.parameter_names import CAMERA, number_of
from calib.session.shapes.none import NONE
from calib.session.shapes.registry import find_dimension, shape_names
from calib.threads import single_thread

AS_GOOD = 1.02
"""The error of a shape over that of no cover up to which it explains the views as well."""


@dataclass(frozen=True, slots=True)
class ShapeChoice:
    """The most probable shape."""

    setup: Setup
    """The setup with a cover of this shape."""
    log_odds: Mapping[str, float]
    """The logarithm of the odds of each shape against the most probable one: 0 for this one. A
    shape that cannot be fitted has none.
    """
    map_changes_px: Mapping[str, float]
    """By how many px the maps would differ with each rival: each shape that is about as probable,
    and if no cover is the most probable, each that leaves the same error. A cover of which nobody
    knows anything is less probable by the widths of its priors alone.
    """
    camera_sigma: Mapping[str, float]
    """px: the standard deviation of fx, fy, cx and cy that the shape and its rivals have together,
    each as probable; empty without rivals.
    """


def choose_shape(
    setup: Setup, views: Sequence[View], settings: Settings, progress: Progress
) -> ShapeChoice:
    """Return the most probable shape of the cover, each fitted to the same corners with even glass.
    The board may be bent. Every shape has the same tolerances of the intrinsics.

    Raises:
        NotEnoughDataError: no shape can be fitted.
        InputError: the settings name a number that a cover of unknown shape lacks.
    """
    free = (ALL,) if AUTO in settings.free else settings.free
    intrinsics, _ = free_parameters(setup.intrinsics, setup.cover, free)
    settings = replace(settings, free=free, grid=EVEN_GRID, flat_board=True)
    observations = Observations.of(views, setup.board)
    setups: dict[str, Setup] = {}
    evidence: dict[str, float] = {}
    fits: dict[str, Fitted] = {}
    for name in shape_names():
        declared = setup.intrinsics if setup.cover.as_shape(name).parameters else intrinsics
        candidate = replace(setup, intrinsics=declared, cover=setup.cover.as_shape(name))
        with single_thread():
            candidate = with_initial_values(candidate, views, progress)
            fitted = fit_or_none(candidate, views, settings, progress, name)
            if fitted is None or not _is_within_limits(fitted):
                continue
            setups[name] = candidate
            fits[name] = fitted
            evidence[name] = _log_marginal(fitted, candidate, observations)
    if not evidence:
        raise NotEnoughDataError(
            "No shape of cover explains these views: check board.square_mm, and take more pictures"
            " of the board, tilted and at several distances."
        )
    best = max(evidence, key=evidence.__getitem__)
    log_odds = {name: value - evidence[best] for name, value in evidence.items()}
    largest_error = AS_GOOD * fits[best].residuals.rms_px
    rivals = [
        name
        for name, fitted in fits.items()
        if name != best
        and (
            log_odds[name] > -MIN_SHAPE_LOG_ODDS
            or (best == NONE.name and fitted.residuals.rms_px <= largest_error)
        )
    ]
    return ShapeChoice(
        setups[best],
        log_odds,
        {name: _map_change(fits[best], fits[name], observations) for name in rivals},
        camera_sigma([fits[name] for name in (best, *rivals)]) if rivals else {},
    )


def _is_within_limits(fitted: Fitted) -> bool:
    """Return False if a number of the cover has a value that session.yaml does not allow: the shape
    imitates something else, such as water that nobody declared.
    """
    for name, value in fitted.values.items():
        if not (dimension := find_dimension(number_of(name))):
            continue
        quantity = dimension.quantity
        if not quantity.low <= float(value) * quantity.unit[1] <= quantity.high:
            return False
    return True


def camera_sigma(fits: Sequence[Fitted]) -> dict[str, float]:
    """Return the standard deviation in px of the numbers of the pinhole that the fits estimate,
    from the values of the first fit, if each of the fits is as probable.
    """
    joints = [fitted.joint for fitted in fits if fitted.joint]
    estimated = [{param.name for param in joint.parameters.free} for joint in joints]
    sigma = {}
    for name in filter(set.intersection(*estimated).__contains__, CAMERA.pinhole):
        values = np.array([float(joint.values[name]) for joint in joints])
        sigmas = np.array([float(joint.sigma_of(name)) for joint in joints])
        sigma[name] = float(np.sqrt(np.mean(sigmas**2) + np.mean((values - values[0]) ** 2)))
    return sigma


def _map_change(fitted: Fitted, rival: Fitted, observations: Observations) -> float:
    """Return the median distance in px, over the corners, of two fits' undistorted pixels at the
    corners' depths.
    """
    poses = fitted.poses[observations.view]
    exposure = observations.exposure
    points = fitted.path.place(observations.corners, fitted.values, poses, exposure)
    undistorted = [_undistort(fit, observations, points[:, 2]) for fit in (fitted, rival)]
    return float(torch.nanmedian((undistorted[0] - undistorted[1]).norm(dim=-1)))


def _undistort(fitted: Fitted, observations: Observations, depth: Tensor) -> Tensor:
    """Return the (M, 2) px of the bare pinhole camera that shows what the corners' rays meet at
    (M,) m.
    """
    values = fitted.values
    rays = fitted.path.trace(observations.pixels, values, observations.exposure)
    origin, direction = rays.origin, rays.direction
    reach = (depth - origin.z) / direction.z
    x = values[CAMERA.fx] * (origin.x + reach * direction.x) / depth + values[CAMERA.cx]
    y = values[CAMERA.fy] * (origin.y + reach * direction.y) / depth + values[CAMERA.cy]
    return torch.stack([x, y], -1)


def _log_marginal(fitted: Fitted, setup: Setup, observations: Observations) -> float:
    """Return the logarithm of the marginal likelihood, of a bent board if that is more probable."""
    joint, model = fitted.joint, fitted.model
    assert joint
    assert model
    if not setup.board.is_flat:
        return joint.log_marginal
    bent = model.with_effect(BoardShape(*setup.board.half, DEGREES[-1]))
    log_bent = bent.fit(observations, joint.poses, joint.start, ROUNDS).log_marginal
    return max(joint.log_marginal, log_bent)
