"""The start of a rig's estimate: how the cameras are mounted, from the board's poses in each.

A board without markers looks the same after half a turn, a square one after a quarter turn. Each
picture that two cameras share gives a mounting for each turn. The right ones agree from picture to
picture; the wrong ones do not, if the board is tilted in different ways. The mounting on which most
pictures agree is the start.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.corners.view import View
from calib.errors import NotEnoughDataError
from calib.optics import rotation
from calib.rig.placements import Indices, Placements
from calib.rig.poses import compose, invert_poses
from calib.session.board import Board

MAX_ANGLE = 0.05
"""rad: two mountings agree up to this angle. The poses of single views are a few mrad off, and
behind an undeclared cover some ten; half a turn of a tilted board is off by twice its tilt.
"""
MAX_SHIFT = 0.05
"""The same for their translations, as a fraction of the board's distance."""
MIN_AGREEING = 0.5
"""The fraction of the shared pictures that must agree on the mounting."""
MAX_RIVAL = 0.7
"""The largest number of pictures that agree on another mounting, as a fraction of those that agree
on the best: more, and the pictures do not tell them apart.
"""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class RigStart:
    """The start of a joint estimate."""

    mountings: Mapping[str, Tensor]
    """(6,) T_camera_reference of each camera."""
    placements: Tensor
    """(P, 6) T_reference_board."""
    turns: Mapping[str, Indices]
    """For each camera, (V,) the number of quarter turns by which the board of each view stands
    turned against that of the other cameras.
    """
    inconsistent: Mapping[str, NDArray[np.bool_]]
    """For each camera, (V,) true for a view whose board does not stand where the other cameras see
    it.
    """


def start_rig(
    poses: Mapping[str, Tensor], placements: Placements, reference: str, board: Board
) -> RigStart:
    """Return the start from the (V, 6) T_camera_board of each camera's views.

    Raises:
        NotEnoughDataError: a camera shares no picture of the board with the others, or they do not
            agree on its mounting, or agree on two.
    """
    steps = _turn_steps(board)
    mountings = {reference: torch.zeros(6, dtype=torch.float64)}
    placed = torch.full((placements.count, 6), torch.nan, dtype=torch.float64)
    turns = {name: np.zeros(len(views), np.int64) for name, views in poses.items()}
    inconsistent = {name: np.zeros(len(views), np.bool_) for name, views in poses.items()}
    _place(placed, poses[reference], placements.of_views[reference])
    while len(mountings) < len(poses):
        is_placed = torch.isfinite(placed[:, 0]).numpy()
        shared = {
            name: int(is_placed[placements.of_views[name]].sum())
            for name in poses
            if name not in mountings
        }
        name = max(shared, key=lambda camera: shared[camera])
        if not shared[name]:
            raise NotEnoughDataError(
                f"No picture of {name} shows the board at the same moment as a picture of"
                f" {', '.join(mountings)}: take some where they see it together, or correct"
                " together in rig.yaml."
            )
        place = placements.of_views[name]
        common = np.flatnonzero(is_placed[place])
        views = poses[name][common]
        mounting, quarters, agrees = _mounting(views, placed[place[common]], steps, name)
        mountings[name] = mounting
        turns[name][common] = quarters
        inconsistent[name][common] = ~agrees
        turned = compose(poses[name], _turn_poses(turns[name]))
        usable = torch.from_numpy(~inconsistent[name])
        placed_poses = compose(invert_poses(mounting), turned)
        _place(placed, placed_poses[usable], place[usable.numpy()])
    return RigStart(mountings, placed, turns, inconsistent)


def turn_view(view: View, board: Board, quarters: int) -> View:
    """Return the view with its corners in the order of a board that is not turned.

    Args:
        quarters: the quarter turns about the board's z axis by which it stands turned.
    """
    if not quarters % 4:
        return view
    turn = rotation.matrix(_turn_poses(np.array([quarters]))[0, :3]).numpy()[:2, :2]
    points = board.points()
    distances = np.linalg.norm((points @ turn.T)[:, None] - points, axis=-1)
    order = distances.argmin(1)
    blur = view.blur
    if blur is not None:
        blur = blur[order][:, ::-1] if quarters % 2 else blur[order]
    return replace(
        view,
        corners=view.corners[order],
        weight=view.weight[order],
        covariance=None if view.covariance is None else view.covariance[order],
        blur=blur,
    )


