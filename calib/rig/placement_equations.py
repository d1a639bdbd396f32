"""The linearised residuals of the placements of a rig's board, each with the placement eliminated:
by the errors of the calibrated rig, by a motion of each camera, and by changes of each camera.

A motion is a small rotation (rad) and translation (m) by which everything outside moves in the
frame of a camera. The camera itself moves the other way.
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
from calib.estimation.view_equations import ViewEquations, view_equations
from calib.optics.path import Path
from calib.rig.gauge import mounting_motion
from calib.rig.later_views import PlacedViews
from calib.rig.poses import compose_with_derivatives
from calib.rig.rig import Rig
from calib.rig.rig_geometry import placed_cameras

Array = NDArray[np.float64]
MOTION_SIZE = 6
NOT_OF_ONE_CAMERA = (PictureMode, BoardScale, BoardShape)
"""Changes that the check of each camera by itself finds: all cameras see the same board, and
another picture mode is not of first order.
"""


@dataclass(frozen=True, slots=True, eq=False)
class LinearCamera:
    """A camera of a calibrated rig, ready to be linearised."""

    name: str
    path: Path
    parameters: Parameters
    """The estimated parameters, followed by those of the changes."""
    root: Array
    """(S_c, Q) the changes of the estimated parameters with independent errors of unit variance of
    the rig.
    """
    mounting: Tensor
    """(6,) T_camera_reference, or that of the first camera behind the same cover, in whose frame
    its boards are placed.
    """
    mounting_root: Array
    """(6, Q) the same for the mounting."""
    sigma: float
    """The noise of a corner, px per axis."""
    own_motion: tuple[NDArray[np.int64], Array] | None
    """For a camera behind another camera's cover: the (6,) entries of its mounting among the
    estimated parameters, and the (6, 6) derivatives of its mounting by a motion.
    """
    changes: Mapping[str, NDArray[np.int64]] = field(default_factory=dict)
    """The entries of each change among the parameters."""
    leads: bool = False
    """True for the first camera behind a shared cover. Its views do not tell its own motion from
    that of the cover.
    """

    def placed(self, observations: Observations, placement: Tensor) -> PlacedViews:
        """Return views of this camera where it was calibrated."""
        values = self.parameters.origin
        return PlacedViews(self.path, values, observations, self.mounting, placement)


@dataclass(frozen=True, slots=True, eq=False)
class LinearRig:
    """The cameras of a rig, ready to be linearised."""

    cameras: tuple[LinearCamera, ...]
    changes: Mapping[str, tuple[Effect, ...]]
    """The changes of each camera."""

    @staticmethod
    def of(rig: Rig, *, with_changes: bool = True) -> LinearRig:
        """Prepare a rig with a covariance."""
        root = covariance_root(rig.covariance)
        followers = set(rig.covers)
        leaders = set(rig.covers.values())
        changes = {
            name: tuple(c for c in changes_of(calibration) if not isinstance(c, NOT_OF_ONE_CAMERA))
            if with_changes and name not in followers | leaders
            else ()
            for name, calibration in rig.calibrations.items()
        }
        cameras = []
        further = [name for name in rig.names if name != rig.reference]
        for name, placed in zip(rig.names, placed_cameras(rig), strict=True):
            calibration = rig.calibrations[name]
            path, parameters = placed.path, placed.parameters
            own_root = root[placed.columns]
            entries: dict[str, NDArray[np.int64]] = {}
            if changes[name]:
                path, parameters, to_fixed, entries = _with_changes(calibration, changes[name])
                own_root = to_fixed @ own_root
            own_motion = None
            if name in followers:
                # The mountings are the last numbers of the rig's vector.
                first = len(root) - 6 * (len(further) - further.index(name))
                is_mounting = (placed.columns >= first) & (placed.columns < first + 6)
                places = np.flatnonzero(is_mounting).astype(np.int64)
                mounting = torch.from_numpy(rig.mountings[rig.index(name)])
                own_motion = places, np.asarray(np.linalg.inv(mounting_motion(mounting)))
            mounting_root = np.zeros((6, root.shape[1]))
            if len(placed.mounting_columns):
                mounting_root = root[placed.mounting_columns]
            cameras.append(
                LinearCamera(
                    name=name,
                    path=path,
                    parameters=parameters,
                    root=own_root,
                    mounting=placed.mounting,
                    mounting_root=mounting_root,
                    sigma=camera_noise(calibration),
                    own_motion=own_motion,
                    changes=entries,
                    leads=name in leaders,
                )
            )
        return LinearRig(tuple(cameras), changes)

    @property
    def error_count(self) -> int:
        """Q, the number of independent errors of the rig."""
        return int(self.cameras[0].mounting_root.shape[1])

    def columns(self) -> dict[str, slice]:
        """Return the places of the motions, by the names of the cameras, and of the changes, by
        "camera.change", in the products of `predictive`.
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
        places = self.columns()
        rows: dict[int, list[tuple[Array, Array]]] = {}
        for camera, placed in views:
            sigma = camera.sigma * noise.get(camera.name, 1.0)
            for place, block, columns in self._rows(camera, placed, placements, sigma, places):
                rows.setdefault(place, []).append((block, columns))
        products, freedom = [], []
        for _, pieces in sorted(rows.items()):
            by_placement = np.concatenate([block for block, _ in pieces])
            basis = orthonormal_basis(by_placement)
            reduced = subtract_projection(basis, np.concatenate([piece for _, piece in pieces]))
            products.append(reduced.T @ reduced)
            freedom.append(int(np.count_nonzero(by_placement.any(1))) - basis.shape[1])
        return PosteriorPredictive(
            products=np.array(products),
            freedom=np.array(freedom, dtype=np.float64),
            calibrated=self.error_count,
            places={name: place for name, place in places.items() if "." not in name},
            sigma=float(np.sqrt(np.mean([camera.sigma**2 for camera in self.cameras]))),
        )

    def _rows(
        self,
        camera: LinearCamera,
        placed: PlacedViews,
        placements: Tensor,
        sigma: float,
        places: Mapping[str, slice],
    ) -> Iterator[tuple[int, Array, Array]]:
        """Yield the placement of each view, its (2m, B) derivatives by the placement, and its
        (2m, n) columns.
        """
        composed = compose_with_derivatives(placed.mounting, placements[placed.placement])
        to_motion = np.linalg.inv(mounting_motion(placed.mounting))
        equations = view_equations(
            camera.path, camera.parameters, placed.observations, composed.poses, sigma
        )
        size = max(place.stop for place in places.values())
        for view, (place, rows) in enumerate(
            zip(placed.placement.tolist(), equations, strict=True)
        ):
            by_pose = rows.jacobian_block
            by_mounting = by_pose @ composed.by_mounting[view].numpy()
            columns = np.zeros((len(rows.residual), size))
            columns[:, 0] = rows.residual
            by_numbers = rows.jacobian_shared[:, : len(camera.root)]
            columns[:, 1 : 1 + self.error_count] = (
                by_numbers @ camera.root + by_mounting @ camera.mounting_root
            )
            columns[:, places[camera.name]] = _motion(camera, rows, by_mounting @ to_motion)
            for name, entries in camera.changes.items():
                columns[:, places[f"{camera.name}.{name}"]] = rows.jacobian_shared[:, entries]
            yield place, by_pose @ composed.by_placement[view].numpy(), columns


def _motion(camera: LinearCamera, rows: ViewEquations, of_frame: Array) -> Array:
    """Return the (2m, 6) derivatives by a motion of the camera, from those by a motion of the frame
    in which its boards are placed.
    """
    if camera.own_motion is None:
        return of_frame
    entries, by_motion = camera.own_motion
    return np.asarray(rows.jacobian_shared[:, entries] @ by_motion)


def camera_noise(calibration: Calibration) -> float:
    """Return the noise of a corner, px per axis."""
    return max(calibration.corner_sigma_px, MIN_NOISE)


def _with_changes(
    calibration: Calibration, changes: Sequence[Effect]
) -> tuple[Path, Parameters, Array, dict[str, NDArray[np.int64]]]:
    """Return a camera's path and parameters with changes, the (S, S) matrix from its estimated
    parameters to those with a relief that stays on the glass, and the entries of each change.
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
