"""Check: the orientation of the pictures, among the eight ways to turn and mirror them. If another
one fits, the cover is described for other pictures.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import torch

from calib.calibration import Calibration
from calib.estimation.observations import Observations
from calib.estimation.poses import pinhole_poses, refine_poses
from calib.estimation.residuals import residuals
from calib.optics.build import covered_path
from calib.verdict.case import Case
from calib.verdict.thresholds import ASKING_ORIENTATION, OTHER_ORIENTATION
from calib.verdict.verdict import Reason

MAX_TESTED_VIEWS = 4
"""The number of tested views, spread over the session; a wrong orientation is wrong in all
views.
"""


@dataclass(frozen=True, slots=True)
class Orientation:
    """Clockwise quarter turns of a picture, followed by mirroring left to right or not."""

    quarters: int
    mirrored: bool

    def __str__(self) -> str:
        turned = f"turned by {90 * self.quarters} degrees" if self.quarters else ""
        return " and ".join(filter(None, (turned, "mirrored" if self.mirrored else "")))

    def apply(self, observations: Observations, width: int, height: int) -> Observations:
        """Return the observations in pictures of width x height px turned and mirrored this way. A
        mirrored board equals its mirror image except for the order of its corners.
        """
        x, y = observations.pixels.unbind(-1)
        for _ in range(self.quarters):
            x, y, width, height = height - 1 - y, x, height, width
        if not self.mirrored:
            return replace(observations, pixels=torch.stack([x, y], -1))
        corners = observations.corners.clone()
        corners[:, 0] *= -1
        return replace(observations, pixels=torch.stack([width - 1 - x, y], -1), corners=corners)


ALL = tuple(Orientation(quarters, mirrored) for mirrored in (False, True) for quarters in range(4))


def orientation(case: Case) -> Iterator[Reason]:
    """Check the orientation if the declared cover has a large error and the fit corrected
    numbers.
    """
    errors_px = case.rms_px
    if not {"cover", "cover+rbf"} <= errors_px.keys() or case.has_unknown:
        return
    if not (errors_px["cover"] > ASKING_ORIENTATION * errors_px["cover+rbf"] and case.corrected):
        return
    errors = {candidate: _error(case.calibration, candidate) for candidate in ALL}
    declared_error, best = errors[ALL[0]], min(ALL, key=errors.__getitem__)
    if not errors[best] < OTHER_ORIENTATION * declared_error:
        return
    sentence = (
        f"{best}, the pictures would fit the camera and cover as they are described, with"
        f" {errors[best]:.3f} px in place of {declared_error:.3f}: either the camera's driver turns"
        " or mirrors them, or the numbers that the fit corrected are wrong. Describe the camera as"
        " these pictures show it, or turn them back."
    )
    yield Reason(sentence, case.next.fit(), ("frames", *case.corrected))


@lru_cache(maxsize=len(ALL))  # a report and the command that writes it both judge
def _error(calibration: Calibration, orientation: Orientation) -> float:
    """Return the root mean square error in px of the smooth declared cover; infinite without
    poses.
    """
    views = calibration.views[:: -(-len(calibration.views) // MAX_TESTED_VIEWS)]
    observations = orientation.apply(
        Observations.of(views, calibration.board),
        calibration.camera.width,
        calibration.camera.height,
    )
    path, values = covered_path(calibration.declared.intrinsics, calibration.declared.cover)
    poses = pinhole_poses(path, values, observations)
    if not bool(torch.isfinite(poses).all()):
        return np.inf
    error = residuals(
        path, values, observations, refine_poses(path, values, observations, poses).blocks
    ).rms_px
    return error if np.isfinite(error) else np.inf
