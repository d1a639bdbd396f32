"""Placements of a rig's board that several cameras saw, and what they tell of the mountings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.checking.overdispersion import Overdispersion
from calib.checking.posterior_predictive import PosteriorPredictive
from calib.corners.view import View
from calib.estimation.observations import Observations
from calib.estimation.residuals import residuals
from calib.rig.later_views import PlacedViews, fit_placements
from calib.rig.placement_equations import LinearCamera, LinearRig
from calib.rig.placements import Placements
from calib.rig.poses import compose, invert_poses
from calib.rig.rig import Rig
from calib.session.board import Board

MAX_COMPARED = 60
"""The most placements of a rig's own fit from which the scatter is estimated."""

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class SharedPlacements:
    """Placements in the order of their pictures, each seen by two cameras or more."""

    rig: LinearRig
    groups: tuple[tuple[LinearCamera, PlacedViews], ...]
    """The views of each camera; a camera that slipped has two groups."""
    placements: Tensor
    """(P, B) T_reference_board, with the bend of the board if it bends differently in every
    placement.
    """
    names: tuple[str, ...]
    """P names, each that of its first picture."""
    alone: Mapping[str, Tensor]
    """For each camera, the (P, 6) placements by its own views; NaN where it has none."""
    noise: Mapping[str, float]
    """The noise of each camera's corners over that of its calibration."""

    @staticmethod
    def of(
        rig: LinearRig,
        views: Mapping[str, Sequence[View]],
        poses: Mapping[str, Tensor],
        placements: Placements,
        boards: Mapping[str, Board],
        noise: Mapping[str, float],
    ) -> SharedPlacements | None:
        """Return the placements that two of these cameras saw; None if there is none.

        Args:
            views: of each camera.
            poses: (V, 6) T_camera_board of the views, in the frame of `LinearCamera.mounting`.
            boards: of the views.
        """
        order = _shared_order(views, placements)
        if not len(order):
            return None
        new_index = np.full(placements.count, -1)
        new_index[order] = np.arange(len(order))
        groups = []
        alone = {}
        for camera in rig.cameras:
            if camera.name not in views:
                continue
            places = new_index[placements.of_views[camera.name]]
            used = places >= 0
            if not used.any():
                continue
            chosen = [v for v, use in zip(views[camera.name], used, strict=True) if use]
            observations = Observations.of(chosen, boards[camera.name])
            placed = camera.place_views(observations, torch.from_numpy(places[used]))
            groups.append((camera, placed))
            alone[camera.name] = torch.full((len(order), 6), torch.nan, dtype=torch.float64)
            own_poses = poses[camera.name][torch.from_numpy(used)]
            in_reference = compose(invert_poses(placed.mounting), own_poses)
            alone[camera.name][placed.placement] = in_reference
        names = tuple(placements.names[index] for index in order)
        start = _first_of(list(alone.values()))
        return SharedPlacements(rig, tuple(groups), start, names, alone, noise).fitted()

    def fitted(self) -> SharedPlacements:
        """Return the same with placements of least reprojection error."""
        sigma = float(np.mean([camera.sigma for camera, _ in self.groups]))
        views = [placed for _, placed in self.groups]
        return replace(self, placements=fit_placements(views, self.placements, sigma))

    def predictive(self) -> PosteriorPredictive:
        """Return the distribution of the residuals under the calibrated rig."""
        return self.rig.predictive(self.groups, self.placements, self.noise)

    def select(self, selected: Mask) -> SharedPlacements:
        """Return some of the (P,) placements."""
        index = torch.from_numpy(np.cumsum(selected) - 1)
        groups = []
        for camera, placed in self.groups:
            chosen_views = _select_views(placed, torch.from_numpy(selected)[placed.placement])
            if len(chosen_views.placement):
                groups.append(
                    (camera, replace(chosen_views, placement=index[chosen_views.placement]))
                )
        names = tuple(
            name for name, is_selected in zip(self.names, selected, strict=True) if is_selected
        )
        rows = torch.from_numpy(selected)
        return replace(
            self,
            groups=tuple(groups),
            placements=self.placements[rows],
            names=names,
            alone={name: placements[rows] for name, placements in self.alone.items()},
        )

    def moved(self, name: str, motion: Array, moves: Mask) -> SharedPlacements:
        """Return the same with a (6,) motion of one camera in some of the (P,) placements."""
        groups: list[tuple[LinearCamera, PlacedViews]] = []
        for camera, placed in self.groups:
            if camera.name != name:
                groups.append((camera, placed))
                continue
            is_moved = torch.from_numpy(moves)[placed.placement]
            for mask, mounting in (
                (~is_moved, placed.mounting),
                (is_moved, compose(torch.from_numpy(motion), placed.mounting)),
            ):
                if bool(mask.any()):
                    groups.append((camera, replace(_select_views(placed, mask), mounting=mounting)))
        unmoved = [placements for camera, placements in self.alone.items() if camera != name]
        return replace(self, groups=tuple(groups), placements=_first_of(unmoved)).fitted()

    def squares(self) -> tuple[float, int]:
        """Return the sum of the squared reprojection errors, px^2, and the number of corners."""
        total, count = 0.0, 0
        for _, placed in self.groups:
            image = residuals(
                placed.path, placed.values, placed.observations, placed.poses(self.placements)
            ).image
            total += float(image.nan_to_num().square().sum())
            count += len(image)
        return total, count


