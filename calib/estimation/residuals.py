"""How far a model misses what was seen: on the board in metres, and in the image in pixels."""

from dataclasses import dataclass

import torch
from torch import Tensor

from calib.estimation.observations import Observations
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.projection import project


@dataclass(frozen=True, slots=True)
class Residuals:
    """NaN where no ray of the model joins the corner and the camera."""

    image: Tensor
    """(M, 2) px: the reprojection error, where the model sees the corner minus where it was seen.
    """
    board: Tensor
    """(M, 2) m: where the seen pixel's ray lands on the board minus the corner (the paper's
    equation 2).
    """

    @property
    def rms_px(self) -> float:
        """Root mean square of the two-dimensional reprojection error."""
        return _rms(self.image)

    @property
    def rmse_cm(self) -> float:
        """Root mean square distance on the board, in centimetres as in the paper's Table 1."""
        return 100 * _rms(self.board)


def residuals(path: Path, values: Values, observations: Observations, poses: Tensor) -> Residuals:
    """The residuals of all corners, with the boards at (V, 6) poses."""
    own, values = poses[observations.view], observations.with_times(values)
    landed, failure = path.land(observations.pixels, values, own)
    off = torch.where(
        (failure != 0).unsqueeze(-1),
        torch.full_like(landed, torch.nan),
        landed - observations.corners,
    )
    seen = project(
        path, values, path.place(observations.corners, values, own), start=observations.pixels
    )
    return Residuals(seen - observations.pixels, off)


def _rms(errors: Tensor) -> float:
    return float((errors**2).sum(-1).nanmean().sqrt())
