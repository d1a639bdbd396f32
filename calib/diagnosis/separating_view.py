"""The pose of the board that would tell effects apart which the views there are confound.

Where one effect can do what another does, the information on both has a near-null direction. The
view is wanted that shortens it most: of a bank of poses, the one that leaves the smallest predicted
sigma of the effect, with the others free beside it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.corners.view import View
from calib.diagnosis.score_test import Optimum
from calib.effects.effect import Effect
from calib.estimation.observations import Observations
from calib.optics.projection import project
from calib.session.board import Board
from calib.session.camera import Camera

Array = NDArray[np.float64]

DEPTHS = (0.5, 1.0, 2.0)
"""Of what the views have."""
PLACES = (0.25, 0.5, 0.75)
"""Of the picture's width and height, for the board's middle."""
TILT = float(np.radians(40.0))
TILTS = ((0.0, 0.0), (-TILT, 0.0), (TILT, 0.0), (0.0, -TILT), (0.0, TILT))
"""About x and y."""
TURNS = (0.0, np.pi / 2)
"""About the board's normal."""


@dataclass(frozen=True, slots=True, eq=False)
class SeparatingView:
    """A view that tells more than others."""

    pose: Array
    """(6,) T_camera_board: rotation vector (rad) and translation (m)."""
    corners: Array
    """(count, 2) px, where it would show them."""
    turned: bool
    """Whether the board is turned by 90 degrees about its normal."""
    reach: tuple[float, float]
    """m, the nearest and the farthest depth of the bank."""
    shrinks: float
    """By which factor it alone makes the effect's sigma smaller."""


def separating_view(
    at: Optimum, board: Board, camera: Camera, effect: Effect, others: Sequence[Effect]
) -> SeparatingView | None:
    """The best view of the bank.

    Args:
        at: where the fit with `effect` ended.
        others: those that it is confounded with, not in the fit.
    """
    poses = torch.from_numpy(np.array(list(_bank(at, camera))))
    corners = torch.from_numpy(board.points())
    path, values, count = at.model.path, at.joint.values, board.count
    index = torch.arange(len(poses)).repeat_interleave(count)
    motionless = at.model.padded(poses)
    pixels = project(
        path, values, path.place(corners.repeat(len(poses), 1), values, motionless[index])
    )
    inside = ((pixels >= 0) & (pixels <= torch.tensor([camera.width - 1, camera.height - 1]))).all(
        -1
    )
    seen = inside.reshape(-1, count).all(-1)
    if not bool(seen.any()):
        return None
    shown = pixels.reshape(-1, count, 2)[seen].numpy()
    views = [View(str(number), own, np.ones(count)) for number, own in enumerate(shown)]
    observations = Observations.of(views, board).timed(None, camera.height)
    bank = replace(at, observations=observations, joint=replace(at.joint, poses=motionless[seen]))
    known = at.information(others).sum(0) + at.prior_precision(others)
    sigma, after = (_sigma(known + more, at, effect) for more in (0.0, bank.information(others)))
    best = int(after.argmin())
    pose = poses[seen][best].numpy()
    turned = bool(np.flatnonzero(seen.numpy())[best] % len(TURNS))
    reach = float(poses[:, 5].min()), float(poses[:, 5].max())
    return SeparatingView(pose, shown[best], turned, reach, float(sigma / after[best]))


def _bank(at: Optimum, camera: Camera) -> Iterator[Array]:
    """(6,) poses, wherever the middle of the board lies in the picture of a pinhole."""
    seen = at.observations
    timed = seen.with_times(at.joint.values)
    places = at.model.path.place(seen.corners, timed, at.joint.poses[seen.view])
    depth = float(at.model.path.distance(places).median())
    focal, cx, cy = (float(at.joint.values[f"camera.{name}"]) for name in ("fx", "cx", "cy"))
    for part, right, down, tilt, turn in product(DEPTHS, PLACES, PLACES, TILTS, TURNS):
        z = part * depth
        middle = np.array([right * camera.width - cx, down * camera.height - cy, focal]) / focal * z
        rotation = Rotation.from_rotvec([*tilt, 0.0]) * Rotation.from_rotvec([0.0, 0.0, turn])
        yield np.concatenate([rotation.as_rotvec(), middle])


def _sigma(information: Array, at: Optimum, effect: Effect) -> Array:
    """(...) root of the mean variance of the effect's parameters over their scales."""
    own = at.parameters().entries(unknown.param.name for unknown in effect.unknowns)
    variance = np.linalg.inv(information)[..., own, own]
    return np.asarray(np.sqrt(variance.mean(-1)))
