"""A fitted lens may see no place where some corner is: that corner has no part in what is asked of
the others.
"""

from pathlib import Path

import torch

from calib.estimation.residuals import residuals
from calib.verdict.judge import judge
from calib.verdict.verdict import Trust
from fixtures.degenerate import bare_session, calibration_of


def test_views_in_one_line_are_judged_though_a_corner_is_out_of_sight(tmp_path: Path) -> None:
    estimate = calibration_of(bare_session("line", 5099), tmp_path)
    path, values = estimate.model()
    residual = residuals(
        path, values, estimate.observations, torch.from_numpy(estimate.poses)
    ).board
    assert 0 < int(torch.isnan(residual).any(-1).sum()) < 5
    assert judge(estimate).word is not Trust.TRUSTED
