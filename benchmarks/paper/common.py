"""The common parts of the figures and tables: the glass, the paper's procedure, and the type of a
result.
"""

from dataclasses import dataclass

import torch
from matplotlib.figure import Figure
from torch import Tensor

from calib.estimation.gradient_fit import descend
from calib.estimation.observations import Observations
from calib.estimation.poses import pinhole_poses, refine_poses
from calib.estimation.residuals import residuals
from calib.optics.build import covered_path, footprint, pinhole_path, with_relief
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.relief import Relief
from calib.session.camera import Intrinsics
from calib.session.cover import Cover

THICKNESS = 0.00115
"""m: the paper does not state it; fig8 finds it."""
NOMINAL = 0.003
"""m: this project's nominal glass, and the rendered one."""

BLUE, ORANGE, GREY = "#2a6fb0", "#d9772b", "#777777"


@dataclass(frozen=True, slots=True)
class Result:
    text: str
    """The printed text."""
    figure: Figure | None = None


@dataclass(frozen=True, slots=True)
class Fitted:
    """Fitted as in the paper's section 4.2; errors are in cm on the board."""

    path: Path
    values: Values
    poses: Tensor
    pinhole: float
    pinhole_elsewhere: float
    """The pinhole model with the poses that the cone gives."""
    cone: float
    final: float


def relief_fit(
    path: Path,
    values: Values,
    relief: Relief,
    observations: Observations,
    poses: Tensor,
    steps: int,
) -> tuple[Path, dict[str, Tensor]]:
    """A smooth cover's path and numbers to those with amplitudes, descended from zero with the
    poses held.
    """
    uneven = with_relief(path, relief)
    start = {**values, "relief.amplitudes": torch.zeros(relief.grid, dtype=torch.float64)}
    return uneven, {
        **start,
        "relief.amplitudes": descend(uneven, start, observations, poses, steps=steps),
    }


def procedure(
    intrinsics: Intrinsics, cover: Cover, observations: Observations, width: int, height: int
) -> Fitted:
    """Poses by the pinhole model, then through the perfect cone; then 1000 steps on 8x8 amplitudes
    over the glass that is seen.
    """
    bare, camera = pinhole_path(intrinsics)
    poses = pinhole_poses(bare, camera, observations)
    pinhole = residuals(bare, camera, observations, poses).rmse_cm
    path, values = covered_path(intrinsics, cover)
    poses = refine_poses(path, values, observations, poses).blocks
    elsewhere = residuals(bare, camera, observations, poses).rmse_cm
    cone = residuals(path, values, observations, poses).rmse_cm
    relief = Relief(*footprint(path, values, width, height), (8, 8))
    path, values = relief_fit(path, values, relief, observations, poses, steps=1000)
    return Fitted(
        path,
        values,
        poses,
        pinhole,
        elsewhere,
        cone,
        residuals(path, values, observations, poses).rmse_cm,
    )
