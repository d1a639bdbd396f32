"""The intrinsics of a lens that cv2.calibrateCamera does not know, by the joint fit of its rays to
views of a board.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.corners.view import View
from calib.errors import NotEnoughDataError
from calib.estimation.joint_fit import ROUNDS, WARM_ROUNDS, JointFit, fit_joint
from calib.estimation.observations import Observations
from calib.estimation.poses import pinhole_poses, rough_poses
from calib.estimation.priors import Priors
from calib.estimation.residuals import residuals
from calib.intrinsics.advice import NO_FIT
from calib.intrinsics.ray_lens import RayLens
from calib.optics.build import pinhole_path
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.splined_fisheye import GRID, SHIFTS, Grid, SplinedFisheye
from calib.session.board import Board
from calib.session.camera import Intrinsics
from calib.session.lens import FISHEYE, NAMES, SPLINED
from calib.session.lens_spline import MIN_CONTROL_POINTS, Spline
from calib.session.schema import Number
from calib.threads import single_thread

FOCALS = tuple(2.0 ** (step / 2) for step in range(-5, 4))
"""Of the picture's longer side: where the search begins, from 0.18 (a picture 320 degrees wide) to
2.8 (20 degrees).
"""
MOST_TRIED = 8
"""Views that choose among them."""
FACTORS = tuple(10.0 ** (step / 2) for step in range(-4, 3))
"""Sizes of a spline that are tried, times `calib.optics.splined_fisheye.PRIOR_SCALE`."""
LOOSE_FOCAL, LOOSE_CENTRE, LOOSE_COEFFICIENT = 1.0, 0.5, 1.0
"""Standard deviations of priors that hold nothing back: of the focal length, of the picture's
longer side, and as they are.
"""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LensFit:
    """A lens that was fitted."""

    path: Path
    values: Values
    joint: JointFit
    per_view: Array
    """(V,) px, the root mean square of each view that it was fitted to, over the corners that it
    sees.
    """
    rms: float
    """px, of them together."""

    @property
    def poses(self) -> Array:
        """(V, 6)"""
        return np.asarray(self.joint.poses.numpy(), np.float64)

    @property
    def intrinsics(self) -> Intrinsics:
        """With each number's standard deviation, and how they are correlated."""
        found = self.joint.estimates()
        fx, fy, cx, cy, *lens = found.values()
        covariance = self.joint.covariance.numpy()[: len(found), : len(found)]
        sigmas = np.sqrt(covariance.diagonal())
        correlation = covariance / np.outer(sigmas, sigmas)
        rows = tuple(tuple(row[:i].tolist()) for i, row in enumerate(correlation) if i)
        return Intrinsics(
            fx, fy, cx, cy, tuple(lens), rows, SPLINED if self.spline else FISHEYE, self.spline
        )

    @property
    def spline(self) -> Spline | None:
        if GRID not in self.values:
            return None
        grid = Grid.of(self.values)
        x, y = (tuple(self.values[name].tolist()) for name in SHIFTS)
        return Spline(grid.size, *grid.shape, x, y)

    def errors(self, views: Sequence[View], board: Board) -> Array:
        """(V,) px, the root mean square of views that it was not fitted to, their poses fitted; NaN
        for one that it does not see.
        """
        observations = Observations.of(views, board)
        image = residuals(
            self.path, self.values, observations, pinhole_poses(observations, self.values)
        ).image
        return np.array(
            [float((own**2).sum(-1).mean().sqrt()) for own in observations.per_view(image)]
        )


def fit_lens(
    lens: RayLens,
    views: Sequence[View],
    board: Board,
    size: tuple[int, int],
    start: LensFit | None = None,
) -> LensFit:
    """Focal lengths, principal point and coefficients of a lens, and the control points of a
    spline.

    Args:
        views: with corners enough for a pose.
        size: px, of the picture.
        start: of a simpler lens to the same views.

    Raises:
        NotEnoughDataError: no such lens sees these views.
    """
    with single_thread():
        path, values = (
            (Path(start.path.lens), start.values) if start else _begun(views, board, size)
        )
        priors = _loose(values, size)
        observations = Observations.of(views, board)
        plain = start or _fitted(path, values, observations, priors)
        return (
            _with_spline(plain, lens.columns, size, observations, priors) if lens.columns else plain
        )


