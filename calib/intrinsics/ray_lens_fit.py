"""Fit the intrinsics of a lens that cv2.calibrateCamera lacks, by a joint fit of its rays to views
of a board.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.corners.view import View
from calib.estimation.joint_fit import ROUNDS, WARM_ROUNDS, JointFit, fit_joint
from calib.estimation.observations import Observations
from calib.estimation.poses import pinhole_poses, rough_poses
from calib.estimation.priors import Priors
from calib.estimation.residuals import residuals
from calib.intrinsics.advice import NoFitError
from calib.intrinsics.joint_intrinsics import estimated_intrinsics
from calib.intrinsics.ray_lens import RayLens
from calib.optics.build import pinhole_path
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.splined_fisheye import SHIFTS, Grid, SplinedFisheye
from calib.session.board import Board
from calib.session.camera import Intrinsics
from calib.session.lens import FISHEYE, NAMES, SPLINED
from calib.session.lens_spline import MIN_CONTROL_POINTS, LensSpline
from calib.session.parameter_names import CAMERA
from calib.session.schema import Number
from calib.threads import single_thread

FOCALS = tuple(2.0 ** (step / 2) for step in range(-5, 4))
"""Focal lengths over the picture's longer side from which the search starts, from 0.18 (a picture
320 degrees wide) to 2.8 (20 degrees).
"""
MAX_START_VIEWS = 8
"""The most views that choose the start."""
FACTORS = tuple(10.0 ** (step / 2) for step in range(-4, 3))
"""Candidate sizes of a spline's prior, in multiples of
`calib.optics.splined_fisheye.PRIOR_SCALE`.
"""
LOOSE_FOCAL, LOOSE_CENTRE, LOOSE_COEFFICIENT = 1.0, 0.5, 1.0
"""Standard deviations of priors that constrain nothing: of a focal length, relative to it; of the
principal point, relative to the picture's longer side; of a coefficient.
"""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LensFit:
    """A lens that is fitted to views through its rays."""

    path: Path
    values: Values
    joint: JointFit
    per_view: Array
    """(V,) root mean square error of each fitted view, px, over the corners that the lens sees."""
    rms: float
    """Root mean square error of all fitted views, px."""

    @property
    def poses(self) -> Array:
        """Return the (V, 6) T_camera_board: rotation vector (rad) and translation (m)."""
        return np.asarray(self.joint.poses.numpy(), np.float64)

    @property
    def intrinsics(self) -> Intrinsics:
        """Return the intrinsics with standard deviations and correlations."""
        zero = Number(0.0)
        model = SPLINED if self.spline else FISHEYE
        lens = Intrinsics(zero, zero, zero, zero, (zero,) * 4, model=model, spline=self.spline)
        return estimated_intrinsics(self.joint, lens)

    @property
    def spline(self) -> LensSpline | None:
        """Return the spline of the lens, or None for a plain fisheye."""
        lens = self.path.lens
        if not isinstance(lens, SplinedFisheye):
            return None
        grid = lens.grid
        shift_x, shift_y = SHIFTS
        x = tuple(self.values[shift_x].tolist())
        y = tuple(self.values[shift_y].tolist())
        return LensSpline(grid.size, *grid.shape, x, y)

    def errors(self, views: Sequence[View], board: Board) -> Array:
        """Return the (V,) root mean square errors, px, of views that it was not fitted to, with
        their poses refitted; NaN for a view that the lens does not see.
        """
        observations = Observations.of(views, board)
        image = residuals(
            self.path,
            self.values,
            observations,
            pinhole_poses(self.path, self.values, observations),
        ).image
        return np.array(
            [float((error**2).sum(-1).mean().sqrt()) for error in observations.per_view(image)]
        )


def fit_lens(
    lens: RayLens,
    views: Sequence[View],
    board: Board,
    size: tuple[int, int],
    start: LensFit | None = None,
) -> LensFit:
    """Fit the focal lengths, principal point and coefficients of a lens, and the control points of
    a spline.

    Args:
        views: views with enough corners for a pose.
        size: width and height of the picture, px.
        start: the fit of a simpler lens to the same views.

    Raises:
        NotEnoughDataError: no such lens sees these views.
    """
    with single_thread():
        path, values = (
            (Path(start.path.lens), start.values) if start else _initial_lens(views, board, size)
        )
        priors = _loose_priors(values, size)
        observations = Observations.of(views, board)
        plain = start or _fit(path, values, observations, priors)
        return (
            _with_spline(plain, lens.columns, size, observations, priors) if lens.columns else plain
        )


def _fit(
    path: Path,
    values: Values,
    observations: Observations,
    priors: Priors,
    earlier: JointFit | None = None,
) -> LensFit:
    poses = earlier.poses if earlier else pinhole_poses(path, values, observations)
    if not bool(torch.isfinite(poses).all()):
        raise NoFitError()
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
        raise NoFitError()
    residual = residuals(path, joint.values, observations, joint.poses)
    return LensFit(path, joint.values, joint, residual.view_errors(observations), residual.rms_px)


def _with_spline(
    plain: LensFit, columns: int, size: tuple[int, int], observations: Observations, priors: Priors
) -> LensFit:
    """Extend the fit of a fisheye with a spline. Its cells are about square, and the size of its
    prior has the largest evidence.
    """
    rows = max(MIN_CONTROL_POINTS, round((columns - 3) * size[1] / size[0]) + 3)
    grid = Grid(size, (columns, rows))
    flat = torch.zeros(columns * rows, dtype=torch.float64)
    path = Path(SplinedFisheye(grid))
    values = {**plain.values, **dict.fromkeys(SHIFTS, flat)}

    def priors_of_size(factor: float) -> Priors:
        roots = dict.fromkeys(SHIFTS, factor * grid.prior_root())
        return Priors({**priors.sigmas, **dict.fromkeys(SHIFTS, 1.0)}, roots=roots)

    first = _fit(path, values, observations, priors_of_size(1.0), plain.joint).joint
    return _fit(path, values, observations, priors_of_size(_most_probable_size(first)), first)


def _most_probable_size(fit: JointFit) -> float:
    """Return the factor on the size of a fit's prior of the control points with the largest
    evidence, to first order, with the priors of all other parameters unchanged.
    """
    precision = np.linalg.inv(fit.covariance.numpy())
    root = fit.parameters.free_root()
    prior = np.linalg.inv(root @ root.T)
    score = precision @ fit.parameters.vector(fit.values).numpy()
    control_points = fit.parameters.entries(SHIFTS)

    def evidence(factor: float) -> float:
        wider = root.copy()
        wider[control_points] *= factor
        weighted = np.eye(len(root)) + wider.T @ (precision - prior) @ wider
        scaled = wider.T @ score
        return (
            float(scaled @ np.linalg.solve(weighted, scaled) - np.linalg.slogdet(weighted)[1]) / 2
        )

    return float(max(FACTORS, key=evidence))


def _initial_lens(
    views: Sequence[View], board: Board, size: tuple[int, int]
) -> tuple[Path, Values]:
    """Return the equidistant lens whose focal length fits a sample of the views best."""
    sample = views[:: -(-len(views) // MAX_START_VIEWS)]
    observations = Observations.of(sample, board)
    candidates = []
    for factor in FOCALS:
        path, values = _equidistant(factor * max(size), size)
        poses = rough_poses(path, values, observations)
        if not bool(torch.isfinite(poses).all()):
            continue
        image = residuals(path, values, observations, poses).image
        error = float((image**2).sum(-1).nanmedian())
        candidates.append((error, path, values))
    if not candidates:
        raise NoFitError()
    _, path, values = min(candidates, key=lambda candidate: candidate[0])
    return path, values


def _equidistant(focal: float, size: tuple[int, int]) -> tuple[Path, dict[str, Tensor]]:
    cx = Number((size[0] - 1) / 2)
    cy = Number((size[1] - 1) / 2)
    return pinhole_path(
        Intrinsics(Number(focal), Number(focal), cx, cy, (Number(0.0),) * 4, model=FISHEYE)
    )


def _loose_priors(values: Values, size: tuple[int, int]) -> Priors:
    focal = LOOSE_FOCAL * float(values[CAMERA.fx])
    centre = LOOSE_CENTRE * max(size)
    pinhole = {CAMERA.fx: focal, CAMERA.fy: focal, CAMERA.cx: centre, CAMERA.cy: centre}
    return Priors(pinhole | {CAMERA.of(name): LOOSE_COEFFICIENT for name in NAMES[FISHEYE]})
