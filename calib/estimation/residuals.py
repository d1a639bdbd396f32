"""The residuals of a model: on the board in metres, and in the image in pixels."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.estimation.observations import Observations
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.placement import Placement
from calib.optics.projection import project


@dataclass(frozen=True, slots=True)
class Residuals:
    """The residuals of all corners; NaN where no ray of the model joins the corner and the
    camera.
    """

    image: Tensor
    """(M, 2) px: the reprojection error, the projected minus the detected position of the
    corner.
    """
    board: Tensor
    """(M, 2) m: the point where the detected pixel's ray lands on the board, minus the corner (the
    paper's equation 2). If the target is not flat, in a plane that faces the camera.
    """

    @property
    def rms_px(self) -> float:
        """The root mean square of the two-dimensional reprojection error."""
        return _rms(self.image)

    @property
    def rmse_cm(self) -> float:
        """The root mean square distance on the board, in centimetres as in the paper's Table 1."""
        return 100 * _rms(self.board)

    def view_errors(self, observations: Observations) -> NDArray[np.float64]:
        """Return (V,) px, the root mean square error of each view over the corners that the model
        sees; NaN for a view without such a corner.
        """
        squares = observations.per_view((self.image**2).sum(-1))
        return np.array([float(view_squares.nanmean().sqrt()) for view_squares in squares])


def residuals(path: Path, values: Values, observations: Observations, poses: Tensor) -> Residuals:
    """Return the residuals of all corners, with the boards at (V, 6) poses."""
    batches = [_residuals(path, values, batch, poses) for batch in observations.batches()]
    return Residuals(
        torch.cat([batch.image for batch in batches]), torch.cat([batch.board for batch in batches])
    )


def _residuals(path: Path, values: Values, observations: Observations, poses: Tensor) -> Residuals:
    """Return the residuals of few corners."""
    exposure = observations.exposure
    boards = Placement.of(poses)[observations.view].at_exposure(exposure)
    values_of_rows = path.values_of_views(values, poses[observations.view])
    trace = None
    if not path.directly_projects:  # then the projection starts with these rays
        trace = path.trace_with_derivatives(
            observations.pixels, values_of_rows, exposure, frozenset()
        )
    rays = trace.rays if trace else path.trace(observations.pixels, values_of_rows, exposure)
    corners, planes = path.planes(observations.corners, boards)
    landed, failure = path.target(rays, planes, values)
    offset = landed - corners
    board = torch.where((failure != 0).unsqueeze(-1), torch.full_like(offset, torch.nan), offset)
    through = rays if path.target.glass else None
    points = path.target.place(observations.corners, boards, values, through)
    projected = project(path, values_of_rows, points, exposure, observations.pixels, trace)
    return Residuals(projected - observations.pixels, board)


def reach_board(path: Path, values: Values, observations: Observations, poses: Tensor) -> Tensor:
    """Return (M,) true where a corner's ray reaches the board, with boards at (V, B) poses."""
    failures = [
        path.land_beside(batch.corners, batch.pixels, values, poses[batch.view], batch.exposure)[1]
        for batch in observations.batches()
    ]
    return torch.cat(failures) == 0


def _rms(errors: Tensor) -> float:
    return float((errors**2).sum(-1).nanmean().sqrt())
