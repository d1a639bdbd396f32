"""A fitted lens may see no place where some corner is: that corner has no part in what is asked of
the others.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from calib.calibration import Calibration
from calib.estimation.residuals import residuals
from calib.session.schema import Number
from calib.verdict.judge import judge
from calib.verdict.verdict import Trust
from fixtures.degenerate import bare_session, calibration_of


def unseen_corners(calibration: Calibration) -> int:
    path, values = calibration.model()
    residual = residuals(
        path, values, calibration.observations, torch.from_numpy(calibration.poses)
    ).board
    return int(torch.isnan(residual).any(-1).sum())


def folded(calibration: Calibration, k1: float) -> Calibration:
    """Return the calibration with a radial coefficient that folds the picture's rim back."""
    intrinsics = calibration.camera.intrinsics
    assert intrinsics
    lens = (Number(k1), *(Number(0.0) for _ in range(4)))
    camera = replace(
        calibration.camera, intrinsics=replace(intrinsics, distortion=lens, correlations=())
    )
    return replace(calibration, camera=camera, covariance=np.zeros((0, 0)), effects=())


@pytest.mark.slow
def test_views_in_one_line_are_judged_though_a_corner_is_out_of_sight(tmp_path: Path) -> None:
    estimate = calibration_of(bare_session("line", 5099), tmp_path)
    candidates = (folded(estimate, -(1.1**power) / 100) for power in range(60))
    hidden = next(each for each in candidates if unseen_corners(each))
    assert unseen_corners(hidden) < len(hidden.observations.pixels) / 10
    assert judge(hidden).word is not Trust.TRUSTED
