"""The intrinsics of a lens that cv2.calibrateCamera does not know, by the joint fit of its rays to views of a board."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.corners.view import View
from calib.errors import NotEnoughDataError
from calib.estimation.joint_fit import JointFit, fit_joint
from calib.estimation.observations import Observations
from calib.estimation.poses import pinhole_poses
from calib.estimation.priors import Priors
from calib.estimation.residuals import residuals
from calib.optics.build import pinhole_path
from calib.optics.params import Values
from calib.optics.path import Path
from calib.session.board import Board
from calib.session.camera import Intrinsics
from calib.session.lens import FISHEYE, NAMES
from calib.session.schema import Number
from calib.threads import single_thread

BY_RAYS = (FISHEYE,)
"""The models that are fitted here."""
FOCALS = tuple(2.0 ** (step / 2) for step in range(-5, 4))
"""Of the picture's longer side: where the search begins, from 0.18 (a picture 320 degrees wide) to 2.8 (20 degrees)."""
MOST_TRIED = 8
"""Views that choose among them."""
LOOSE_FOCAL, LOOSE_CENTRE, LOOSE_COEFFICIENT = 1.0, 0.5, 1.0
"""Standard deviations of priors that hold nothing back: of the focal length, of the picture's longer side, and as they are."""
NO_FIT = "No intrinsics fit these views: take pictures of the board tilted in different directions, and check board.columns and board.rows."

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LensFit:
    """A lens that was fitted."""

    path: Path
    values: Values
    joint: JointFit
    per_view: Array
    """(V,) px, the root mean square of each view that it was fitted to."""
    rms: float
    """px, of them together."""

    @property
    def poses(self) -> Array:
        """(V, 6)"""
        return np.asarray(self.joint.poses.numpy(), np.float64)

    def intrinsics(self, views: Sequence[View], board: Board) -> Intrinsics:
        """With each number's standard deviation, and how they are correlated."""
        del views, board
        found = self.joint.estimates()
        fx, fy, cx, cy, *lens = (found[param.name] for param in self.joint.parameters.free)
        covariance = self.joint.covariance.numpy()
        sigmas = np.sqrt(covariance.diagonal())
        correlation = covariance / np.outer(sigmas, sigmas)
        rows = tuple(tuple(row[:i].tolist()) for i, row in enumerate(correlation) if i)
        return Intrinsics(fx, fy, cx, cy, tuple(lens), rows, FISHEYE)

    def errors(self, views: Sequence[View], board: Board) -> Array:
        """(V,) px, the root mean square of views that it was not fitted to, their poses fitted; NaN for one that has none."""
        observations = Observations.of(views, board)
        image = residuals(self.path, self.values, observations, pinhole_poses(observations, self.values)).image
        return _by_view(observations, image)


def fit_lens(model: str, views: Sequence[View], board: Board, size: tuple[int, int]) -> LensFit:
    """Focal lengths, principal point and coefficients of a lens.

    Args:
        model: of BY_RAYS.
        views: with corners enough for a pose.
        size: px, of the picture.

    Raises:
        NotEnoughDataError: no such lens sees these views.
    """
    assert model == FISHEYE
    with single_thread():
        path, values = _begun(views, board, size)
        observations = Observations.of(views, board)
        poses = pinhole_poses(observations, values)
        if not bool(torch.isfinite(poses).all()):
            raise NotEnoughDataError(NO_FIT)
        joint = fit_joint(path, values, observations, poses, priors=_loose(values, size))
        if not joint.finite:
            raise NotEnoughDataError(NO_FIT)
        image = residuals(path, joint.values, observations, joint.poses).image
        return LensFit(path, joint.values, joint, _by_view(observations, image), float((image**2).sum(-1).nanmean().sqrt()))


def _begun(views: Sequence[View], board: Board, size: tuple[int, int]) -> tuple[Path, Values]:
    """The equidistant lens whose focal length suits some of the views best."""
    some = views[:: -(-len(views) // MOST_TRIED)]
    observations = Observations.of(some, board)
    tried = []
    for factor in FOCALS:
        path, values = _equidistant(factor * max(size), size)
        poses = pinhole_poses(observations, values)
        seen = torch.isfinite(poses).all(-1)
        if not bool(seen.all()):
            continue
        image = residuals(path, values, observations, poses).image
        error = float((image**2).sum(-1).nanmedian())
        tried.append((error, path, values))
    if not tried:
        raise NotEnoughDataError(NO_FIT)
    _, path, values = min(tried, key=lambda one: one[0])
    return path, values


def _equidistant(focal: float, size: tuple[int, int]) -> tuple[Path, dict[str, Tensor]]:
    cx, cy = (Number((length - 1) / 2) for length in size)
    return pinhole_path(Intrinsics(Number(focal), Number(focal), cx, cy, (Number(0.0),) * 4, model=FISHEYE))


def _by_view(observations: Observations, image: Tensor) -> Array:
    """(V,) root mean square of (M, 2) residuals; NaN for a view that has a residual that is."""
    return np.array([float((own**2).sum(-1).mean().sqrt()) for own in observations.per_view(image)])


def _loose(values: Values, size: tuple[int, int]) -> Priors:
    focal, centre = LOOSE_FOCAL * float(values["camera.fx"]), LOOSE_CENTRE * max(size)
    pinhole = {"camera.fx": focal, "camera.fy": focal, "camera.cx": centre, "camera.cy": centre}
    return Priors(pinhole | {f"camera.{name}": LOOSE_COEFFICIENT for name in NAMES[FISHEYE]})