def nearest_turns(poses: Tensor, expected: Tensor, board: Board) -> tuple[Indices, Tensor]:
    """Return the (V,) quarter turns by which the boards of (V, 6) poses stand turned against the
    expected (V, 6) poses, and the poses without these turns. A view whose expected pose is NaN
    counts as not turned.
    """
    steps = _turn_steps(board)
    candidates = torch.stack(
        [compose(poses, _turn_poses(np.full(len(poses), step))) for step in steps], 1
    )
    turns = rotation.matrix(candidates[..., :3])
    trace = torch.einsum("vij,vkij->vk", rotation.matrix(expected[:, :3]), turns)
    chosen = trace.nan_to_num(0.0).argmax(-1)
    nearest = candidates[torch.arange(len(poses)), chosen]
    return np.array(steps, np.int64)[chosen.numpy()], nearest


def _turn_steps(board: Board) -> tuple[int, ...]:
    """Return the numbers of quarter turns after which the board looks the same."""
    if board.coding:
        return (0,)
    return (0, 1, 2, 3) if board.columns == board.rows else (0, 2)


def _turn_poses(quarters: Indices) -> Tensor:
    """Return the (V, 6) poses of (V,) quarter turns about the board's z axis."""
    poses = torch.zeros(len(quarters), 6, dtype=torch.float64)
    poses[:, 2] = torch.from_numpy(quarters) * (torch.pi / 2)
    return poses


def _place(placed: Tensor, poses: Tensor, place: Indices) -> None:
    """Set the placements that have none yet, in place."""
    for pose, index in zip(poses, place.tolist(), strict=True):
        if bool(placed[index, 0].isnan()):
            placed[index] = pose


def _mounting(
    views: Tensor, placements: Tensor, steps: Sequence[int], name: str
) -> tuple[Tensor, Indices, NDArray[np.bool_]]:
    """Return the (6,) mounting on which most views agree, the quarter turns of each view, and true
    for each view that agrees.

    Args:
        views: (V, 6) T_camera_board.
        placements: (V, 6) T_reference_board.
        steps: the possible quarter turns.
    """
    inverses = invert_poses(placements)
    candidates = torch.stack(
        [
            compose(compose(views, _turn_poses(np.full(len(views), step))), inverses)
            for step in steps
        ],
        1,
    )  # (V, K, 6)
    reach = placements[:, 3:].norm(dim=-1)
    middle = (inverses[:, 3:].norm(dim=-1) + reach) / 2
    deviations = _deviations(candidates.flatten(0, 1), candidates, middle)  # (V K, V, K)
    agrees = (deviations.amin(-1) <= 1).sum(-1)  # (V K,)
    # Of equal numbers, the mounting whose agreeing views are nearest.
    spread = deviations.amin(-1).clamp_max(1.0).sum(-1)
    best = int((agrees - spread / (len(views) + 1)).argmax())
    if int(agrees[best]) < max(1, MIN_AGREEING * len(views)):
        raise NotEnoughDataError(
            f"Only {int(agrees[best])} of the {len(views)} pictures that {name} shares with the"
            " other cameras agree on where it is: correct together in rig.yaml, or check that no"
            " camera moved in between."
        )
    is_rival = deviations[best].flatten() > 4
    rivals = agrees[is_rival & (agrees > MAX_RIVAL * agrees[best])]
    if len(rivals) and len(steps) > 1:
        raise NotEnoughDataError(
            f"The board looks the same after a turn, and the pictures that {name} shares with the"
            " other cameras do not show how it stands: add pictures with the board tilted"
            " differently, or use a board with markers."
        )
    chosen = deviations[best].argmin(-1)  # (V,)
    agreeing = deviations[best].amin(-1) <= 1
    picked = candidates[torch.arange(len(views)), chosen][agreeing]
    mounting = _average(picked, candidates.flatten(0, 1)[best])
    quarters = np.array(steps, np.int64)[chosen.numpy()]
    return mounting, quarters, agreeing.numpy()


def _deviations(mountings: Tensor, candidates: Tensor, distance: Tensor) -> Tensor:
    """Return the (N, V, K) deviations of (V, K, 6) candidates from (N, 6) mountings, 1 at the limit
    of agreement. `distance` is the (V,) m distance of each view's board.
    """
    turns = rotation.matrix(mountings[:, :3])
    candidate_turns = rotation.matrix(candidates[..., :3])
    trace = torch.einsum("nij,vkij->nvk", turns, candidate_turns)
    angle = torch.arccos(((trace - 1) / 2).clamp(-1.0, 1.0))
    shift = (mountings[:, None, None, 3:] - candidates[..., 3:]).norm(dim=-1)
    return torch.maximum(angle / MAX_ANGLE, shift / (MAX_SHIFT * distance[:, None]))


def _average(mountings: Tensor, middle: Tensor) -> Tensor:
    """Return the (6,) median of (N, 6) mountings, by components about one of them."""
    relative = compose(mountings, invert_poses(middle).expand(len(mountings), 6))
    return compose(relative.median(0).values, middle)
