"""Where a residual lives: how much of its variance each thing explains that could organise it,
named effect or not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc

from calib.estimation.observations import Observations

Array = NDArray[np.float64]
Basis = tuple[NDArray[np.int64], Array]
"""(M,) the group of each corner, and (M, k) columns: each group has its own combination of them."""

CELLS = (8, 6)
"""Of the image, across and down."""
DEPTHS = 4


@dataclass(frozen=True, slots=True)
class Share:
    """What one thing explains."""

    organised_by: str
    fraction: float
    """Of the residual's variance."""
    chance: float
    """What it would explain of noise."""
    p_value: float


@dataclass(frozen=True, slots=True)
class Scene:
    """Everything that the split goes by; views weigh alike, whatever their own scatter."""

    observations: Observations
    residual: Array
    """(M, 2) px"""
    distance: Array
    """(M,) m, how far away each corner is (`Path.distance`)."""
    incidence: Array
    """(M,) cosine between the ray and the cover's normal, or the optical axis where there is no
    cover.
    """
    width: int
    height: int

    def split(self) -> list[Share]:
        """By how much each explains more than chance, largest first."""
        weighed = self.residual / self._typical()[:, None]
        found = [self._share(name, basis(self), weighed) for name, basis in ORGANISERS.items()]
        return sorted(found, key=lambda share: share.chance - share.fraction)

    def _typical(self) -> Array:
        """(M,) px: the robust size of each view's own residual."""
        view = self.observations.view.numpy()
        length = np.hypot(*self.residual.T)
        sizes = np.array(
            [np.median(length[view == v]) for v in range(len(self.observations.names))]
        )
        return np.asarray(np.maximum(sizes, 1e-9)[view])

    def _share(self, name: str, basis: Basis, weighed: Array) -> Share:
        """Both directions of the residual on a basis."""
        group, columns = basis
        order = np.argsort(group, kind="stable")
        explained, dimensions = 0.0, 0
        for own in np.split(order, np.flatnonzero(np.diff(group[order])) + 1):
            u, s, _ = np.linalg.svd(columns[own], full_matrices=False)
            u = u[:, s > 1e-9 * s.max()]
            explained += float(((u.T @ weighed[own]) ** 2).sum())
            dimensions += u.shape[1]
        k, rows = 2 * dimensions, weighed.size
        fraction, chance = explained / float((weighed**2).sum()), k / rows
        p_value = float(fdtrc(k, rows - k, max(0.0, fraction / k) / ((1 - fraction) / (rows - k))))
        return Share(name, fraction, chance, p_value)


def _image(scene: Scene) -> Basis:
    x, y = scene.observations.pixels.numpy().T
    cell = np.floor(x / scene.width * CELLS[0]).clip(0, CELLS[0] - 1) * CELLS[1] + np.floor(
        y / scene.height * CELLS[1]
    ).clip(0, CELLS[1] - 1)
    return _means(cell)


def _board(scene: Scene) -> Basis:
    _, place = np.unique(scene.observations.corners.numpy().round(9), axis=0, return_inverse=True)
    return _means(place.ravel())


def _motion(scene: Scene) -> Basis:
    """Within each view, what is linear and quadratic in the row."""
    view = scene.observations.view.numpy()
    row = scene.observations.pixels.numpy()[:, 1]
    off = (row - (np.bincount(view, row) / np.bincount(view).clip(1))[view]) / scene.height
    return view, np.stack([off, off**2], -1)


def _time(scene: Scene) -> Basis:
    """What grows with time, as a whole or away from the image's middle."""
    seen = scene.observations
    when = (
        seen.view.numpy() / max(1, len(seen.names) - 1)
        if seen.moment is None
        else seen.moment[:, 0].numpy() + 0.5
    ) - 0.5
    x, y = (seen.pixels.numpy() - [scene.width / 2, scene.height / 2]).T / scene.width
    return _everywhere(when, when * x, when * y, when**2, when**2 * x, when**2 * y)


def _refraction(scene: Scene) -> Basis:
    """The direction from the image's middle, by incidence and inverse depth."""
    near = 1 / scene.distance
    bend = 1 - scene.incidence
    x, y = (scene.observations.pixels.numpy() - [scene.width / 2, scene.height / 2]).T / scene.width
    smooth = [bend**i * near**j for i in range(3) for j in range(3)]
    return _everywhere(*(part * at for part in smooth for at in (x, y)))


def _phase(scene: Scene) -> Basis:
    x, y = 2 * np.pi * scene.observations.pixels.numpy().T
    return _everywhere(np.sin(x), np.cos(x), np.sin(y), np.cos(y))


def _means(label: NDArray[np.generic]) -> Basis:
    """One number for all that have the same label, a whole number."""
    return label.astype(np.int64), np.ones((len(label), 1))


def _everywhere(*columns: Array) -> Basis:
    return np.zeros(len(columns[0]), np.int64), np.stack(columns, -1)


ORGANISERS: dict[str, Callable[[Scene], Basis]] = {
    "image": _image,
    "board": _board,
    "row x motion": _motion,
    "view and time": _time,
    "incidence x depth": _refraction,
    "sub-pixel phase": _phase,
}
