"""Where a residual lives: how much of its variance each thing explains that could organise it, named effect or not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from calib.estimation.observations import Observations

Array = NDArray[np.float64]

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
    depth: Array
    """(M,) m"""
    incidence: Array
    """(M,) cosine between the ray and the cover's normal, or the optical axis where there is no cover."""
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
        sizes = np.array([np.median(length[view == v]) for v in range(len(self.observations.names))])
        return np.asarray(np.maximum(sizes, 1e-9)[view])

    def _share(self, name: str, basis: Array, weighed: Array) -> Share:
        """Both directions of the residual on the (M, k) basis."""
        columns = basis[:, np.abs(basis).max(0) > 0]
        u, s, _ = np.linalg.svd(columns, full_matrices=False)
        own = u[:, s > 1e-9 * s.max()]
        total, explained = float((weighed**2).sum()), float(((own.T @ weighed) ** 2).sum())
        k, rows = 2 * own.shape[1], weighed.size
        fraction, chance = explained / total, k / rows
        p_value = float(stats.f.sf((fraction / k) / ((1 - fraction) / (rows - k)), k, rows - k))
        return Share(name, fraction, chance, p_value)


def _image(scene: Scene) -> Array:
    x, y = scene.observations.pixels.numpy().T
    cell = np.floor(x / scene.width * CELLS[0]).clip(0, CELLS[0] - 1) * CELLS[1] + np.floor(y / scene.height * CELLS[1]).clip(
        0, CELLS[1] - 1
    )
    return _one_hot(cell)


def _board(scene: Scene) -> Array:
    _, place = np.unique(scene.observations.corners.numpy().round(9), axis=0, return_inverse=True)
    return _one_hot(place.ravel())


def _motion(scene: Scene) -> Array:
    """Within each view, what is linear and quadratic in the row."""
    view = _one_hot(scene.observations.view.numpy())
    row = scene.observations.pixels.numpy()[:, 1]
    middle = (view.T @ row) / view.sum(0)
    off = (row - view @ middle) / scene.height
    return np.concatenate([view * off[:, None], view * off[:, None] ** 2], 1)


def _time(scene: Scene) -> Array:
    """What grows with time, as a whole or away from the image's middle."""
    seen = scene.observations
    when = (seen.view.numpy() / max(1, len(seen.names) - 1) if seen.moment is None else seen.moment[:, 0].numpy() + 0.5) - 0.5
    x, y = (seen.pixels.numpy() - [scene.width / 2, scene.height / 2]).T / scene.width
    return np.stack([when, when * x, when * y, when**2, when**2 * x, when**2 * y], -1)


def _refraction(scene: Scene) -> Array:
    """The direction from the image's middle, by incidence and inverse depth."""
    near = 1 / scene.depth
    bend = 1 - scene.incidence
    x, y = (scene.observations.pixels.numpy() - [scene.width / 2, scene.height / 2]).T / scene.width
    smooth = [bend**i * near**j for i in range(3) for j in range(3)]
    return np.stack([part * at for part in smooth for at in (x, y)], -1)


def _phase(scene: Scene) -> Array:
    x, y = 2 * np.pi * scene.observations.pixels.numpy().T
    return np.stack([np.sin(x), np.cos(x), np.sin(y), np.cos(y)], -1)


def _one_hot(labels: NDArray[np.generic]) -> Array:
    _, index = np.unique(labels, return_inverse=True)
    return np.asarray(np.eye(int(index.max()) + 1)[index.ravel()])


ORGANISERS: dict[str, Callable[[Scene], Array]] = {
    "image": _image,
    "board": _board,
    "row x motion": _motion,
    "view and time": _time,
    "incidence x depth": _refraction,
    "sub-pixel phase": _phase,
}