def _fitted(
    path: Path,
    values: Values,
    observations: Observations,
    priors: Priors,
    earlier: JointFit | None = None,
) -> LensFit:
    poses = earlier.poses if earlier else pinhole_poses(observations, values)
    if not bool(torch.isfinite(poses).all()):
        raise NotEnoughDataError(NO_FIT)
    start = earlier.start if earlier and earlier.values.keys() == values.keys() else None
    joint = fit_joint(
        path,
        values,
        observations,
        poses,
        priors=priors,
        start=start,
        rounds=WARM_ROUNDS if start else ROUNDS,
    )
    if not joint.finite:
        raise NotEnoughDataError(NO_FIT)
    image = residuals(path, joint.values, observations, joint.poses).image
    squared = (image**2).sum(-1)
    per_view = np.array([float(own.nanmean().sqrt()) for own in observations.per_view(squared)])
    return LensFit(path, joint.values, joint, per_view, float(squared.nanmean().sqrt()))


def _with_spline(
    plain: LensFit, columns: int, size: tuple[int, int], observations: Observations, priors: Priors
) -> LensFit:
    """A fisheye's fit with a spline, whose cells are about square, and whose prior is of the size
    with the largest evidence.
    """
    rows = max(MIN_CONTROL_POINTS, round((columns - 3) * size[1] / size[0]) + 3)
    grid = Grid(size, (columns, rows))
    flat = torch.zeros(columns * rows, dtype=torch.float64)
    path, values = (
        Path(SplinedFisheye(grid)),
        {
            **plain.values,
            **dict.fromkeys(SHIFTS, flat),
            GRID: grid.encoded,
        },
    )

    def of_size(factor: float) -> Priors:
        roots = dict.fromkeys(SHIFTS, factor * grid.prior_root())
        return Priors({**priors.sigmas, **dict.fromkeys(SHIFTS, 1.0)}, roots=roots)

    first = _fitted(path, values, observations, of_size(1.0), plain.joint).joint
    return _fitted(path, values, observations, of_size(_most_probable(first)), first)


def _most_probable(fit: JointFit) -> float:
    """Times the size of a fit's prior of the control points: the size with the largest evidence, to
    first order, all else being known as well as the fit's prior has it.
    """
    precision, root = np.linalg.inv(fit.covariance.numpy()), fit.parameters.free_root()
    prior = np.linalg.inv(root @ root.T)
    score = precision @ fit.parameters.vector(fit.values).numpy()
    own = fit.parameters.entries(SHIFTS)

    def evidence(factor: float) -> float:
        wider = root.copy()
        wider[own] *= factor
        weighed = np.eye(len(root)) + wider.T @ (precision - prior) @ wider
        scaled = wider.T @ score
        return float(scaled @ np.linalg.solve(weighed, scaled) - np.linalg.slogdet(weighed)[1]) / 2

    return float(max(FACTORS, key=evidence))


def _begun(views: Sequence[View], board: Board, size: tuple[int, int]) -> tuple[Path, Values]:
    """The equidistant lens whose focal length suits some of the views best."""
    some = views[:: -(-len(views) // MOST_TRIED)]
    observations = Observations.of(some, board)
    tried = []
    for factor in FOCALS:
        path, values = _equidistant(factor * max(size), size)
        poses = rough_poses(path, values, observations)
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
    return pinhole_path(
        Intrinsics(Number(focal), Number(focal), cx, cy, (Number(0.0),) * 4, model=FISHEYE)
    )


def _loose(values: Values, size: tuple[int, int]) -> Priors:
    focal, centre = LOOSE_FOCAL * float(values["camera.fx"]), LOOSE_CENTRE * max(size)
    pinhole = {"camera.fx": focal, "camera.fy": focal, "camera.cx": centre, "camera.cy": centre}
    return Priors(pinhole | {f"camera.{name}": LOOSE_COEFFICIENT for name in NAMES[FISHEYE]})
