"""The residuals that later pictures of a calibrated rig should have, linearised.

A check compares later pictures with a rig as it was calibrated. For each placement of the board,
this module writes the residuals of all cameras as a linear function of

- the pose of the board in this placement, which is unknown, and therefore eliminated;
- the errors that the calibration itself may have, which its covariance describes;
- a motion of each camera since the calibration;
- changes of each camera, such as another focal length (the registered `changes`).

`LinearRig.predictive` returns the inner products of these columns, from which the check computes
how probable each motion and each change is.

A motion is six numbers, a small rotation (rad) and a translation (m), by which everything outside
moves in the frame of a camera. The camera itself moves the other way.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.calibration import Calibration
from calib.checking.changes import changes_of
from calib.checking.picture_mode import PictureMode
from calib.checking.posterior_predictive import PosteriorPredictive
from calib.checking.prior import MIN_NOISE, fix_relief
from calib.effects.board_scale import BoardScale
from calib.effects.board_shape import BoardShape
from calib.effects.effect import Effect
from calib.estimation.covariance import covariance_root
from calib.estimation.observations import Observations
from calib.estimation.orthogonal_projection import orthonormal_basis, subtract_projection
from calib.estimation.parameters import Parameters
from calib.estimation.view_equations import view_equations
from calib.optics.path import Path
from calib.rig.gauge import mounting_motion
from calib.rig.later_views import PlacedViews
from calib.rig.poses import compose_with_derivatives
from calib.rig.rig import Rig
from calib.rig.rig_geometry import placed_cameras
from calib.rig.triangulation import PlacedCamera

Array = NDArray[np.float64]
MOTION_SIZE = 6
CHECKED_IN_EACH_CAMERA = (PictureMode, BoardScale, BoardShape)
"""Changes that are left to the check of each camera by itself: all cameras see the same board, and
another picture mode is not of first order.
"""


@dataclass(frozen=True, slots=True, eq=False)
class FollowerMounting:
    """The mounting of a camera behind a cover that another camera's session describes."""

    entries: NDArray[np.int64]
    """(6,) places of the mounting among the camera's estimated parameters."""
    by_motion: Array
    """(6, 6) derivatives of the mounting by a motion of the camera."""


@dataclass(frozen=True, slots=True, eq=False)
class LinearCamera:
    """A camera of a calibrated rig, ready to be linearised.

    The rig's covariance is E E^T, with a matrix E of Q columns. A column of E is one error of the
    calibration: the Q errors are independent, and each has unit variance.
    """

    name: str
    path: Path
    parameters: Parameters
    """The estimated parameters, followed by those of the changes."""
    parameters_by_error: Array
    """(S_c, Q) derivatives of the estimated parameters by the errors of the calibration."""
    mounting: Tensor
    """(6,) T_camera_reference. For a follower behind a shared cover, that of the camera whose
    session describes the cover: the follower's boards are placed in that camera's frame.
    """
    mounting_by_error: Array
    """(6, Q) derivatives of `mounting` by the errors of the calibration."""
    sigma: float
    """The noise of a corner, px per axis."""
    follower: FollowerMounting | None
    """None unless another camera's session describes the cover of this one."""
    changes: Mapping[str, NDArray[np.int64]] = field(default_factory=dict)
    """The places of each change's numbers among the parameters."""
    describes_shared_cover: bool = False
    """True if this camera's session describes a cover that other cameras share. Its views do not
    tell its own motion from a motion of that cover.
    """

    def place_views(self, observations: Observations, placements: Tensor) -> PlacedViews:
        """Return views of this camera, mounted as it was calibrated.

        Args:
            observations: the corners of V views.
            placements: (V,) int64, the index of the placement that each view shows.
        """
        values = self.parameters.origin
        return PlacedViews(self.path, values, observations, self.mounting, placements)


@dataclass(frozen=True, slots=True, eq=False)
class _ViewColumns:
    """The linearised residuals of one view's m corners, px over sigma."""

    placement: int
    """The index of the placement that the view shows."""
    by_placement: Array
    """(2m, B) derivatives by the numbers of the placement."""
    columns: Array
    """(2m, n) the residual, then its derivatives in the order of `LinearRig.columns`."""


