"""The eight ways in which a picture can be turned and mirrored: a cover that fits one of the others
is described for other pictures.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch

from calib.estimation.observations import Observations
from calib.estimation.poses import pinhole_poses, refine_poses
from calib.estimation.residuals import residuals
from calib.optics.build import covered_path
from calib.verdict.case import Case
from calib.verdict.thresholds import ASKING_ORIENTATION, OTHER_ORIENTATION
from calib.verdict.verdict import Reason

VIEWS = 4
"""That are asked, evenly over the session: a wrong orientation is wrong in all of them."""


@dataclass(frozen=True, slots=True)
class Orientation:
    """Quarter turns clockwise of a picture, then mirrored left to right or not."""

    quarters: int
    mirrored: bool

    def __str__(self) -> str:
        turned = f"turned by {90 * self.quarters} degrees" if self.quarters else ""
        return " and ".join(filter(None, (turned, "mirrored" if self.mirrored else "")))

    def apply(self, observations: Observations, width: int, height: int) -> Observations:
        """What would have been seen in pictures of width x height px that are put right this way. A
        mirrored board is its own mirror image but for the order of its corners.
        """
        x, y = observations.pixels.unbind(-1)
        for _ in range(self.quarters):
            x, y, width, height = height - 1 - y, x, height, width
        if not self.mirrored:
            return replace(observations, pixels=torch.stack([x, y], -1))
        corners = observations.corners * observations.corners.new_tensor([-1.0, 1.0])
        return replace(observations, pixels=torch.stack([width - 1 - x, y], -1), corners=corners)


ALL = tuple(Orientation(quarters, mirrored) for mirrored in (False, True) for quarters in range(4))


def orientation(case: Case) -> Iterator[Reason]:
    """Asked only where the cover as it is described leaves much, and numbers that the fit corrected
    explain that.
    """
    cover, last = case.rms_px.get("cover", np.nan), case.rms_px.get("cover+rbf", np.nan)
    if not (cover > ASKING_ORIENTATION * last and case.corrected):
        return
    errors = {way: _error(case, way) for way in ALL}
    as_is, best = errors[ALL[0]], min(ALL, key=errors.__getitem__)
    if not errors[best] < OTHER_ORIENTATION * as_is:
        return
    said = (
        f"{best}, the pictures would fit the camera and cover as they are described, with"
        f" {errors[best]:.3f} px in place of {as_is:.3f}: either the camera's driver turns or"
        " mirrors them, or the numbers that the fit corrected are wrong. Describe the camera as"
        " these pictures show it, or turn them back."
    )
    yield Reason(said, case.next.fit(), ("frames", *case.corrected))


def _error(case: Case, way: Orientation) -> float:
    """px RMS of the smooth cover as it is declared; infinite where it cannot be."""
    calibration = case.calibration
    views = calibration.views[:: -(-len(calibration.views) // VIEWS)]
    seen = way.apply(
        Observations.of(views, calibration.board),
        calibration.camera.width,
        calibration.camera.height,
    )
    path, values = covered_path(calibration.declared.intrinsics, calibration.declared.cover)
    poses = pinhole_poses(seen, values)
    if not bool(torch.isfinite(poses).all()):
        return np.inf
    error = residuals(path, values, seen, refine_poses(path, values, seen, poses).blocks).rms_px
    return error if np.isfinite(error) else np.inf
