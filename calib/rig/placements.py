"""The placements of the board: which views of which cameras show it at the same moment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np
from numpy.typing import NDArray

from calib.corners.view import View
from calib.errors import InputError
from calib.rig.rig_file import RigDescription

Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Placements:
    """The placements of the board before a rig."""

    names: tuple[str, ...]
    """P names, each that of its first picture."""
    of_views: Mapping[str, Indices]
    """For each camera, the (V,) placement of each of its views."""

    @property
    def count(self) -> int:
        return len(self.names)

    @staticmethod
    def of(rig: RigDescription, views: Mapping[str, Sequence[View]]) -> Placements:
        """Return the placements of the views of each camera.

        Raises:
            InputError: the times of a picture are needed and not recorded.
        """
        if rig.tolerance_s is None:
            return _by_name(views)
        return _by_time(rig, views, rig.tolerance_s)


def _by_name(views: Mapping[str, Sequence[View]]) -> Placements:
    """Return the placements of pictures that have the same name in each camera. Pictures of one
    camera with the same pose id show one placement.
    """
    groups = _Groups()
    for camera, camera_views in views.items():
        for view in camera_views:
            groups.join((camera, view.name), ("", PurePath(view.name).stem))
            if view.pose_id is not None:
                groups.join((camera, view.name), (camera, "pose", view.pose_id))
    return groups.placements(views)


def _by_time(
    rig: RigDescription, views: Mapping[str, Sequence[View]], tolerance_s: float
) -> Placements:
    """Return the placements of pictures whose times differ by no more than a tolerance from the
    nearest picture of an earlier camera. Pictures of one camera show different placements unless
    they have the same pose id.
    """
    groups = _Groups()
    earlier: list[tuple[float, tuple[str, str]]] = []
    for camera, camera_views in views.items():
        current: list[tuple[float, tuple[str, str]]] = []
        free = list(earlier)
        for view in camera_views:
            if view.time_s is None:
                raise InputError(
                    f"{rig.file}: together is a tolerance, and {view.name} of {camera} has no time:"
                    f" list time_s in {rig.sessions[camera].path / 'frames.csv'}, or write"
                    " together: by_name."
                )
            label = camera, view.name
            groups.join(label, label)
            current.append((view.time_s, label))
            if view.pose_id is not None:
                groups.join(label, (camera, "pose", view.pose_id))
            time_s = view.time_s
            nearest = min(free, key=lambda entry: abs(entry[0] - time_s), default=None)
            if nearest and abs(nearest[0] - time_s) <= tolerance_s:
                groups.join(label, nearest[1])
                free.remove(nearest)
        earlier += current
    return groups.placements(views)


class _Groups:
    """Labels that belong together."""

    def __init__(self) -> None:
        self._parents: dict[tuple[str, ...], tuple[str, ...]] = {}

    def join(self, label: tuple[str, ...], other: tuple[str, ...]) -> None:
        self._parents.setdefault(label, label)
        self._parents.setdefault(other, other)
        self._parents[self._root(other)] = self._root(label)

    def placements(self, views: Mapping[str, Sequence[View]]) -> Placements:
        """Return a placement for each group, in the order of the views."""
        numbers: dict[tuple[str, ...], int] = {}
        names: list[str] = []
        of_views = {}
        for camera, camera_views in views.items():
            places = []
            for view in camera_views:
                root = self._root((camera, view.name))
                if root not in numbers:
                    numbers[root] = len(names)
                    names.append(view.name)
                places.append(numbers[root])
            of_views[camera] = np.array(places, dtype=np.int64)
        return Placements(tuple(names), of_views)

    def _root(self, label: tuple[str, ...]) -> tuple[str, ...]:
        while (parent := self._parents[label]) != label:
            label = parent
        return label