def own_scatter(rig: Rig, linear: LinearRig) -> Overdispersion:
    """Return the overdispersion of the placements of a rig's own fit along the motions of the
    cameras: each placement is predicted from the others.
    """
    counts = np.zeros(len(rig.placements), np.int64)
    for places in rig.of_views.values():
        counts[np.unique(places)] += 1
    shared = np.flatnonzero(counts > 1)
    if len(shared) > MAX_COMPARED:
        shared = shared[np.linspace(0, len(shared) - 1, MAX_COMPARED).astype(np.int64)]
    views = [
        (camera, camera.place_views(Observations.of(c.views, c.board), torch.from_numpy(places)))
        for camera, c, places in zip(
            linear.cameras, rig.calibrations.values(), rig.of_views.values(), strict=True
        )
    ]
    placements = torch.from_numpy(rig.placement_numbers)
    left_out = []
    columns = {}
    for place in shared:
        chosen = [
            (camera, _select_views(placed, placed.placement == int(place)))
            for camera, placed in views
        ]
        visible = [(camera, placed) for camera, placed in chosen if len(placed.placement)]
        predictive = linear.predictive(visible, placements)
        left_out.append(predictive.leave_one_out(0))
        columns = {name: predictive.columns(name) for name in rig.names}
    return Overdispersion.of_left_out(left_out, columns or dict.fromkeys(rig.names, slice(0)))


def _first_of(placements: Sequence[Tensor]) -> Tensor:
    """Return the (P, 6) placements by the first camera that has each."""
    first = placements[0]
    for further in placements[1:]:
        first = torch.where(first.isnan(), further, first)
    return first


def _select_views(placed: PlacedViews, used: Tensor) -> PlacedViews:
    observations = placed.observations.without_views(~used)
    return replace(placed, observations=observations, placement=placed.placement[used])


def _shared_order(views: Mapping[str, Sequence[View]], placements: Placements) -> NDArray[np.int64]:
    """Return the placements that two cameras or more saw, by time, or by name without times."""
    seeing = np.zeros(placements.count, np.int64)
    times: dict[int, float] = {}
    is_timed = True
    for name, camera_views in views.items():
        places = placements.of_views[name]
        seeing[np.unique(places)] += 1
        for place, view in zip(places.tolist(), camera_views, strict=True):
            is_timed &= view.time_s is not None
            times.setdefault(place, view.time_s or 0.0)
    shared = np.flatnonzero(seeing > 1).tolist()
    shared.sort(key=lambda place: times[place] if is_timed else placements.names[place])
    return np.array(shared, dtype=np.int64)