@dataclass(frozen=True, slots=True, eq=False)
class LinearRig:
    """The cameras of a rig, ready to be linearised."""

    cameras: tuple[LinearCamera, ...]
    changes: Mapping[str, tuple[Effect, ...]]
    """The changes of each camera."""

    @staticmethod
    def of(rig: Rig, *, with_changes: bool = True) -> LinearRig:
        """Prepare a rig with a covariance.

        Args:
            with_changes: False to leave out the changes of the cameras. Cameras that share a cover
                never have any.
        """
        rig_by_error = covariance_root(rig.covariance)  # (numbers of the rig, Q)
        followers = set(rig.covers)
        leaders = set(rig.covers.values())
        changes = {
            name: _changes_between_cameras(calibration)
            if with_changes and name not in followers | leaders
            else ()
            for name, calibration in rig.calibrations.items()
        }
        cameras = []
        for name, placed in zip(rig.names, placed_cameras(rig), strict=True):
            calibration = rig.calibrations[name]
            path, parameters = placed.path, placed.parameters
            parameters_by_error = rig_by_error[placed.columns]
            change_entries: dict[str, NDArray[np.int64]] = {}
            if changes[name]:
                path, parameters, to_fixed, change_entries = _with_changes(
                    calibration, changes[name]
                )
                parameters_by_error = to_fixed @ parameters_by_error
            mounting_by_error = np.zeros((MOTION_SIZE, rig_by_error.shape[1]))
            if len(placed.mounting_columns):
                mounting_by_error = rig_by_error[placed.mounting_columns]
            cameras.append(
                LinearCamera(
                    name=name,
                    path=path,
                    parameters=parameters,
                    parameters_by_error=parameters_by_error,
                    mounting=placed.mounting,
                    mounting_by_error=mounting_by_error,
                    sigma=camera_noise(calibration),
                    follower=_follower_mounting(rig, name, placed) if name in followers else None,
                    changes=change_entries,
                    describes_shared_cover=name in leaders,
                )
            )
        return LinearRig(tuple(cameras), changes)

    @property
    def error_count(self) -> int:
        """Q, the number of independent errors of the calibration."""
        return int(self.cameras[0].mounting_by_error.shape[1])

    def columns(self) -> dict[str, slice]:
        """Return which columns of the products of `predictive` belong to each motion, by the name
        of the camera, and to each change, by "camera.change". Column 0 is the residual, and the
        next Q are the errors of the calibration.
        """
        sizes = {camera.name: MOTION_SIZE for camera in self.cameras}
        for camera in self.cameras:
            sizes |= {f"{camera.name}.{key}": len(rows) for key, rows in camera.changes.items()}
        ends = 1 + self.error_count + np.cumsum([0, *sizes.values()])
        return {
            name: slice(int(first), int(last))
            for name, first, last in zip(sizes, ends, ends[1:], strict=False)
        }

    def predictive(
        self,
        views: Sequence[tuple[LinearCamera, PlacedViews]],
        placements: Tensor,
        noise: Mapping[str, float] = {},
    ) -> PosteriorPredictive:
        """Return the distribution of the residuals of some placements under the calibrated rig.

        Args:
            views: those of each camera; a camera may have several groups, each with a mounting.
            placements: (P, B) T_reference_board, with the bends of the board.
            noise: the noise of each camera's corners over that of its calibration.
        """
        columns = self.columns()
        views_of_placement: dict[int, list[_ViewColumns]] = {}
        for camera, placed in views:
            sigma = camera.sigma * noise.get(camera.name, 1.0)
            for view in self._linearise(camera, placed, placements, sigma, columns):
                views_of_placement.setdefault(view.placement, []).append(view)
        products = []
        degrees_of_freedom = []
        for _, seen_by in sorted(views_of_placement.items()):
            by_placement = np.concatenate([view.by_placement for view in seen_by])
            basis = orthonormal_basis(by_placement)
            reduced = subtract_projection(basis, np.concatenate([v.columns for v in seen_by]))
            products.append(reduced.T @ reduced)
            visible_rows = int(np.count_nonzero(by_placement.any(1)))
            degrees_of_freedom.append(visible_rows - basis.shape[1])
        return PosteriorPredictive(
            products=np.array(products),
            freedom=np.array(degrees_of_freedom, dtype=np.float64),
            calibrated=self.error_count,
            places={camera.name: columns[camera.name] for camera in self.cameras},
            sigma=float(np.sqrt(np.mean([camera.sigma**2 for camera in self.cameras]))),
        )

    def _linearise(
        self,
        camera: LinearCamera,
        placed: PlacedViews,
        placements: Tensor,
        sigma: float,
        columns: Mapping[str, slice],
    ) -> Iterator[_ViewColumns]:
        """Yield the linearised residuals of each view.

        Args:
            camera: the camera of the views.
            placed: the views, with their mounting.
            placements: (P, B) T_reference_board, at which to linearise.
            sigma: the noise of a corner, px per axis.
            columns: those of `columns`.
        """
        composed = compose_with_derivatives(placed.mounting, placements[placed.placement])
        mounting_by_motion = np.linalg.inv(mounting_motion(placed.mounting))
        equations = view_equations(
            camera.path, camera.parameters, placed.observations, composed.poses, sigma
        )
        width = max(place.stop for place in columns.values())
        errors = slice(1, 1 + self.error_count)
        for index, (placement, view) in enumerate(
            zip(placed.placement.tolist(), equations, strict=True)
        ):
            by_pose = view.jacobian_block  # T_camera_board
            by_mounting = by_pose @ composed.by_mounting[index].numpy()
            by_parameters = view.jacobian_shared[:, : len(camera.parameters_by_error)]
            table = np.zeros((len(view.residual), width))
            table[:, 0] = view.residual
            table[:, errors] = (
                by_parameters @ camera.parameters_by_error + by_mounting @ camera.mounting_by_error
            )
            if camera.follower:
                by_motion = view.jacobian_shared[:, camera.follower.entries]
                table[:, columns[camera.name]] = by_motion @ camera.follower.by_motion
            else:
                table[:, columns[camera.name]] = by_mounting @ mounting_by_motion
            for name, entries in camera.changes.items():
                table[:, columns[f"{camera.name}.{name}"]] = view.jacobian_shared[:, entries]
            yield _ViewColumns(placement, by_pose @ composed.by_placement[index].numpy(), table)


