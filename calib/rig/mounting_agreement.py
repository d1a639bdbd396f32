"""The agreement of pictures on where a camera of a rig is mounted.

Each picture that two cameras share gives a mounting for each turn after which the board looks the
same. Pictures agree on a mounting if one of theirs is near it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from calib.optics import rotation
from calib.rig.placements import Indices
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
MIN_COMPARED = 3
"""The fewest pictures that may contradict each other, or agree on another pairing: of two, one
agrees with itself.
"""
MIRROR = (1.0, -1.0, -1.0, -1.0, 1.0, 1.0)
"""The factors of a pose that turn it into that of the mirrored picture: the mirror maps x to -x in
the camera's frame and in the board's.
"""


@dataclass(frozen=True, slots=True, eq=False)
class MountingAgreement:
    """The mountings by V pictures and K turns of their board, and which pictures agree on each."""

    candidates: Tensor
    """(V, K, 6) T_camera_reference."""
    deviations: Tensor
    """(V K, V, K) of the candidates from each other, 1 at the limit of agreement."""
    agreeing: Tensor
    """(V K,) the number of pictures that agree on each candidate."""
    best: int
    """The candidate on which most pictures agree."""

    @staticmethod
    def of(views: Tensor, placements: Tensor, steps: Sequence[int]) -> MountingAgreement:
        """Compare (V, 6) T_camera_board with (V, 6) T_reference_board.

        Args:
            steps: the numbers of quarter turns after which the board looks the same.
        """
        inverses = invert_poses(placements)
        candidates = torch.stack(
            [
                compose(compose(views, turn_poses(np.full(len(views), step))), inverses)
                for step in steps
            ],
            1,
        )
        reach = placements[:, 3:].norm(dim=-1)
        middle = (inverses[:, 3:].norm(dim=-1) + reach) / 2
        deviations = _deviations(candidates.flatten(0, 1), candidates, middle)
        agreeing = (deviations.amin(-1) <= 1).sum(-1)
        # Of equal numbers, the mounting whose agreeing views are nearest.
        spread = deviations.amin(-1).clamp_max(1.0).sum(-1)
        best = int((agreeing - spread / (len(views) + 1)).argmax())
        return MountingAgreement(candidates, deviations, agreeing, best)

    @property
    def count(self) -> int:
        """The number of pictures that agree on the best mounting."""
        return int(self.agreeing[self.best])

    @property
    def is_contradictory(self) -> bool:
        """True if too few pictures agree on any mounting."""
        return self.count < max(1, MIN_AGREEING * len(self.candidates))


def describe_other_pairing(
    views: Tensor, placements: Tensor, steps: Sequence[int], name: str
) -> str:
    """Return a sentence on the pairing, or the mirror, with which the pictures of a camera would
    agree on its mounting; empty if there is none. The pictures are in the order of their names or
    times.

    Args:
        views: (V, 6) T_camera_board.
        placements: (V, 6) T_reference_board, on which the views do not agree.
        steps: the numbers of quarter turns after which the board looks the same.
    """
    alternatives = [
        (
            views[:-1],
            placements[1:],
            f"paired with the next picture of the other cameras, {{}} of {name} agree: they are"
            " one too early in the pairing. Correct their names or times by one",
        ),
        (
            views[1:],
            placements[:-1],
            f"paired with the previous picture of the other cameras, {{}} of {name} agree: they"
            " are one too late in the pairing. Correct their names or times by one",
        ),
        (
            views * torch.tensor(MIRROR, dtype=views.dtype),
            placements,
            f"with those of {name} mirrored, {{}} agree: either this camera or the others write"
            " mirrored pictures. Turn the mirroring off, and record again",
        ),
    ]
    for poses, places, words in alternatives:
        if len(poses) < MIN_COMPARED:
            continue
        agreement = MountingAgreement.of(poses, places, steps)
        if agreement.count >= MIN_COMPARED and not agreement.is_contradictory:
            counted = words.format(f"{agreement.count} of {len(poses)} pictures")
            return f"{counted[0].upper()}{counted[1:]}."
    return ""


def turn_steps(board: Board) -> tuple[int, ...]:
    """Return the numbers of quarter turns after which the board looks the same."""
    if board.coding or not board.has_grid:
        return (0,)
    return (0, 1, 2, 3) if board.columns == board.rows else (0, 2)


def turn_poses(quarters: Indices) -> Tensor:
    """Return the (V, 6) poses of (V,) quarter turns about the board's z axis."""
    poses = torch.zeros(len(quarters), 6, dtype=torch.float64)
    poses[:, 2] = torch.from_numpy(quarters) * (torch.pi / 2)
    return poses


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