def _changes_between_cameras(calibration: Calibration) -> tuple[Effect, ...]:
    """Return the changes of a camera that can make it disagree with the others."""
    changes = changes_of(calibration)
    return tuple(change for change in changes if not isinstance(change, CHECKED_IN_EACH_CAMERA))


def _follower_mounting(rig: Rig, name: str, camera: PlacedCamera) -> FollowerMounting:
    """Return the mounting of a follower. The mountings of all cameras but the reference are the
    last numbers of the rig's vector, in the order of the cameras.
    """
    mounted = [camera_name for camera_name in rig.names if camera_name != rig.reference]
    first = len(rig.covariance) - MOTION_SIZE * (len(mounted) - mounted.index(name))
    is_mounting = (camera.columns >= first) & (camera.columns < first + MOTION_SIZE)
    mounting = torch.from_numpy(rig.mountings[rig.index(name)])
    return FollowerMounting(
        np.flatnonzero(is_mounting).astype(np.int64),
        np.asarray(np.linalg.inv(mounting_motion(mounting))),
    )


def camera_noise(calibration: Calibration) -> float:
    """Return the noise of a corner, px per axis."""
    return max(calibration.corner_sigma_px, MIN_NOISE)


def _with_changes(
    calibration: Calibration, changes: Sequence[Effect]
) -> tuple[Path, Parameters, Array, dict[str, NDArray[np.int64]]]:
    """Return a camera's path and parameters with changes, the (S, S) matrix from its estimated
    parameters to those with a relief that stays on the glass, and the places of each change's
    numbers among the parameters.
    """
    model = calibration.camera_model()
    model, calibrated, to_fixed = fix_relief(model, model.parameters)
    names = {effect.name for effect in model.effects}
    new = [change for change in changes if change.name not in names]
    wider = model.with_effects(new)
    neutral = {
        name: value for effect in new for name, value in model.neutral_values(effect).items()
    }
    free = (*calibrated.free, *(u.param for effect in new for u in effect.effect_parameters))
    parameters = replace(
        calibrated, origin={**calibrated.origin, **neutral}, free=free, priors=wider.priors
    )
    entries = {
        change.name: parameters.entries(u.param.name for u in change.effect_parameters)
        for change in changes
    }
    return wider.path, parameters, to_fixed, entries
